"""What is compared (trees, semantics, languages), and the measurement of sizes, seconds and events per second.

Everything is measured in processes that are forked for it. Each starts from this one, with
everything imported, so that no cell gains from what another left in memory; one that takes too long
or too much is ended, and costs no other. Times are those of the processor: what others do while
this one waits is not counted.
"""

import gc
import hashlib
import math
import multiprocessing
import os
import resource
import signal
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from copy import copy
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import cache, cached_property, lru_cache, partial
from importlib.metadata import version
from itertools import product
from multiprocessing.connection import Connection
from random import Random
from statistics import median
from time import process_time, thread_time
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace

from cross_check.generate.times import SECOND, TODAY, timed
from cross_check.generate.values import fitting, interesting_values
from cross_check.participants import loaded
from cross_check.results import DETECTIONS_ONLY, Status, raised, reason
from rvaft.api import loads, resolve_semantics
from rvaft.backend import Metrics, all_backends, backend
from rvaft.engine import Engine
from rvaft.errors import OptionError, RvaftError
from rvaft.language.printer import dumps
from rvaft.model.nodes import Gate, Node
from rvaft.model.patterns import Anything, Literal, substitute
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor
from rvaft.support.processes import Killed, in_processes

MAX_ARITY: Final = 12  # the most children of a gate, unless more are asked for
ROUNDS: Final = 3  # how often whatever is timed is done, at most
PATIENCE: Final = 0.2  # seconds after which it is not done again
READERS: Final = 4  # how many readers that know nothing run a walk each, at most
WALKING: Final = 30.0  # seconds for finding the events of a tree; they are the engine's, and no language pays for them
SLACK: Final = 10  # how much longer than of the processor something may take by the clock, for each process at a time
GRACE: Final = 5.0  # seconds by the clock that a process may take beside
SIZES: Final = ("symbols", "subformulas", "states", "edges")  # what is counted of a text
ONLY_EMITTED: Final = "only emitted: nothing here runs its texts"
EVENTS: Final = 240  # events of all walks together; the last walk ends with them
LONGEST: Final = 60  # events after which a walk ends without a verdict
_FORK: Final = 0.01  # seconds that a reader in a process of its own takes beside reading, about
_NOISE: Final = 0.1  # how often an event fits nothing
_DOOMED: Final = 4  # one walk of so many is led to where no hope is left
_TRIES: Final = 16  # how many events to try for one that leaves hope, or none
_FOREIGN: Final = "none of the tree's"
_OTHERS: Final = ("top or all rows some; all and a b; rows sand c d e; some 2of3 f g h;", "top sand a b c;")
"""Trees that have nothing of what is measured; the second is for a language that cannot say the first."""
_SCALARS: Final = (str, int, float, bool, type(None))


@dataclass(frozen=True)
class Subject:
    """A tree with the name that reports call it by.

    `gate` and `threshold` are those of a gate over leaves, None for any other tree.
    """

    name: str
    tree: RVAFT
    gate: Gate | None = None
    threshold: int | None = None

    @cached_property
    def digest(self) -> str:
        """Some digits of a hash of the tree's canonical text, by which the tree is known again."""
        return hashlib.sha256(dumps(self.tree).encode(errors="surrogateescape")).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Cell:
    """One thing to measure: a tree under a semantics in a language."""

    subject: Subject
    semantics: Semantics
    language: str


def gate_subjects(gates: Iterable[Gate] = Gate, max_arity: int = MAX_ARITY) -> Iterator[Subject]:
    """Each gate over 1 to `max_arity` leaves with default events, no event of two of them; VOT with every threshold.

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
    """All backends but those whose texts are another backend's texts in another form; the unfaithful ones come last."""
    found = {name: loaded(name) for name in all_backends()}  # the rows of who cannot be loaded say why
    languages = [name for name, one in found.items() if one is None or not one.form_of]
    return tuple(sorted(languages, key=lambda name: ((one := found[name]) is None or not one.faithful, name)))


def cells_of(
    subjects: Iterable[Subject], semantics: Iterable[Semantics] | None, languages: Iterable[str]
) -> tuple[Cell, ...]:
    """Every tree under every semantics, or with None the one that the tree means, in every language, in this order.

    Raises `OptionError` for a comparison of nothing, and for two trees that reports would call the same.
    """
    parts = product(subjects, (None,) if semantics is None else semantics, languages)
    cells = tuple(Cell(subject, resolve_semantics(subject.tree, one), language) for subject, one, language in parts)
    for name, count in Counter(subject.name for subject in dict.fromkeys(cell.subject for cell in cells)).items():
        if count > 1:
            raise OptionError(
                f"{count} trees are called {name}: rename a file, or write its path in another way, as ./{name}"
            )
    if not cells:
        raise OptionError("nothing to compare: name at least one tree or gate, one semantics and one language")
    return cells


