"""Measurement of sizes, times and speeds of trees in languages.

Each step runs in a forked process with all imports, so that no cell benefits from another's memory.
A process beyond its time or memory is ended without affecting others. Times are CPU times.
"""

import dataclasses
import gc
import hashlib
import math
import multiprocessing
import os
import resource
import signal
import subprocess
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from copy import copy
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import cache, cached_property, lru_cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import product
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from statistics import median
from time import process_time, thread_time
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace

from backends.mfotl.predicates import MfotlHeader
from cross_check.generate.times import SECOND, TODAY, timed
from cross_check.generate.values import fitting, interesting_values
from cross_check.participants import loaded
from cross_check.published import flink, monpoly, r2u2
from cross_check.published.flink import RowHeader
from cross_check.results import DETECTIONS_ONLY, Status, raised, reason
from rvaft.api import loads
from rvaft.backend import Specification, all_backends, backend
from rvaft.engine import Engine
from rvaft.errors import Cause, NotExpressible, OptionError, RvaftError, unwritten
from rvaft.language.printer import dumps
from rvaft.model.assumptions import first_violation
from rvaft.model.nodes import Assumption, Gate, Node
from rvaft.model.patterns import Anything, Literal, substitute
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor
from rvaft.support.processes import Killed, in_processes

MAX_ARITY: Final = 12  # the default maximum of children
ROUNDS: Final = 3  # the maximum number of repetitions of a timed step
PATIENCE: Final = 0.2  # seconds after which a step is not repeated
READERS: Final = 4  # the maximum number of fresh readers, one per walk
WALKING: Final = 30.0  # seconds to generate the events of a tree with the engine; not counted for languages
SLACK: Final = 10  # the ratio of wall time to CPU time that is allowed, per parallel process
GRACE: Final = 5.0  # additional seconds of wall time per process
SIZES: Final = ("symbols", "subformulas", "states", "edges")  # sizes of a text
ONLY_EMITTED: Final = "only emitted: {} was not run"
"""Of a text without a reader in rvaft; {} is the program that would run it."""
PROGRAMS: Final[Mapping[str, str]] = {"mfotl": "MonPoly", "mtl-r2u2": "R2U2", "match-recognize": "Apache Flink"}
"""Programs of languages without a reader; `MONPOLY` and `R2U2` of the environment are paths of the first two."""
EVENTS: Final = 240  # events of all walks of a tree
LONGEST: Final = 60  # the maximum number of events of a walk without a verdict
_PATHS: Final[Mapping[str, str]] = {"mfotl": "MONPOLY", "mtl-r2u2": "R2U2"}
_EACH: Final = 10.0
"""Seconds for one trace in an external program."""
_FORK: Final = 0.01  # approximate seconds to fork a reader
_NOISE: Final = 0.1  # the probability of an irrelevant event
_DOOMED: Final = 4  # one of this many walks leads to ⊥
_TRIES: Final = 16  # the number of events tried
_FOREIGN: Final = "none of the tree's"
_OTHERS: Final = ("top or all rows some; all and a b; rows sand c d e; some 2of3 f g h;", "top sand a b c;")
"""Warm-up trees, different from measured ones; the second is for less expressive languages."""
_SCALARS: Final = (str, int, float, bool, type(None))


@dataclass(frozen=True)
class Subject:
    """A tree with its name in reports.

    `gate` and `threshold` describe a gate over leaves; they are None for other trees.
    """

    name: str
    tree: RVAFT
    gate: Gate | None = None
    threshold: int | None = None

    @cached_property
    def digest(self) -> str:
        """First digits of a hash of the tree's canonical text."""
        return hashlib.sha256(dumps(self.tree).encode(errors="surrogateescape")).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Cell:
    """A tree under a semantics in a language."""

    subject: Subject
    semantics: Semantics
    language: str


