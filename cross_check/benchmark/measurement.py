"""The measurement of a cell: sizes, seconds and events per second, taken in processes that are forked for it.

Every process starts from this one, with everything imported, so that no cell gains from what another left in memory; one that takes
too long or too much is ended, and costs no other. Times are those of the processor: what others do while this one waits is not counted.
"""

import gc
import multiprocessing
import resource
import signal
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from copy import copy
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib.metadata import version
from multiprocessing.connection import Connection
from statistics import median
from time import process_time, thread_time
from typing import Any, Final, NamedTuple, TypeVar

import msgspec
from msgspec.structs import replace

from cross_check.benchmark.workload import Cell, Walk, walks
from rvaft.api import loads
from rvaft.backend import Metrics, backend
from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from rvaft.support.processes import Killed, in_processes

Result = TypeVar("Result")

ROUNDS: Final = 5
"""How often whatever is timed is done, at most."""
PATIENCE: Final = 0.4
"""Seconds after which it is not done again."""
READERS: Final = 12
"""How many readers that know nothing run a walk each, at most."""
WALKING: Final = 30.0
"""Seconds for finding the events of a tree; they are the engine's, and no language pays for them."""
SLACK: Final = 10
"""How much longer than of the processor something may take by the clock, for each of the processes that share the machine."""
GRACE: Final = 5.0
"""Seconds by the clock that a process may take beside."""
_FORK: Final = 0.01
"""Seconds that a reader in a process of its own takes beside reading, about."""
_DIGITS: Final = 4
"""Significant digits of times; more would only look exact."""


class Outcome(StrEnum):
    """How it ended. These words are never blurred: what a language cannot say is not what was too much, or took too long."""

    OK = "ok"
    NOT_EXPRESSIBLE = "not expressible"
    TOO_LARGE = "too large"
    TIMEOUT = "timeout"
    TOOL_MISSING = "tool missing"
    FAILED = "could not run"

    @property
    def broken(self) -> bool:
        """Whether it says nothing about the language, only about what is installed here."""
        return self in (Outcome.TOOL_MISSING, Outcome.FAILED)


@dataclass(frozen=True, slots=True)
class Settings:
    """What a measurement depends on beside its cell.

    `limit` is that of translations, in the unit of the language (None: the backend's own); `timeout` is in seconds of the processor, for
    everything that is done in one cell, and `memory` in megabytes (2**20 bytes) for each process of it; `seed` is that of the events.
    """

    limit: int | None = None
    timeout: float = 60.0
    seed: int = 0
    memory: int = 4096