class Outcome(StrEnum):
    """How it ended. These words are never blurred.

    What a language cannot say is not what was too much, or took too long.
    """

    OK = "ok"
    NOT_EXPRESSIBLE = "not expressible"
    TOO_LARGE = "too large"
    TIMEOUT = "timeout"
    TOOL_MISSING = "tool missing"
    FAILED = "could not run"


@dataclass(frozen=True, slots=True)
class Settings:
    """What a measurement depends on beside its cell.

    `limit` is that of translations, in the unit of the language (None: the backend's own);
    `timeout` is in seconds of the processor, for everything that is done in one cell, and `memory`
    in megabytes (2**20 bytes) for each process of it; `seed` is that of the events.
    """

    limit: int | None = None
    timeout: float = 60.0
    seed: int = 0
    memory: int = 4096


class Measurement(msgspec.Struct, frozen=True):
    """One cell and what was measured, in the columns of the CSV file, which docs/compare.md explains.

    What is not known is None.

    `result` says how the translation ended, `run` how reading its text and running events did.
    `seconds` is the median time of a translation; `again_per_second` the median speed of one reader
    that runs all `events` again, and `events_per_second` that of readers that have met nothing
    before, over `first_events`; `differing` counts the `walks` that got other verdicts than the
    tree demands. A language that tells detections alone gets whole traces, and for
    `again_per_second` all of them in one question.
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

    @property
    def key(self) -> tuple[object, ...]:
        """What two measurements share that may stand for each other, but for the time and memory that they may take."""
        return (self.tree, self.digest, self.semantics, self.language, self.limit, self.seed, self.version)

    def serves(self, wanted: "Measurement") -> bool:
        """Whether this answers for another of the same key: nothing was missing, neither tools nor
        what the other has more of.
        """
        if self.key != wanted.key or self.ended is None or self.broken:
            return False
        ends = (self.result, self.run)
        late = Outcome.TIMEOUT in ends and self.timeout < wanted.timeout
        large = Outcome.TOO_LARGE in ends and (self.memory or 0) < (wanted.memory or 0)
        return not (late or large)

    @property
    def broken(self) -> bool:
        """Whether it says nothing about the language, only about what is installed here."""
        return any(end in (Outcome.TOOL_MISSING, Outcome.FAILED) for end in (self.result, self.run))

    @property
    def detections_only(self) -> bool:
        """Whether its text was run by a program that never says ⊥."""
        return self.run_reason.startswith(DETECTIONS_ONLY)

    @property
    def only_emitted(self) -> bool:
        """Whether there is a text that nothing here runs."""
        return self.run_reason == ONLY_EMITTED

    @property
    def ended(self) -> Outcome | None:
        """How the translation ended, or, where it did well, how reading and running its text ended."""
        return self.run if self.result is Outcome.OK else self.result


def unmeasured(cell: Cell, settings: Settings) -> Measurement:
    """The record of a cell before anything is measured."""
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
    """The outcome of work that has no result, and why, in one line."""


def measured(
    cells: Sequence[Cell], settings: Settings, *, jobs: int = 1
) -> Generator[tuple[Cell, Measurement], None, None]:
    """The measurements of cells in their order, each as soon as it is known; close the iterator to stop early.

    With more than one of `jobs` processes at a time their times disturb each other.
    """
    for language, semantics in dict.fromkeys((cell.language, cell.semantics) for cell in cells):
        _warm_up(language, semantics)  # imports all that is needed, and translates the text that every fork begins with
    clock = SLACK * jobs * settings.timeout + GRACE

    @lru_cache(maxsize=1)
    def trodden(tree: RVAFT, semantics: Semantics) -> tuple[Walk, ...]:
        """All languages of a tree run the same."""
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
    """Told to stop, a process ends its own ones and is gone.

    An exception would be taken for a result, and the pool wait for ever.
    """
    for process in multiprocessing.active_children():
        process.kill()
    os._exit(1)


def _measured(cell: Cell, settings: Settings, clock: float, trodden: Sequence["Walk"]) -> Measurement:
    """Translate, then read and run the text; whatever a backend does of it is part of the record."""
    record, left = unmeasured(cell, settings), settings.timeout

    def isolated(work: Callable[[], Any]) -> Any:
        nonlocal left
        result, used = _isolated(work, left, clock, settings)
        left = max(left - used, 0.001)
        return result

    try:
        text, sizes, seconds = isolated(partial(_translated, cell, settings.limit))
    except _Unmeasurable as end:
        return replace(record, result=end.args[0], reason=end.args[1])
    found = {name: getattr(sizes, name) for name in SIZES}
    found |= {"characters": len(text), "seconds": _rounded(seconds)}
    record = replace(record, result=Outcome.OK, run=Outcome.OK, **found)
    if not backend(cell.language).readable:
        return replace(record, run_reason=ONLY_EMITTED)
    try:
        first, again = isolated(partial(_ran_again, cell, text, trodden))
        record = replace(
            record,
            run_reason=_remark(first, len(trodden)),
            read_seconds=_rounded(first.reading),
            events=first.events,
            first_events=0,
            again_per_second=_speed(first.events, again),
            walks=first.walks,
            differing=first.differing,
        )
        readers = min(READERS, len(trodden), 1 + int(PATIENCE / (first.reading + _FORK)))
        step = -(-len(trodden) // readers) if readers else 1
        fresh = [isolated(partial(_ran, cell, text, [walk])) for walk in trodden[::step]]
    except _Unmeasurable as end:
        return replace(record, run=end.args[0], run_reason=end.args[1])
    events = sum(one.events for one in fresh)
    return replace(record, first_events=events, events_per_second=_speed(events, sum(one.seconds for one in fresh)))


def _remark(ran: "Run", walks: int) -> str:
    """What is to be said of a run that ended well; most often nothing."""
    if not walks:
        return "no events: the tree is too much for the engine, which is to find them"
    open_ones = f", {walks - ran.walks} of {walks} traces are left open" if ran.walks < walks else ""
    return f"{DETECTIONS_ONLY}{open_ones}" if ran.whole else ""


def _isolated(work: Callable[[], object], seconds: float, clock: float, settings: Settings) -> tuple[Any, float]:
    """What the work gives in a process of its own, and the seconds that it used; raises `_Unmeasurable`."""
    context = multiprocessing.get_context("fork")
    heard, said = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(work, said, seconds, clock, settings), daemon=True)
    # Told to stop in the middle of a fork, this process would leave the other one running, or
    # complain of what the fork has to do.
    open_signals = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    process.start()
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, open_signals)
        said.close()  # the process has its own; when that is closed, it has ended
        with heard:
            result, used = heard.recv()
    except EOFError:
        process.join()
        code = process.exitcode or 0
        limits = {-signal.SIGPROF: f"{settings.timeout:g} s", -signal.SIGALRM: f"{clock:g} s by the clock"}
        if code in limits:
            raise _Unmeasurable(Outcome.TIMEOUT, f"not within {limits[code]}") from None
        how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
        raise _Unmeasurable(Outcome.FAILED, f"the process that measured it was killed ({how})") from None
    finally:
        process.kill()
        process.join()
    if isinstance(result, _Unmeasurable):
        raise result
    return result, used


def _work(work: Callable[[], object], said: Connection, seconds: float, clock: float, settings: Settings) -> None:
    """Do it within bounds of processor time, time by the clock and memory, and say what came of it.

    In a process of its own.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, clock)
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    wanted = settings.memory * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))
    # what is there from before is never looked at: a collection would copy all of it, in the middle
    # of a run
    gc.freeze()
    result: object
    try:
        result = work()
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_AS, (most, most))  # to have room for telling that it was met
        result = _Unmeasurable(Outcome.TOO_LARGE, f"megabytes of memory (limit {settings.memory})")
    except Exception as error:  # noqa: BLE001
        known = raised(error)
        result = _Unmeasurable(Outcome(Status.of(known)), reason(known))
    if process_time() > seconds:  # the system looks at its clock only now and then
        signal.raise_signal(signal.SIGPROF)
    said.send((result, process_time()))