def gate_subjects(gates: Iterable[Gate] = Gate, max_arity: int = MAX_ARITY) -> Iterator[Subject]:
    """Yield each gate over 1 to `max_arity` leaves with distinct default events.

    VOT has every threshold.

    >>> [subject.name for subject in gate_subjects(map(Gate, ["and", "vot"]), 2)]
    ['and 1', 'and 2', 'vot 1/1', 'vot 1/2', 'vot 2/2']
    """
    for gate in gates:
        for children in range(1, max_arity + 1):
            leaves = [Node(f"e{number}") for number in range(1, children + 1)]
            for threshold in range(1, children + 1) if gate.counts else (None,):
                root = Node("top", gate, tuple(leaf.name for leaf in leaves), threshold)
                size = f"{children}" if threshold is None else f"{threshold}/{children}"
                yield Subject(f"{gate} {size}", RVAFT("top", [root, *leaves]), gate, threshold)


def default_languages() -> tuple[str, ...]:
    """Return one form of each specification language, faithful ones first; programs in C are none."""
    found = {name: loaded(name) for name in all_backends()}  # backends that cannot be loaded get rows with the reason
    languages = [name for name, one in found.items() if one is None or not (one.form_of or name == "c")]
    return tuple(sorted(languages, key=lambda name: ((one := found[name]) is None or not one.faithful, name)))


def cells_of(
    subjects: Iterable[Subject], semantics: Iterable[Semantics] | None, languages: Iterable[str]
) -> tuple[Cell, ...]:
    """Return every tree under every semantics (None: that of the tree) in every language, in this
    order.

    Raises `OptionError` for an empty comparison, and for two trees with one name.
    """
    parts = product(subjects, (None,) if semantics is None else semantics, languages)
    cells = tuple(Cell(subject, resolve_semantics(subject.tree, one), language) for subject, one, language in parts)
    for name, count in Counter(subject.name for subject in dict.fromkeys(cell.subject for cell in cells)).items():
        if count > 1:
            raise OptionError(
                f"{count} trees have the name {name}: rename a file, or write its path differently, such as ./{name}"
            )
    if not cells:
        raise OptionError("nothing to compare: name at least one tree or gate, one semantics and one language")
    return cells