class Measurement(msgspec.Struct, frozen=True):
    """One cell and what was measured; the columns of the CSV file are these fields.

    `tree` is a gate with its children (`and 3`, `vot 2/3`) or the path of a tree; `gate`, `children` and `threshold` are those of a
    gate over leaves. `result` says how the translation ended, and `reason` why. The sizes are those of `Metrics`; `characters` is the
    length of the text, header and all; `seconds` the median time of a translation.

    `run` and `run_reason` say the same of reading the text and running events by the language's own reader: `read_seconds` is the time to
    read it, `events` how many were run, in `walks` traces, and `differing` how many of the traces got other verdicts than the tree
    demands. `events_per_second` is the speed of readers that have met nothing: each reads the text and runs one trace, in a process of
    its own, and `first_events` is how many events these are. `again_per_second` is the median speed when one reader runs all again.
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
        """Whether this answers for another of the same key: nothing was missing, neither tools nor what the other has more of."""
        ends = (self.result, self.run)
        if self.key != wanted.key or self.ended is None or any(end is not None and end.broken for end in ends):
            return False
        late = Outcome.TIMEOUT in ends and self.timeout < wanted.timeout
        large = Outcome.TOO_LARGE in ends and (self.memory or 0) < (wanted.memory or 0)
        return not (late or large)

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
        subject.children,
        subject.threshold,
        cell.semantics,
        cell.language,
        limit=settings.limit,
        timeout=settings.timeout,
        seed=settings.seed,
        digest=subject.digest,
        version=version("rvaft"),
        memory=settings.memory,
    )


class Failure(NamedTuple):
    """How the work of a process ended where it has no result, and why, in one line."""

    outcome: Outcome
    reason: str


def failure(error: Exception, settings: Settings) -> Failure:
    """What an error of a backend means.

    >>> failure(TooLarge("states", limit=5), Settings())
    Failure(outcome=<Outcome.TOO_LARGE: 'too large'>, reason='states (limit 5)')
    """
    match error:
        case MemoryError():
            return Failure(Outcome.TOO_LARGE, f"megabytes of memory (limit {settings.memory})")
        case NotExpressible():
            return Failure(Outcome.NOT_EXPRESSIBLE, " ".join(error.reason.split()))
        case TooLarge():
            return Failure(Outcome.TOO_LARGE, f"{error.what} (limit {error.limit})")
        case ToolMissing():
            return Failure(Outcome.TOOL_MISSING, str(error))
        case RvaftError():
            return Failure(Outcome.FAILED, str(error).splitlines()[0])
        case _:
            return Failure(Outcome.FAILED, " ".join(f"{type(error).__name__}: {error}".split()))


def measured(
    cells: Sequence[Cell], settings: Settings, *, jobs: int = 1
) -> Generator[tuple[Cell, Measurement], None, None]:
    """The measurements of cells in their order, each as soon as it is known; close the iterator to stop early.

    With more than one of `jobs` processes at a time their times disturb each other.
    """
    for language, semantics in dict.fromkeys((cell.language, cell.semantics) for cell in cells):
        _warm_up(language, semantics)  # imports all that is needed, and translates the text that every fork begins with
    laboratory = _Laboratory(settings, jobs)
    if jobs == 1:
        yield from ((cell, laboratory.measure(cell)) for cell in cells)
        return
    with closing(in_processes(laboratory.measure_below, cells, jobs=jobs)) as running:
        for cell, found in running:
            if isinstance(found, Killed):
                reason = "the process that measured it was killed"
                yield cell, replace(unmeasured(cell, settings), result=Outcome.FAILED, reason=reason)
            else:
                yield cell, found


class _Sizes(NamedTuple):
    """What a translation gave, and the seconds it took."""

    text: str
    metrics: Metrics
    seconds: float


class _Ran(NamedTuple):
    """One reading of a text and one run of some walks: the events and seconds of each walk up to its final verdict."""

    reading: float
    runs: tuple[tuple[int, float], ...]
    differing: int

    @property
    def seconds(self) -> float:
        return sum(seconds for _, seconds in self.runs)


class _Laboratory:
    """Measures cells one after the other."""

    def __init__(self, settings: Settings, jobs: int) -> None:
        self._settings = settings
        self._slack = SLACK * jobs
        self._walks_of: tuple[object, ...] = ()
        self._walks: tuple[Walk, ...] = ()
        self._left = 0.0

    def measure_below(self, cell: Cell) -> Measurement:
        """The same in a process that may be told to stop: it ends its own processes first."""
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        return self.measure(cell)

    def measure(self, cell: Cell) -> Measurement:
        """Translate, then read and run the text; whatever a backend does of it is part of the record."""
        record = unmeasured(cell, self._settings)
        trodden = self._trodden(cell)
        self._left = self._settings.timeout
        made = self._isolated(lambda: self._translated(cell))
        if isinstance(made, Failure):
            return replace(record, result=made.outcome, reason=made.reason)
        record = replace(
            record,
            result=Outcome.OK,
            symbols=made.metrics.symbols,
            subformulas=made.metrics.subformulas,
            states=made.metrics.states,
            edges=made.metrics.edges,
            characters=len(made.text),
            seconds=_rounded(made.seconds),
        )
        if not backend(cell.language).readable:
            return replace(record, run=Outcome.OK, run_reason="only emitted: nothing here runs its texts")
        known = self._isolated(lambda: _ran_again(cell, made.text, trodden))
        if isinstance(known, Failure):
            return replace(record, run=known.outcome, run_reason=known.reason)
        first, later = known
        events = sum(events for events, _ in first.runs)
        record = replace(
            record,
            run=Outcome.OK,
            run_reason="" if trodden else "no events: the tree is too much for the engine, which is to find them",
            read_seconds=_rounded(first.reading),
            events=events,
            first_events=0,
            again_per_second=_speed(events, later),
            walks=len(trodden),
            differing=first.differing,
        )
        readers = min(READERS, len(trodden), 1 + int(PATIENCE / (first.reading + _FORK)))
        fresh = list(first.runs[:1])  # what that reader has run before anything else
        for walk in trodden[-(-len(trodden) // readers) :: -(-len(trodden) // readers)] if readers else ():
            ran = self._isolated(lambda walk=walk: _ran(cell, made.text, [walk]))  # type: ignore[misc]
            if isinstance(ran, Failure):
                return replace(record, run=ran.outcome, run_reason=ran.reason)
            fresh += ran.runs
        events = sum(events for events, _ in fresh)
        speed = _speed(events, sum(seconds for _, seconds in fresh))
        return replace(record, first_events=events, events_per_second=speed)

    def _trodden(self, cell: Cell) -> tuple[Walk, ...]:
        """The walks of the tree, which all of its languages run; none where the engine cannot find them."""
        if self._walks_of != (asked := (cell.subject.digest, cell.semantics)):
            self._walks_of, self._left = asked, 2 * WALKING
            tree, seed = cell.subject.tree, self._settings.seed
            found = self._isolated(lambda: walks(tree, cell.semantics, seed, seconds=WALKING))
            self._walks = () if isinstance(found, Failure) else found
        return self._walks

    def _translated(self, cell: Cell) -> _Sizes:
        language = backend(cell.language)

        def translate() -> tuple[float, Any]:
            tree = copy(cell.subject.tree)  # a fresh one: nothing that a tree remembers of itself saves time
            start = thread_time()
            made = language.translate(tree, cell.semantics, limit=self._settings.limit)
            return thread_time() - start, made

        first, made = translate()
        return _Sizes(made.text, made.metrics, median(_repeated(first, lambda: translate()[0])))

    def _isolated(self, work: Callable[[], Result]) -> Result | Failure:
        """What the work gives in a process of its own, which may use the time that is left to the cell."""
        clock = self._slack * self._settings.timeout + GRACE
        context = multiprocessing.get_context("fork")
        heard, said = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(work, said, self._left, clock, self._settings), daemon=True)
        # An interrupt between the fork and `try` would leave the process running on its own.
        open_signals = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
        process.start()
        try:
            signal.pthread_sigmask(signal.SIG_SETMASK, open_signals)
            said.close()  # the process has its own; when that is closed, it has ended
            with heard:
                result, used = heard.recv()
        except EOFError:
            process.join()
            return self._ended(process.exitcode or 0, clock)
        finally:
            process.kill()
            process.join()
        self._left = max(self._left - used, 0.001)
        found: Result | Failure = result
        return found

    def _ended(self, code: int, clock: float) -> Failure:
        """How a process ended that has said nothing."""
        if code == -signal.SIGPROF:
            return Failure(Outcome.TIMEOUT, f"not within {self._settings.timeout:g} s")
        if code == -signal.SIGALRM:
            return Failure(Outcome.TIMEOUT, f"not within {clock:g} s by the clock")
        how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
        return Failure(Outcome.FAILED, f"the process that measured it was killed ({how})")


def _work(work: Callable[[], object], said: Connection, seconds: float, clock: float, settings: Settings) -> None:
    """Do it within bounds of processor time, time by the clock and memory, and say what came of it; in a process of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the parent to handle
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, clock)
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    wanted = settings.memory * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))
    gc.freeze()  # what is there from before is never looked at: a collection would copy all of it, in the middle of a run
    result: object
    try:
        result = work()
    except Exception as error:  # noqa: BLE001 (a backend of somebody else may fail in any way; the other cells still count)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))  # to have room for telling that it was met
        result = failure(error, settings)
    if process_time() > seconds:  # the system looks at its clock only now and then
        signal.raise_signal(signal.SIGPROF)
    with suppress(OSError):  # nobody listens any more
        said.send((result, process_time()))