def _warm_up(language: str, semantics: Semantics) -> None:
    """Read and run another tree, which has all gates but knows nothing of what is measured.

    A fork copies each page of memory that it writes to first, and Python writes to whatever it
    looks at: that is no part of any time.
    """
    with suppress(Exception):  # whatever is wrong with a backend shows in its rows
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
    """The text of the first of the other trees that the language can say; empty where it can say none."""
    for tree in map(loads, _OTHERS):
        with suppress(RvaftError):
            return backend(language).translate(tree, semantics).text
    return ""


def _translated(cell: Cell, limit: int | None) -> tuple[str, Metrics, float]:
    """The text, its sizes, and the median seconds of a translation."""
    times: list[float] = []
    while not times or (len(times) < ROUNDS and sum(times) < PATIENCE):
        tree = copy(cell.subject.tree)  # a fresh one: nothing that a tree remembers of itself saves time
        start = thread_time()
        made = backend(cell.language).translate(tree, cell.semantics, limit=limit)
        times.append(thread_time() - start)
    return made.text, made.metrics, median(times)


class Run(NamedTuple):
    """What reading a text took, and running so many events in so many walks, of which some got other verdicts.

    `whole` where a program looks at traces as a whole.
    """

    reading: float
    seconds: float
    events: int
    walks: int
    differing: int
    whole: bool = False