class Outcome(StrEnum):
    """The outcome of a step; expressiveness, limits and time are kept apart."""

    OK = "ok"
    NOT_EXPRESSIBLE = "not expressible"
    TOO_LARGE = "too large"
    TIMEOUT = "timeout"
    TOOL_MISSING = "tool missing"
    FAILED = "could not run"


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings of a measurement.

    `limit` bounds translations, in the unit of the language (None: the backend's default).
    `timeout` is in CPU seconds for one cell, `memory` in megabytes (2**20 bytes) that a process
    may take beyond what it inherits.
    `seed` selects the events.
    """

    limit: int | None = None
    timeout: float = 60.0
    seed: int = 0
    memory: int = 4096


class Measurement(msgspec.Struct, frozen=True):
    """The measurements of one cell, in the columns of the CSV file (see docs/compare.md); None if
    unknown.

    - `result`: outcome of the translation; `run`: of reading the text and running events.
    - `cause`: of a tree that is not expressible, whether the language cannot or rvaft does not write it.
    - `extension`: the extensions of rvaft that the text uses.
    - `seconds`: median time of a translation; `seconds_spread`: its longest less its shortest.
    - `again_per_second`: median speed of one reader that runs all `events` again; `again_spread`:
      the fastest run less the slowest. No speeds are given for fewer than `EVENTS` events.
    - `events_per_second`: speed of fresh readers on `first_events`.
    - `differing`: the number of `walks` with other verdicts than the tree's.

    A detections-only language gets whole traces; for `again_per_second` all of them at once.
    """

    tree: str
    gate: Gate | None
    children: int | None
    threshold: int | None
    semantics: Semantics
    language: str
    result: Outcome | None = None
    reason: str = ""
    symbols: int | None = None
    subformulas: int | None = None
    states: int | None = None
    edges: int | None = None
    characters: int | None = None
    seconds: float | None = None
    run: Outcome | None = None
    run_reason: str = ""
    read_seconds: float | None = None
    events: int | None = None
    events_per_second: float | None = None
    again_per_second: float | None = None
    walks: int | None = None
    differing: int | None = None
    limit: int | None = None
    timeout: float = 0.0
    seed: int = 0
    digest: str = ""
    version: str = ""
    first_events: int | None = None
    memory: int | None = None
    cause: Cause | None = None
    extension: str = ""
    seconds_spread: float | None = None
    again_spread: float | None = None

    @property
    def key(self) -> tuple[object, ...]:
        """The identity of a measurement, without time and memory limits."""
        return (self.tree, self.digest, self.semantics, self.language, self.limit, self.seed, self.version)

    def serves(self, wanted: "Measurement") -> bool:
        """Return whether this record can replace another with the same key.

        It must be complete, and not limited by less time or memory.
        """
        if self.key != wanted.key or self.ended is None or self.broken:
            return False
        if self.only_emitted and _installed(self.language):
            return False
        ends = (self.result, self.run)
        late = Outcome.TIMEOUT in ends and self.timeout < wanted.timeout
        large = Outcome.TOO_LARGE in ends and (self.memory or 0) < (wanted.memory or 0)
        return not (late or large)

    @property
    def broken(self) -> bool:
        """Whether the failure concerns only this installation, not the language."""
        return any(end in (Outcome.TOOL_MISSING, Outcome.FAILED) for end in (self.result, self.run))

    @property
    def detections_only(self) -> bool:
        """Whether the text was run by a program that never reports ⊥."""
        return self.run_reason.startswith(DETECTIONS_ONLY)

    @property
    def only_emitted(self) -> bool:
        """Whether the text has no reader."""
        return self.run_reason.startswith(ONLY_EMITTED.partition("{}")[0])

    @property
    def ended(self) -> Outcome | None:
        """The outcome of the translation or, if it succeeded, of reading and running its text."""
        return self.run if self.result is Outcome.OK else self.result


def unmeasured(cell: Cell, settings: Settings) -> Measurement:
    """Return the record of a cell before measuring."""
    subject = cell.subject
    return Measurement(
        subject.name,
        subject.gate,
        None if subject.gate is None else len(subject.tree.nodes[subject.tree.root].children),
        subject.threshold,
        cell.semantics,
        cell.language,
        digest=subject.digest,
        version=version("rvaft"),
        **asdict(settings),
    )


class _Unmeasurable(Exception):
    """The outcome of a step without result, its reason on one line, and the cause of a refusal."""


def measured(
    cells: Sequence[Cell], settings: Settings, *, jobs: int = 1
) -> Generator[tuple[Cell, Measurement], None, None]:
    """Yield the measurements in order, each as soon as it is known; close the generator to stop
    early.

    Several `jobs` disturb each other's times.
    """
    for language, semantics in dict.fromkeys((cell.language, cell.semantics) for cell in cells):
        _warm_up(language, semantics)  # import all modules, and translate the warm-up text of every fork
    clock = SLACK * jobs * settings.timeout + GRACE

    @lru_cache(maxsize=1)
    def trodden(tree: RVAFT, semantics: Semantics) -> tuple[Walk, ...]:
        with suppress(_Unmeasurable):
            work = partial(walks, tree, semantics, settings.seed, seconds=WALKING)
            found: tuple[Walk, ...] = _isolated(work, 2 * WALKING, clock, settings)[0]
            return found
        return ()

    def measure(cell: Cell) -> Measurement:
        signal.signal(signal.SIGTERM, _end)
        return _measured(cell, settings, clock, trodden(cell.subject.tree, cell.semantics))

    with closing(in_processes(measure, cells, jobs=jobs)) as running:
        for cell, found in running:
            if isinstance(found, Killed):
                reason = "the process that measured it was killed"
                yield cell, replace(unmeasured(cell, settings), result=Outcome.FAILED, reason=reason)
            else:
                yield cell, found


def _end(*_signal: object) -> None:
    """End this process and its children on SIGTERM.

    An exception would count as a result, and the pool would wait forever.
    """
    for process in multiprocessing.active_children():
        process.kill()
    os._exit(1)


def _measured(cell: Cell, settings: Settings, clock: float, trodden: Sequence["Walk"]) -> Measurement:
    """Translate, read and run the text; errors of a backend become part of the record."""
    record, left = unmeasured(cell, settings), settings.timeout

    def isolated(work: Callable[[], Any]) -> Any:
        nonlocal left
        result, used = _isolated(work, left, clock, settings)
        left = max(left - used, 0.001)
        return result

    try:
        made, times = isolated(partial(_translated, cell, settings.limit))
        text, tree = made.text, cell.subject.tree
        trodden = [walk for walk in trodden if first_violation(tree, walk.events, made.assumes) is None]
    except _Unmeasurable as end:
        return replace(record, result=end.args[0], reason=end.args[1], cause=end.args[2])
    found = {name: getattr(made.metrics, name) for name in SIZES}
    found |= {"characters": len(text), "extension": ", ".join(made.extensions)}
    found |= {"seconds": _rounded(median(times)), "seconds_spread": _spread(times)}
    record = replace(record, result=Outcome.OK, run=Outcome.OK, **found)
    if not backend(cell.language).readable and not _installed(cell.language):
        return replace(record, run_reason=ONLY_EMITTED.format(PROGRAMS[cell.language]))
    try:
        first, again = isolated(partial(_ran_again, cell, text, trodden))
        record = replace(
            record,
            run_reason=_remark(first, len(trodden)),
            read_seconds=_rounded(first.reading),
            events=first.events,
            first_events=0,
            again_per_second=_speed(first.events, median(again)),
            again_spread=_spread([first.events / seconds for seconds in again if seconds and first.events >= EVENTS]),
            walks=first.walks,
            differing=first.differing,
        )
        readers = min(READERS, len(trodden), 1 + int(PATIENCE / (first.reading + _FORK)))
        step = -(-len(trodden) // readers) if readers else 1
        fresh = [] if first.external else [isolated(partial(_ran, cell, text, [walk])) for walk in trodden[::step]]
    except _Unmeasurable as end:
        return replace(record, run=end.args[0], run_reason=end.args[1])
    events = sum(one.events for one in fresh)
    speed = events / sum(one.seconds for one in fresh) if events and first.events >= EVENTS else None
    return replace(record, first_events=events, events_per_second=None if speed is None else _rounded(speed))


def _remark(ran: "Run", walks: int) -> str:
    if not walks:
        return "no events: the engine exceeds its limits on the tree"
    open_ones = f", {walks - ran.walks} of {walks} traces are left open" if ran.walks < walks else ""
    return f"{DETECTIONS_ONLY}{open_ones}" if ran.whole else ""


def _isolated(work: Callable[[], object], seconds: float, clock: float, settings: Settings) -> tuple[Any, float]:
    """Return the result of work in its own process and the CPU seconds used; raises
    `_Unmeasurable`.
    """
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(work, sender, seconds, clock, settings), daemon=True)
    # SIGTERM during a fork would leave the other process running, or cause warnings.
    open_signals = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    process.start()
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, open_signals)
        sender.close()  # the end of the process closes the pipe
        with receiver:
            result, used = receiver.recv()
    except EOFError:
        process.join()
        code = process.exitcode or 0
        limits = {-signal.SIGPROF: f"{settings.timeout:g} s", -signal.SIGALRM: f"{clock:g} s by the clock"}
        if code in limits:
            raise _Unmeasurable(Outcome.TIMEOUT, f"not within {limits[code]}", None) from None
        how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
        raise _Unmeasurable(Outcome.FAILED, f"the process that measured it was killed ({how})", None) from None
    finally:
        process.kill()
        process.join()
    if isinstance(result, _Unmeasurable):
        raise result
    return result, used


def _work(work: Callable[[], object], sender: Connection, seconds: float, clock: float, settings: Settings) -> None:
    """Run the work within limits of CPU time, wall time and memory, and send its result."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, clock)
    inherited = resource.getrlimit(resource.RLIMIT_AS)
    limit_memory(settings.memory * 2**20)
    # a collection of existing objects would copy their pages during a run
    gc.freeze()
    result: object
    try:
        result = work()
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_AS, inherited)  # memory to report the failure
        result = _Unmeasurable(Outcome.TOO_LARGE, f"megabytes of memory (limit {settings.memory})", None)
    except Exception as error:  # noqa: BLE001
        known = raised(error)
        cause = known.cause if isinstance(known, NotExpressible) else None
        result = _Unmeasurable(Outcome(Status.of(known)), reason(known), cause)
    if process_time() > seconds:  # the system checks its timer only at intervals
        signal.raise_signal(signal.SIGPROF)
    sender.send((result, process_time()))