def _warm_up(language: str, semantics: Semantics) -> None:
    """Read and run another tree, which has all gates but knows nothing of what is measured.

    A fork copies each page of memory that it writes to first, and Python writes to whatever it looks at: that is no part of any time.
    """
    with suppress(Exception):  # whatever is wrong with a backend shows in its rows
        reader = backend(language).read(_other_text(language, semantics))
        for start in range(6):
            monitor = reader.fork()
            for name in "cfadgb"[start:]:
                monitor.step({"event": name})


@cache
def _other_text(language: str, semantics: Semantics) -> str:
    tree = loads("top or all rows some; all and a b; rows sand c d e; some 2of3 f g h;")
    return backend(language).translate(tree, semantics).text


def _ran_again(cell: Cell, text: str, trodden: Sequence[Walk]) -> tuple[_Ran, float]:
    """The first run of all walks by one reader, and the median seconds of the later ones."""
    first = _ran(cell, text, trodden)
    again = _repeated(first.seconds, lambda: _ran(cell, text, trodden, warm=False).seconds, least=2)
    return first, median(again[1:])


def _ran(cell: Cell, text: str, trodden: Sequence[Walk], *, warm: bool = True) -> _Ran:
    """Read the text and run the walks, each from the start; what a reader remembers of one helps it in the next."""
    if warm:
        _warm_up(cell.language, cell.semantics)
    start = thread_time()
    reader = backend(cell.language).read(text)
    reading, runs, differing = thread_time() - start, [], 0
    for walk in trodden:
        monitor, got = reader.fork(), []
        with no_collection():
            start = thread_time()
            for event in walk.events:
                got.append(monitor.step(event))
                if monitor.verdict.final:  # what follows costs nothing and says nothing
                    break
            runs.append((len(got), thread_time() - start))
        differing += tuple(got) != walk.verdicts
    return _Ran(reading, tuple(runs), differing)


@contextmanager
def no_collection() -> Iterator[None]:
    """The collector of cyclic garbage rests meanwhile, as in `timeit`."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _repeated(first: float, again: Callable[[], float], *, least: int = 1) -> list[float]:
    times = [first]
    while len(times) < least or (len(times) < ROUNDS and sum(times) < PATIENCE):
        times.append(again())
    return times


def _speed(events: int, seconds: float) -> float | None:
    return _rounded(events / seconds) if events and seconds else None


def _rounded(number: float) -> float:
    return float(f"{number:.{_DIGITS}g}")
