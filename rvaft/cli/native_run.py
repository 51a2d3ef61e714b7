"""A run in which a compiled monitor replaces the joins of the engine.

Events are read as without `--native`. `NativeRun` passes each block of the log to the compiled monitor
before the block is read, and `NativeMatches` detects at the events that the compiled monitor named.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from copy import copy
from dataclasses import replace
from io import BufferedIOBase
from itertools import islice
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO, Final, NamedTuple, Protocol, Self, cast, runtime_checkable

import msgspec

from rvaft.api import monitor
from rvaft.backend import Specification, backend
from rvaft.cli import warn
from rvaft.core.classifier import TreeReads
from rvaft.core.passes import followed, property_of
from rvaft.engine.compiled_tree import NOTHING, CompiledTree, EventClass, Reading, TreeLetters
from rvaft.engine.strategy import Strategy
from rvaft.errors import OptionError, RvaftError, TooLarge, ToolFailed, TraceError
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, finite_decimal
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Explanation, Pending
from rvaft.readers.json_lines import decode, event_on
from rvaft.readers.log import BOM
from rvaft.stream.keys import Key
from rvaft.stream.listeners import EventBuffer

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

    def close(self) -> None:
        """Release the memory of the monitor."""


@runtime_checkable
class Compiling(Protocol):
    """A backend that compiles monitors."""

    def keyed(self, key: Sequence[tuple[tuple[str, ...], tuple[str, ...]]]) -> Self:
        """Return a backend whose monitors regard each value of a key as a log of its own."""

    def translate(self, tree: RVAFT, semantics: Semantics) -> Specification:
        """Return the tree as a text."""

    def program(self, text: str, warn: Callable[[str], object]) -> AbstractContextManager[Path]:
        """Yield a compiled program, which may be removed once it runs."""

    def native_log(self, text: str, *, keys: int, repeat: bool, warn: Callable[[str], object]) -> CompiledLog:
        """Return a new monitor of one log."""


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
            line = log.readline().removeprefix(BOM)
            try:
                events[number] = _ACCEPTED.decode(line)
            except (msgspec.DecodeError, RecursionError):  # NaN, or a lone surrogate that is not read
                events[number] = decode(line.rstrip(b"\r\n"), reads=self._reads)
        verdicts, numbers = list(engine.run([*events.values()])), [*events]
        found = engine.explanation
        if found is None or verdicts.index(Verdict.TRUE) < len(verdicts) - 1:
            raise ToolFailed("the native monitor", reason=f"the engine has no match at event {numbers[-1]}")
        matched = tuple(one._replace(event=numbers[one.event - 1]) for one in found.matched)
        return replace(found, matched=matched), events


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

    Raises the errors of `translate`; `begin` raises those of the compiler.
    """

    def __init__(self, part: RVAFT, *, key: Key | None, keys: int, repeat: bool) -> None:
        fields = () if key is None else tuple(((one.text,), one.path) for one in key.fields)
        self._backend = compiling().keyed(fields)
        self._text = self._backend.translate(part, Semantics.SCATTERED).text
        self._keys, self._repeat = keys, repeat
        self._explainer = MatchExplainer(part)
        self._remedy = property_of(part).remedy
        self._found: dict[int, Sequence[MatchedLine]] = {}
        self._log: CompiledLog | None = None
        self._copy: BinaryIO | None = None
        self._name = ""
        self._buffer = EventBuffer()

    @contextmanager
    def trace(self, name: str, file: Path | None, stream: BinaryIO, buffer: EventBuffer) -> Iterator[BinaryIO]:
        """Yield the stream to read the trace `name` from; `file` has the same bytes, or is None.

        Matched events are read from the file, or from a temporary copy of the stream, into the buffer.
        """
        self._log = self._backend.native_log(self._text, keys=self._keys, repeat=self._repeat, warn=warn)
        self._found.clear()
        self._name, self._buffer = name, buffer
        with ExitStack() as stack:
            stack.callback(self._log.close)
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

    def _feed(self, data: bytes) -> None:
        assert self._log is not None, "the trace has begun"
        for places in self._log.read(data, ended=not data):
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
        self._buffer.remember_all([*events.items()], [one.line for one in places])
        return found


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
        return copy(self)

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