def limit_memory(size: int) -> None:
    """Let this process map at most `size` bytes more than it has mapped, within its hard limit.

    A forked process inherits what libraries have reserved, which can be gigabytes without use.
    """
    pages = 0
    with suppress(OSError):  # systems without /proc, which do not count inherited memory
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    wanted = pages * resource.getpagesize() + size
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))


def _warm_up(language: str, semantics: Semantics) -> None:
    """Read and run an unrelated tree with all gates.

    A fork copies each page that it writes, and Python writes to objects that it reads. This cost is
    not part of any time.
    """
    with suppress(Exception):  # errors of a backend appear in its rows
        reader = backend(language).read(_other_text(language, semantics))
        if isinstance(reader, DetectionMonitor):
            reader.first_detections([[{"event": name} for name in "cfadgb"]])
            return
        for start in range(6):
            monitor = reader.fork()
            for name in "cfadgb"[start:]:
                monitor.step({"event": name})


@cache
def _other_text(language: str, semantics: Semantics) -> str:
    """Return the text of the first expressible warm-up tree, or an empty string."""
    for tree in map(loads, _OTHERS):
        with suppress(RvaftError):
            return backend(language).translate(tree, semantics).text
    return ""


NO_LATE_EVENTS: Final = "late events are dropped in C and SQL alone: other texts assume that there are none"