def _ran(cell: Cell, text: str, trodden: Sequence["Walk"]) -> Run:
    """Read the text and run the walks, each from the start up to its final verdict.

    What a reader remembers of one helps it in the next.
    """
    _warm_up(cell.language, cell.semantics)
    start = thread_time()
    reader = backend(cell.language).read(text)
    reading, seconds, events, differing = thread_time() - start, 0.0, 0, 0
    if isinstance(reader, DetectionMonitor):
        asked = [walk for walk in trodden if not reader.left_open(walk.events)]
        with no_collection():
            start = thread_time()
            found = reader.first_detections([walk.events for walk in asked])
            seconds = thread_time() - start
        events = sum(len(walk.events) for walk in asked)
        differing = sum(number != walk.detection for number, walk in zip(found, asked, strict=True))
        return Run(reading, seconds, events, len(asked), differing, whole=True)
    for walk in trodden:
        monitor, got = reader.fork(), []
        with no_collection():
            start = thread_time()
            for event in walk.events:
                got.append(monitor.step(event))
                if monitor.verdict.final:  # what follows costs nothing and says nothing
                    break
            seconds += thread_time() - start
        events += len(got)
        differing += tuple(got) != walk.verdicts
    return Run(reading, seconds, events, len(trodden), differing)


def _ran_again(cell: Cell, text: str, trodden: Sequence["Walk"]) -> tuple[Run, float]:
    """The first run of all walks by one reader, and the median seconds of the later ones; of whole
    traces programs remember the answer, so that is the first.
    """
    first = _ran(cell, text, trodden)
    if first.whole:
        return first, first.seconds
    times = [first.seconds]
    while len(times) < 2 or (len(times) < ROUNDS and sum(times) < PATIENCE):
        times.append(_ran(cell, text, trodden).seconds)
    return first, median(times[1:])


@contextmanager
def no_collection() -> Iterator[None]:
    """The collector of cyclic garbage rests meanwhile, as in `timeit`."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _speed(events: int, seconds: float) -> float | None:
    return _rounded(events / seconds) if events and seconds else None


def _rounded(number: float) -> float:
    return float(f"{number:.4g}")  # more would only look exact


@dataclass(frozen=True, slots=True)
class Walk:
    """A trace that is led through the tree, and the verdict after each of its events."""

    events: tuple[Json, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def detection(self) -> int | None:
        """The number of the event that is the detection, from 1; None where there is none."""
        return self.verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in self.verdicts else None


def walks(
    tree: RVAFT, semantics: Semantics, seed: int, *, events: int = EVENTS, seconds: float = math.inf
) -> tuple[Walk, ...]:
    """So many events in traces that each end with a final verdict or when they are long; fewer
    where the engine gives up or takes longer.

    A random trace alone would soon be hopeless in most trees, and then no monitor has anything to
    do. So each event is one that the engine waits for, with values under which hope remains if some
    are found; one in ten fits nothing, where that does no harm. One walk in four is led on purpose,
    somewhere on its way, to where no hope is left, if the tree has such a place: a text has to say
    that, too. Where the tree reads times, events are a second apart.
    """
    until, judge = process_time() + seconds, Engine(tree, semantics)
    # under consecutive there is always hope: the way is led where the match goes on that was begun
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
        """An event that leaves no hope, if one is found: most often one of the tree's own."""
        tried = [fitted(node, {}) for node in some_nodes()]
        tried.insert(random.randrange(len(tried) + 1), now({_FOREIGN: 0}))
        return next((event for event in tried if monitor.fork().step(event) is Verdict.FALSE), None)

    def candidates(monitor: Engine) -> Iterator[tuple[str, Mapping[str, Json]]]:
        """Nodes whose events to try, with values that are bound.

        What is waited for is only asked where trying is no cheaper.
        """
        if semantics is not Semantics.SCATTERED and not tree.variables:  # a wrong guess shows at once
            yield from ((node, {}) for node in some_nodes())
        awaited = [(one.node, record.variables) for record in monitor.pending(limit=1) for one in record.awaited]
        yield from (random.choice(awaited) for _ in range(_TRIES if awaited else 0))

    def hopeful(monitor: Engine) -> Json:
        """An event that is waited for, and, if one is found, leaves hope."""
        event: Json = {}
        for node, variables in candidates(monitor):
            event = fitted(node, variables)
            if monitor.fork().step(event) is not Verdict.FALSE:
                break
        return event

    found: list[Walk] = []
    taken: list[Json] = []
    while events > 0 and process_time() < until:
        doomed = semantics.ends and len(found) % _DOOMED == _DOOMED - 1  # there hope never ends
        doom = random.randrange(len(found[-1].events)) if doomed else LONGEST
        monitor, judging, taken, verdicts = start.fork(), judge.fork(), [], list[Verdict]()
        with suppress(RvaftError):  # more partial matches than the engine follows; what there is will do
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
