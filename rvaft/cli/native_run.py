"""A run in which a compiled monitor replaces the joins of the engine.

Events are read as without `--native`. `NativeRun` passes each block of the log to the compiled monitor
before the block is read, and `NativeMatches` detects at the events that the compiled monitor named.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from io import BufferedIOBase, RawIOBase
from itertools import islice
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO, ClassVar, Final, NamedTuple, Protocol, Self, cast, runtime_checkable

import msgspec

from rvaft.api import monitor
from rvaft.backend import Specification, backend
from rvaft.cli import warn
from rvaft.core.engine_form import followed
from rvaft.core.fields_to_read import Scope, TreeReads
from rvaft.core.restriction import property_of
from rvaft.engine.compiled_tree import NOTHING, CompiledTree, EventClass, Reading, TreeLetters
from rvaft.engine.strategy import Strategy
from rvaft.errors import NotExpressible, OptionError, RvaftError, TooLarge, ToolFailed, TraceError
from rvaft.model.guards import Guard
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, JsonObject, finite_decimal
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Explanation, Pending, twin
from rvaft.readers.json_lines import decode, event_on
from rvaft.readers.log import BOM, LogReader
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import Key, KeyedTraces
from rvaft.stream.plan import TIME, MonitoringPlan
from rvaft.stream.run import TraceRun
from rvaft.stream.whole_log import Declined, EventCount, LogAnswer, Place, QueryEngine
from rvaft.support.files import SUFFIXES as COMPRESSED

BACKEND: Final = "c"
_ACCEPTED: Final[msgspec.json.Decoder[Json]] = msgspec.json.Decoder(float_hook=finite_decimal)
"""For lines that a native monitor has accepted, so that nothing is checked again."""
_HIT: Final = Reading(relevant=False, hits=(None,))
"""An event that some node may have."""


class MatchedLine(NamedTuple):
    """An event of a log: its number, its line, and the offset of the line in bytes."""

    number: int
    line: int
    offset: int


class CompiledLog(Protocol):
    """A compiled monitor of one log; `failure` is why it has no verdict from event `failed` on.

    A `TraceError` names the line only.
    """

    failed: int
    failure: RvaftError | None

    def read(self, data: bytes, *, ended: bool = False) -> Iterator[Sequence[tuple[int, int, int]]]:
        """Read a piece of the log, and yield the places of the events of each detection."""

    def read_file(self, stream: RawIOBase) -> Iterator[Sequence[tuple[int, int, int]]]:
        """Read a whole log, and yield the same."""

    @property
    def declined(self) -> str | None:
        """Why the counts are not those of the log, if they are not."""

    @property
    def total(self) -> int:
        """The number of events."""

    def group_counts(self) -> Iterator[tuple[int, Sequence[tuple[int, int, int]]]]:
        """Yield the number of events of each group, and the places of the first ones."""

    def key_counts(self) -> Iterator[tuple[int, tuple[int, int, int]]]:
        """Yield the number of events of each key and the place of the first one, then of those without a key."""

    @property
    def forgotten_keys(self) -> tuple[int, int, int]:
        """How many keys were forgotten, how many began too early after that, and the first event of these, or 0."""

    def close(self) -> None:
        """Release the memory of the monitor."""


@runtime_checkable
class Compiling(Protocol):
    """A backend that compiles monitors."""

    def keyed(self, key: Sequence[tuple[tuple[str, ...], tuple[str, ...]]]) -> Self:
        """Return a backend whose monitors regard each value of a key as a log of its own."""

    def counted(self, letters: Sequence[tuple[Pattern, Guard | None]], apart: Sequence[str], clock: str) -> Self:
        """Return a backend whose monitors count the events of a log in groups.

        Events of a group match the same patterns with their guards, and have the same texts in the
        fields `apart`. `clock` is the field of times where a tree declares none.
        """

    def repeating(self, by: str) -> Self:
        """Return a backend whose monitors repeat each value of a variable for itself."""

    def translate(self, tree: RVAFT, semantics: Semantics) -> Specification:
        """Return the tree as a text."""

    def program(self, text: str, warn: Callable[[str], object]) -> AbstractContextManager[Path]:
        """Yield a compiled program, which may be removed once it runs."""

    def native_log(
        self, text: str, *, keys: int, repeat: bool, forgets: bool, warn: Callable[[str], object]
    ) -> CompiledLog:
        """Return a new monitor of one log, which forgets keys only with `forgets`."""


def compiling() -> Compiling:
    """Return the backend that compiles monitors; raises `UnknownBackend` and `ToolFailed`."""
    found = backend(BACKEND)
    if not isinstance(found, Compiling):
        raise ToolFailed(f"the backend {BACKEND}", reason="it compiles no monitors")
    return found


def refused(failure: TraceError, log: BinaryIO) -> TraceError:
    """Return the error of the reader for the line of a failure; the same if the reader accepts it."""
    line = next(islice(log, (failure.line or 1) - 1, None), b"").removeprefix(BOM).removesuffix(b"\n")
    try:
        event_on(line, failure.file, failure.line or 1, None)
    except TraceError as error:
        return error
    return failure


def _accepted(line: bytes, reads: Scope) -> JsonObject:
    """Return the event of a line that a native monitor has accepted."""
    line = line.removeprefix(BOM)
    try:
        return cast("JsonObject", _ACCEPTED.decode(line))
    except (msgspec.DecodeError, RecursionError):  # NaN, or a lone surrogate that is not read
        return cast("JsonObject", decode(line.rstrip(b"\r\n"), reads=reads))


class MatchExplainer:
    """Explains detections by the engine, which reads only the events of the match."""

    def __init__(self, part: RVAFT) -> None:
        self._start = monitor(part, semantics=Semantics.STRICT)  # of nothing but the events of a match
        self._reads = TreeReads(part if part.part_of is None else part.part_of.tree)

    def explained(self, log: BinaryIO, places: Sequence[MatchedLine]) -> tuple[Explanation, dict[int, Json]]:
        """Return the match of the events at these places of a log, and the events."""
        events, engine = dict[int, Json](), self._start.fork()
        for number, _, offset in places:
            log.seek(offset)
            events[number] = _accepted(log.readline(), self._reads)
        verdicts, numbers = list(engine.run([*events.values()])), [*events]
        found = engine.explanation
        if found is None or verdicts.index(Verdict.TRUE) < len(verdicts) - 1:
            raise ToolFailed("the native monitor", reason=f"the engine has no match at event {numbers[-1]}")
        matched = tuple(one._replace(event=numbers[one.event - 1]) for one in found.matched)
        return replace(found, matched=matched), events


def _note_forgotten(keys: KeyedTraces, log: CompiledLog) -> None:
    keys.note_forgotten(log.forgotten_keys)


class _Fed(BufferedIOBase):
    """A stream that passes each piece to `feed` before it returns it, with b"" at the end.

    With `ahead` another thread reads and passes the next piece in the meantime.
    """

    def __init__(self, stream: BinaryIO, feed: Callable[[bytes], object], ahead: ThreadPoolExecutor | None) -> None:
        self.fileobj = getattr(stream, "fileobj", stream)
        self._stream = cast("BufferedIOBase", stream)
        self._feed = feed
        self._ahead = ahead
        self._next: Future[bytes] | None = None

    def _piece(self, size: int) -> bytes:
        data = self._stream.read1(size)
        self._feed(data)
        return data

    def read1(self, size: int = -1) -> bytes:
        """Return the next bytes."""
        data = self._piece(size) if self._next is None else self._next.result()
        self._next = self._ahead.submit(self._piece, size) if self._ahead is not None and data else None
        return data

    def readline(self, size: int | None = -1) -> bytes:
        """Return the rest of a line."""
        data = self._stream.readline(size)
        self._feed(data)
        if data and not data.endswith(b"\n") and (size is None or size < 0 or len(data) < size):
            self._feed(b"")  # the last line has no newline
        return data


class NativeRun:
    """Monitors traces one after the other; `part` is the monitored tree.

    With `by`, each value of a variable repeats for itself. Raises the errors of `translate`; `begin` raises those of
    the compiler.
    """

    def __init__(self, part: RVAFT, *, key: Key | None, keys: int, repeat: bool, by: str | None) -> None:
        fields = () if key is None else tuple(((one.text,), one.path) for one in key.fields)
        self._backend = compiling().keyed(fields)
        if by is not None:
            self._backend = self._backend.repeating(by)
        self.keyed = key is not None
        self._part = part
        self._text = self._backend.translate(part, Semantics.SCATTERED).text
        self._keys, self._repeat = keys, repeat
        self._explainer = MatchExplainer(part)
        self._remedy = property_of(part).remedy
        self._found: dict[int, Sequence[MatchedLine]] = {}
        self._log: CompiledLog | None = None
        self._copy: BinaryIO | None = None
        self._name = ""
        self.buffer = EventBuffer()
        """The buffer to which the events of matches are added."""

    @contextmanager
    def trace(self, name: str, file: Path | None, stream: BinaryIO, run: TraceRun) -> Iterator[BinaryIO]:
        """Yield the stream to read the trace `name` from; `file` has the same bytes, or is None.

        Matched events are read from the file, or from a temporary copy of the stream, into the buffer of the run.
        """
        self._log = self._new_log(forgets=run.may_forget_keys)
        self._found.clear()
        self._name = name
        self.buffer = run.buffer
        if run.keys is not None:
            run.keys.follows_native = True
        with ExitStack() as stack:
            stack.callback(self._log.close)
            if run.keys is not None:
                stack.callback(_note_forgotten, run.keys, self._log)
            if file is None:
                self._copy = cast("BinaryIO", stack.enter_context(TemporaryFile()))
                yield cast("BinaryIO", _Fed(stream, self._feed_and_copy, None))
            else:
                self._copy = stack.enter_context(file.open("rb"))
                yield cast("BinaryIO", _Fed(stream, self._feed, stack.enter_context(ThreadPoolExecutor(1))))
            if self._log.failure is not None:
                raise self._named(self._log.failure)
        if self._found:
            raise ToolFailed("the native monitor", reason=f"event {min(self._found)} is no detection of the engine")

    def engine(self, plan: MonitoringPlan) -> "NativeLogs | None":
        """Return the engine that reads whole logs by the compiled monitor alone, or None if it does not know all."""
        types = plan.monitors.types
        if types.tree.assumes - {Assumption.ORDER} or plan.strict_json:
            return None
        letters = [(letter.pattern, letter.when) for _, _, letter in types.letters]
        try:
            counting = self._backend.counted(letters, types.discriminators.fields, TIME)
            self._text = counting.translate(self._part, Semantics.SCATTERED).text
        except NotExpressible:  # a test of an event that no match uses
            return None
        return NativeLogs(plan, self)

    def answer(self, path: Path) -> "NativeAnswer":
        """Return what the compiled monitor finds in a file; raises `Declined` where it may not know all."""
        log = self._new_log(forgets=True)
        with ExitStack() as stack:
            stack.callback(log.close)
            self._log, self._name = log, str(path)
            self._found.clear()
            with path.open("rb", buffering=0) as stream:
                self._note(log.read_file(stream))
            if log.failure is not None or log.declined is not None:
                raise Declined(log.declined or str(log.failure))
            self._copy = stack.enter_context(path.open("rb"))
            return NativeAnswer(self, log, self._copy, self._found, stack.pop_all())

    def _new_log(self, *, forgets: bool) -> CompiledLog:
        return self._backend.native_log(self._text, keys=self._keys, repeat=self._repeat, forgets=forgets, warn=warn)

    def _feed(self, data: bytes) -> None:
        assert self._log is not None, "the trace has begun"
        self._note(self._log.read(data, ended=not data))

    def _note(self, detections: Iterable[Sequence[tuple[int, int, int]]]) -> None:
        for places in detections:
            self._found[places[-1][0]] = [MatchedLine(*one) for one in places]

    def _feed_and_copy(self, data: bytes) -> None:
        assert self._copy is not None, "the trace has begun"
        self._copy.seek(0, 2)
        self._copy.write(data)
        self._feed(data)

    def _named(self, failure: RvaftError) -> RvaftError:
        if isinstance(failure, TooLarge) and self._remedy and self._remedy not in getattr(failure, "__notes__", ()):
            failure.add_note(self._remedy)
        if self._copy is None or not isinstance(failure, TraceError):
            return failure
        self._copy.seek(0)
        return refused(TraceError(failure.message, file=self._name, line=failure.line), self._copy)

    def match(self, number: int) -> Sequence[MatchedLine]:
        """Return the events of the detection at this event, or (); raises why there is no verdict."""
        log = self._log
        if log is not None and log.failure is not None and number >= log.failed:
            raise self._named(log.failure)
        return self._found.pop(number, ())

    def explanation(self, places: Sequence[MatchedLine]) -> Explanation:
        """Return the match of these events by the engine, after storing them in the buffer."""
        assert self._copy is not None, "the trace has begun"
        found, events = self._explainer.explained(self._copy, places)
        for (number, event), one in zip(events.items(), places, strict=False):
            self.buffer.remember(number, event, one.line)
        return found


class NativeLogs(QueryEngine):
    """The compiled monitor as the reader of whole files of JSON Lines.

    It declines a log where an event may cause a warning or an error.
    """

    name: ClassVar[str] = "the native monitor"
    formats: ClassVar[frozenset[str]] = frozenset({"jsonl"})
    says_so: ClassVar[bool] = False

    def __init__(self, plan: MonitoringPlan, run: NativeRun) -> None:
        self._plan, self._run = plan, run

    def ask(self, path: Path, reader: LogReader | None) -> "NativeAnswer":
        """Return what is in a log; raises `Declined`."""
        if reader is not None or path.suffix.lower() in COMPRESSED or not path.is_file():
            raise Declined("the log is no plain file of JSON Lines")
        return self._run.answer(path)


class NativeAnswer(LogAnswer):
    """The counts and detections of a log that a compiled monitor has read; `found` are the matches by last event."""

    def __init__(
        self,
        run: NativeRun,
        log: CompiledLog,
        file: BinaryIO,
        found: Mapping[int, Sequence[MatchedLine]],
        opened: ExitStack,
    ) -> None:
        self._run, self._file, self._found, self._opened = run, file, found, opened
        self._places = {places[-1].number: places[-1] for places in found.values()}
        self.total = log.total
        self.groups = [EventCount(total, self._noted(places)) for total, places in log.group_counts()]
        *keys, (keyless, first) = [(total, self._noted([place])) for total, place in log.key_counts()]
        self.keys = [EventCount(total, places) for total, places in keys]
        self.keyless = EventCount(keyless, first) if keyless and run.keyed else None
        self.forgotten = log.forgotten_keys
        self.noted = ()
        self.selected = sorted(found)

    def _noted(self, places: Sequence[tuple[int, int, int]]) -> list[int]:
        self._places.update((one[0], MatchedLine(*one)) for one in places if one[0])
        return [one[0] for one in places]

    def begin(self, buffer: EventBuffer) -> None:
        """Add the events of matches to this buffer."""
        self._run.buffer = buffer

    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[Place]:
        """Yield the events with these numbers."""
        for number in numbers:
            place = self._places[number]
            self._file.seek(place.offset)
            yield number, place.line, _accepted(self._file.readline(), reads)
            if numbers is self.selected and number in self._found:
                raise ToolFailed("the native monitor", reason=f"event {number} is no detection of the engine")

    def of_keys(self) -> Iterator[tuple[int, int]]:
        """Yield nothing: no listener of each event has this answer."""
        return iter(())

    def close(self) -> None:
        """Close the log, and release the memory of the monitor."""
        self._opened.close()


class NativeMatches(Strategy):
    """Detects where a `NativeRun` does, under `scattered`."""

    noted = False
    """The buffer has the events of a match when it is explained."""

    def __init__(self, tree: RVAFT, run: NativeRun) -> None:
        self.letters = TreeLetters(CompiledTree(followed(property_of(tree))))
        self._run = run
        self._match: Sequence[MatchedLine] = ()

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:  # noqa: ARG002
        """Return whether an event may be in a match."""
        return _HIT if event_class.serving else NOTHING

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after the event with the number `position`."""
        if reading is _HIT:
            self._match = self._run.match(position)
        return Verdict.TRUE if self._match else Verdict.UNKNOWN

    def fork(self) -> Self:
        """Return a copy, which reads the same run."""
        return twin(self)

    @property
    def until(self) -> float:
        """-infinite: the compiled monitor has the partial matches, and decides which keys it forgets."""
        return -inf

    @property
    def state(self) -> Hashable:
        """The events read determine the state."""
        return id(self)

    def snapshot(self) -> object:
        """Refuse: the state is in another process."""
        raise OptionError("a native monitor has no snapshot")

    def restore(self, snapshot: Any) -> None:  # noqa: ARG002
        """Refuse: there is no snapshot."""
        raise OptionError("a native monitor has no snapshot")

    def explain(self) -> Explanation:
        """Return the match that the native monitor found."""
        return self._run.explanation(self._match)

    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:  # noqa: ARG002
        """Refuse: the partial matches are in another process."""
        raise OptionError("a native monitor does not list the awaited events")