def _translated(cell: Cell, limit: int | None) -> tuple[Specification, list[float]]:
    """Return the text, and the seconds of each translation.

    Raises `NotExpressible` if the text assumes that no event is late.
    """
    times: list[float] = []
    while not times or (len(times) < ROUNDS and sum(times) < PATIENCE):
        tree = copy(cell.subject.tree)  # a new tree, without caches
        start = thread_time()
        made = backend(cell.language).translate(tree, cell.semantics, limit=limit)
        times.append(thread_time() - start)
    if Assumption.ORDER in made.assumes:
        raise NotExpressible(unwritten(NO_LATE_EVENTS))
    return dataclasses.replace(made, reader=None), times  # a reader cannot pass between processes


class Run(NamedTuple):
    """The times of reading a text and running events, and the numbers of events, walks and
    differing walks.

    `whole`: the program processes whole traces.
    """

    reading: float
    seconds: float
    events: int
    walks: int
    differing: int
    whole: bool = False
    external: bool = False


def _installed(language: str) -> bool:
    """Return whether the program of a language without a reader is there."""
    match language:
        case "mfotl" | "mtl-r2u2":
            return bool(os.environ.get(_PATHS[language]))
        case "match-recognize":
            return find_spec("pyflink") is not None
        case _:
            return False


def _ran_outside(cell: Cell, text: str, trodden: Sequence["Walk"]) -> Run:
    """Run the walks in the program of a language without a reader; its processor time counts."""
    left_open: Callable[[Sequence[Json]], str] = lambda _: ""  # noqa: E731
    ask: Callable[[Sequence[Sequence[Json]]], Sequence[int | None]]
    path = Path(os.environ.get(_PATHS.get(cell.language, ""), ""))
    match cell.language:
        case "mfotl":
            left_open, ask = (
                MfotlHeader.read(text).left_open,
                partial(monpoly.first_detections, path, text, timeout=_EACH),
            )
        case "mtl-r2u2":
            ask = partial(r2u2.first_detections, path, text, timeout=_EACH)
        case "match-recognize":
            left_open = RowHeader.read(text).left_open
            ask = lambda traces: flink.first_detections([(text, traces)])[0]  # noqa: E731
        case _:
            raise AssertionError(cell.language)
    decidable = [walk for walk in trodden if not left_open(walk.events)]
    start = _children()
    try:
        found = ask([walk.events for walk in decidable])
    except subprocess.TimeoutExpired as error:
        raise _Unmeasurable(Outcome.TIMEOUT, f"no answer within {error.timeout:g} s for one trace", None) from None
    seconds = _children() - start
    differing = sum(number != walk.detection for number, walk in zip(found, decidable, strict=True))
    events = sum(len(walk.events) for walk in decidable)
    return Run(0.0, seconds, events, len(decidable), differing, whole=True, external=True)


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _ran(cell: Cell, text: str, trodden: Sequence["Walk"]) -> Run:
    """Read the text, and run each walk from the start to its final verdict, with one reader."""
    if not backend(cell.language).readable:
        return _ran_outside(cell, text, trodden)
    _warm_up(cell.language, cell.semantics)
    start = thread_time()
    reader = backend(cell.language).read(text)
    reading, seconds, events, differing = thread_time() - start, 0.0, 0, 0
    if isinstance(reader, DetectionMonitor):
        decidable = [walk for walk in trodden if not reader.left_open(walk.events)]
        with no_collection():
            start = thread_time()
            found = reader.first_detections([walk.events for walk in decidable])
            seconds = thread_time() - start
        events = sum(len(walk.events) for walk in decidable)
        differing = sum(number != walk.detection for number, walk in zip(found, decidable, strict=True))
        return Run(reading, seconds, events, len(decidable), differing, whole=True)
    for walk in trodden:
        monitor, got = reader.fork(), []
        with no_collection():
            start = thread_time()
            for event in walk.events:
                got.append(monitor.step(event))
                if monitor.verdict.final:  # later events cost nothing
                    break
            seconds += thread_time() - start
        events += len(got)
        differing += tuple(got) != walk.verdicts
    return Run(reading, seconds, events, len(trodden), differing)


def _ran_again(cell: Cell, text: str, trodden: Sequence["Walk"]) -> tuple[Run, list[float]]:
    """Return the first run of all walks by one reader, and the seconds of each later run.

    For whole traces the first run counts, because programs cache answers.
    """
    first = _ran(cell, text, trodden)
    if first.whole:
        return first, [first.seconds]
    times = [first.seconds]
    while len(times) < 2 or (len(times) < ROUNDS and sum(times) < PATIENCE):
        times.append(_ran(cell, text, trodden).seconds)
    return first, times[1:]


@contextmanager
def no_collection() -> Iterator[None]:
    """Disable the garbage collector, as `timeit` does."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _speed(events: int, seconds: float) -> float | None:
    return _rounded(events / seconds) if events >= EVENTS and seconds else None


def _spread(several: Sequence[float]) -> float | None:
    """Return the largest less the smallest, or None for one number."""
    return _rounded(max(several) - min(several)) if len(several) > 1 else None


def _rounded(number: float) -> float:
    return float(f"{number:.4g}")  # more digits are not significant


@dataclass(frozen=True, slots=True)
class Walk:
    """A generated trace, and the verdict after each event."""

    events: tuple[Json, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def detection(self) -> int | None:
        """The number of the detecting event, from 1, or None."""
        return self.verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in self.verdicts else None


def walks(
    tree: RVAFT, semantics: Semantics, seed: int, *, events: int = EVENTS, seconds: float = math.inf
) -> tuple[Walk, ...]:
    """Return traces with this many events, each up to a final verdict or `LONGEST`; fewer if the
    engine fails or times out.

    Random traces would soon lead to ⊥ in most trees, where monitors have no work. Each event is
    therefore one that the engine awaits, with values that avoid ⊥ if possible; one in ten is
    irrelevant where harmless. One walk in four leads to ⊥ at a random point if possible, because
    texts must report ⊥ too. For trees with times, events are a second apart.
    """
    until, judge = process_time() + seconds, Engine(tree, semantics)
    # under `consecutive` there is no ⊥: continue the match that was begun
    start = Engine(tree, Semantics.PROJECTED) if semantics is Semantics.CONSECUTIVE else judge
    random = Random(f"{seed} {semantics}")  # noqa: S311 (no secret)
    values = [value for value in interesting_values(tree) if isinstance(value, _SCALARS)]

    def now(event: Json) -> Json:
        return event if tree.time is None else timed(random, tree, event, TODAY + len(taken) * SECOND, plain=True)

    def fitted(node: str, variables: Mapping[str, Json]) -> Json:
        bound = {name: Literal(value) for name, value in variables.items() if isinstance(value, _SCALARS)}
        return now(fitting(random, substitute(tree.pattern(node) or Anything(), bound), values))

    def some_nodes() -> list[str]:
        return random.sample(tree.occurrences, min(len(tree.occurrences), _TRIES))

    def hopeless(monitor: Engine) -> Json | None:
        """Return an event that leads to ⊥, if one is found: mostly one of the tree."""
        tried = [fitted(node, {}) for node in some_nodes()]
        tried.insert(random.randrange(len(tried) + 1), now({_FOREIGN: 0}))
        return next((event for event in tried if monitor.fork().step(event) is Verdict.FALSE), None)

    def candidates(monitor: Engine) -> Iterator[tuple[str, Mapping[str, Json]]]:
        """Yield nodes whose events to try, with bound values.

        Pending events are computed only if trying costs as much.
        """
        if semantics is not Semantics.SCATTERED and not tree.variables:  # a wrong guess shows at once
            yield from ((node, {}) for node in some_nodes())
        awaited = [(one.node, record.variables) for record in monitor.pending(limit=1) for one in record.awaited]
        yield from (random.choice(awaited) for _ in range(_TRIES if awaited else 0))

    def hopeful(monitor: Engine) -> Json:
        """Return an awaited event that avoids ⊥, if one is found."""
        event: Json = {}
        for node, variables in candidates(monitor):
            event = fitted(node, variables)
            if monitor.fork().step(event) is not Verdict.FALSE:
                break
        return event

    found: list[Walk] = []
    taken: list[Json] = []
    while events > 0 and process_time() < until:
        doomed = semantics.ends and len(found) % _DOOMED == _DOOMED - 1  # `scattered` and `consecutive` have no ⊥
        doom = random.randrange(len(found[-1].events)) if doomed else LONGEST
        monitor, judging, taken, verdicts = start.fork(), judge.fork(), [], list[Verdict]()
        with suppress(RvaftError):  # too many partial matches for the engine; keep the events so far
            while len(taken) < min(events, LONGEST) and not judging.verdict.final and process_time() < until:
                event = hopeless(monitor) if len(taken) >= doom else None
                if event is None:
                    noise = semantics is not Semantics.STRICT and random.random() < _NOISE
                    event = now({_FOREIGN: len(taken)}) if noise else hopeful(monitor)
                verdicts.append(judging.step(event))
                monitor = start.fork() if monitor.step(event).final else monitor
                taken.append(event)
        if not taken:
            break
        found.append(Walk(tuple(taken), tuple(verdicts)))
        events -= len(taken)
    return tuple(found)
