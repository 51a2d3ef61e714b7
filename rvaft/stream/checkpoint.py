"""Checkpoints: the state of a monitor in a file, to continue from after a crash.

A checkpoint is valid only for the same tree, semantics, columns, settings and rvaft version. The
trace must begin with the bytes that were read. After a crash the events since the last checkpoint
are read again, and the verdicts equal those of an uninterrupted run. A detection is recorded before
it is reported, so that a repeated report is marked. The records are not synced: a power failure may
lose the latest.

File format: a line with the file type, a line with the digest of the rest, a line of JSON, and a
pickle, in which the states of monitored traces are pickles of their own. Unpickling admits only
data classes, by name. Still, a checkpoint is only as trustworthy as everyone who can write to it.
Only the owner can read the file. Until the next checkpoint, the file `.NAME.told` beside it has the
number of the last event with a reported detection.
"""

import gc
import hashlib
import io
import os
import pickle
import sys
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import KW_ONLY, dataclass, field
from math import inf
from pathlib import Path
from time import monotonic
from typing import Any, BinaryIO, Final, cast

import msgspec

from rvaft.errors import CheckpointError, OptionError
from rvaft.language.printer import dumps
from rvaft.model.event_time import EventTime, Jump, TextFormat, TimeFormat
from rvaft.model.nodes import Assumption, Kind, Place, Side
from rvaft.model.tree import RVAFT
from rvaft.model.values import Exact
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Absence, Awaited, Ended, Explanation, MatchedEvent, Pending
from rvaft.readers.json_lines import MAX_DEPTH, LinesRead, NonFiniteEvent, RepeatingObject
from rvaft.readers.log import failures_of, unreadable
from rvaft.stream.data_warnings import DataWarning, DataWarnings, Doubt
from rvaft.stream.follow import FollowedFile
from rvaft.stream.keys import Field
from rvaft.stream.monitor_set import DetectionCount
from rvaft.stream.order import Backwards, Ordering
from rvaft.stream.statistics import NearMissCount, Statistics
from rvaft.stream.verdict_change import MonitoredTrace, TraceState
from rvaft.support.files import SUFFIXES, error_context, opened, write_whole
from rvaft.support.plugins import version

EVERY: Final = 10_000
"""Default number of events between two checkpoints."""
_GRACE: Final = 0.2
"""Seconds that saving may take beyond the time of other work, which begins with imports."""
_BATCH: Final = 500
"""Number of traces that are packed together."""
_EDGE: Final = 1 << 16
"""Bytes hashed at the start of a trace and before the offset."""
_MAGIC: Final = b"rvaft checkpoint 9\n"
_BLOCK: Final = 1 << 20
_ANEW: Final = "remove it to begin anew"
_BUILT_IN: Final = (dict, frozenset, list, set, Counter, OrderedDict)
_OF_TREES: Final = (
    *(EventTime, Exact, Jump, Kind, NonFiniteEvent, Place, RepeatingObject, Semantics, Side, TextFormat, TimeFormat),
    Verdict,
)
_OF_MONITORS: Final = (
    Absence,
    Awaited,
    Backwards,
    Ended,
    Explanation,
    Field,
    MatchedEvent,
    Ordering,
    Pending,
)
_COUNTS: Final = (Assumption, DetectionCount, NearMissCount, DataWarning, DataWarnings, Doubt, Statistics)
_ALL: Final = (*_BUILT_IN, *_OF_TREES, *_OF_MONITORS, *_COUNTS)
_ADMITTED: Final = {(one.__module__, one.__qualname__): one for one in _ALL}
"""The classes allowed in a checkpoint.

None of them may run commands, write files or listen on a port: a pickle can set the attributes of
any class that it names.
"""


class _OutOfTime(Exception):
    """Packing has reached its deadline."""


class _DataPickler(pickle.Pickler):
    """A pickler for what `_DataUnpickler` admits, so that an error occurs before the crash.

    Raises `_OutOfTime` after the deadline.
    """

    deadline = inf

    def reducer_override(self, obj: object) -> Any:
        if monotonic() > self.deadline:
            raise _OutOfTime
        kind = obj if isinstance(obj, type) else type(obj)
        if _ADMITTED.get((kind.__module__, kind.__qualname__)) is not kind:
            raise pickle.PicklingError(f"{kind.__module__}.{kind.__qualname__} is not allowed in a checkpoint")
        return NotImplemented


class _DataUnpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> type:
        found = _ADMITTED.get((module, name))
        if found is None:
            raise pickle.UnpicklingError(f"{module}.{name} is not allowed in a checkpoint")
        return found


def packed(state: object, deadline: float = inf) -> bytes:
    """Pickle a state; raises `ValueError` for a class that is not admitted."""
    payload = io.BytesIO()
    pickler = _DataPickler(payload, protocol=5)
    pickler.deadline = deadline
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(limit + 4 * MAX_DEPTH)  # values are as deep as in a trace; `pickle` makes two calls per level
    try:
        pickler.dump(state)
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"these monitors cannot be kept: {_one_line(error)}") from error
    finally:
        sys.setrecursionlimit(limit)
    return payload.getvalue()


def unpacked(data: bytes | memoryview) -> object:
    """Unpickle a state; damaged bytes raise any exception of `pickle` or of an admitted class."""
    return _DataUnpickler(io.BytesIO(data)).load()


class _PackedTraces:
    """The packed states of monitored traces, in batches.

    Only traces with new events, or that were told a time, are packed again. The last state of a trace counts; once
    most states are outdated, all are packed anew.
    """

    def __init__(self) -> None:
        self.batches: list[bytes] = []
        self._states = 0
        self._packed: list[int] = []
        """By place of the trace, the number of its changes when it was packed, or -1."""

    def pack(self, traces: Sequence[MonitoredTrace], deadline: float) -> None:
        """Pack what has changed; after `_OutOfTime`, another call packs the rest."""
        self._packed += [-1] * (len(traces) - len(self._packed))
        changed = [place for place, one in enumerate(traces) if one.changes != self._packed[place]]
        if self._states + len(changed) > 2 * len(traces) + _BATCH:
            self.batches, self._states, changed = [], 0, list(range(len(traces)))
            self._packed = [-1] * len(traces)
        for start in range(0, len(changed), _BATCH):
            if monotonic() > deadline:
                raise _OutOfTime
            places = changed[start : start + _BATCH]
            self.batches.append(packed([(place, traces[place].state) for place in places], deadline))
            self._states += len(places)
            for place in places:
                self._packed[place] = traces[place].changes

    def unpack(self, batches: list[bytes]) -> list[TraceState]:
        """Return the states in batches, which need not be packed again."""
        found: dict[int, TraceState] = {}
        for batch in batches:
            states = cast("list[tuple[int, TraceState]]", unpacked(batch))
            found.update(states)
            self._states += len(states)
        self.batches = batches
        self._packed = [found[place][2] for place in range(len(found))]
        return [found[place] for place in range(len(found))]


@contextmanager
def _without_collection() -> Iterator[None]:
    """Suspend garbage collection: states are many objects that live briefly."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@contextmanager
def open_at(trace: Path, *, offset: int = 0, line: int = 0) -> Iterator[LinesRead]:
    """Open a trace at an offset in bytes (after decompression).

    Raises what `opened` raises, and `TraceError` if a compressed file is damaged or too short.
    """
    with opened(trace) as stream:
        left = offset if _is_compressed(trace) else 0
        try:
            if not _is_compressed(trace):
                stream.seek(offset)
            while left:
                block = stream.read(min(left, _BLOCK))
                if not block:
                    raise EOFError("it ends before the place of the checkpoint")
                left -= len(block)
        except failures_of(str(trace)) as error:
            raise unreadable(error, str(trace), line + 1) from error
        yield LinesRead(stream, offset=offset, line=line)


def _is_compressed(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES


def identity(trace: Path | BinaryIO, offset: int) -> tuple[int, str]:
    """Return a size and a digest of the first and last bytes of a trace that was read up to the
    offset.

    Path and inode do not count: a moved or restored log is the same trace. Of a compressed file all
    compressed bytes count. A stream is an uncompressed file; its position changes. Raises
    `OSError`, and `OptionError` for a file that is not regular or is too short.
    """
    if isinstance(trace, Path):
        size = trace.stat().st_size
        if not trace.is_file():
            raise OptionError(f"{trace}: a checkpoint needs a trace in a regular file")
        with trace.open("rb") as stream:
            return identity(stream, size if _is_compressed(trace) else offset)
    edge, edges = min(offset, _EDGE), b""
    for start in (0, offset - edge):
        trace.seek(start)
        edges += trace.read(edge)
    if len(edges) < 2 * edge:
        raise OptionError(f"the trace has fewer than {offset} bytes")
    return offset, _sha(edges)


def _sha(data: bytes | memoryview) -> str:
    return hashlib.sha256(data).hexdigest()


class Checkpoint(msgspec.Struct, kw_only=True):
    """The trees, settings and trace of a checkpoint, and the position.

    `offset` counts bytes after decompression. Detections up to the event `noted`, perhaps beyond
    `events`, were reported.
    """

    version: str
    tree: str
    settings: dict[str, str]
    trace: tuple[int, str] = (0, "")
    offset: int = 0
    line: int = 0
    events: int = 0
    noted: int = 0


@dataclass(eq=False)
class CheckpointFile:
    """The checkpoint file of a run, written every `every` events.

    `settings` affect the meaning of the state. Detections up to the event `noted` were reported, or
    were about to be.
    """

    path: Path
    _: KW_ONLY
    trees: Sequence[RVAFT]
    trace: Path
    every: int = EVERY
    settings: Mapping[str, str]
    noted: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._about = Checkpoint(
            version=version(),
            tree=_sha("\n".join(map(_text, self.trees)).encode()),
            settings=dict(self.settings),
        )
        self._saved = 0
        self._digest = ""
        self._begun = monotonic()
        self._spent = self._expected = 0.0
        self._traces = _PackedTraces()
        target = Path(os.path.realpath(self.path))
        self._record = target.with_name(f".{target.name[:100]}.told")
        self._notes: int | None = None
        """The open record of reported detections."""

    @property
    def _left(self) -> float:
        """Seconds that saving may take now, so that it takes at most half of the run time."""
        return monotonic() - self._begun + _GRACE - 2 * self._spent

    def is_due(self, events: int) -> bool:
        """Whether a checkpoint is due, and it and one at the end would leave half of the run time."""
        return events // self.every != self._saved // self.every and 2 * self._expected <= self._left

    def save(
        self,
        state: Callable[[], object],
        events: int,
        place: LinesRead | FollowedFile,
        trace: BinaryIO | None = None,
        *,
        traces: Sequence[MonitoredTrace] = (),
        bounded: bool = False,
    ) -> None:
        """Replace the checkpoint atomically, once the new one is on the disk.

        `trace` is the open file, as the path may name another by now. If `bounded`, saving is put off
        if it would take more than half of the run time. Raises `OSError` and `CheckpointError`.
        """
        begun = monotonic()
        deadline = begun + self._left / 2 if bounded else inf
        try:
            with _without_collection():
                self._traces.pack(traces, deadline)
                payload = packed((self._traces.batches, state()), deadline)
            self._write(payload, events, place, trace)
            self._expected = monotonic() - begun
        except ValueError as error:
            raise CheckpointError(self.path, str(error)) from error
        except _OutOfTime:
            self._expected = 2 * (monotonic() - begun)
        finally:
            self._spent += monotonic() - begun

    def _write(self, payload: bytes, events: int, place: LinesRead | FollowedFile, trace: BinaryIO | None) -> None:
        noted = self.noted if self.noted > events else 0
        known = identity(trace or self.trace, place.offset)
        about = msgspec.structs.replace(
            self._about, trace=known, offset=place.offset, line=place.line, events=events, noted=noted
        )
        body = msgspec.json.encode(about) + b"\n" + payload
        self._digest = _sha(body)
        with error_context("cannot write", self.path):
            write_whole(self.path, _MAGIC + self._digest.encode() + b"\n" + body, lasting=True)
            self._record.unlink(missing_ok=True)
        if self._notes is not None:
            os.close(self._notes)
            self._notes = None
        self._saved = events

    def note(self, event: int) -> None:
        """Record that a detection is reported, until the next checkpoint."""
        self.noted = event
        with error_context("cannot write", self.path):
            if self._notes is None:  # the record of an earlier run is replaced by one write, not cut first
                self._notes = os.open(self._record, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
            os.pwrite(self._notes, f"{self._digest} {event:020}\n".encode(), 0)

    def load(self) -> tuple[Checkpoint, list[TraceState], object] | None:
        """Return the checkpoint and the states that were saved, or None if the file does not exist.

        Raises `CheckpointError` for a damaged file or a checkpoint of another run, `OSError`, and
        what `identity` raises.
        """
        start = len(_MAGIC) + 65
        try:
            with self.path.open("rb") as stream:
                data = stream.read(start)
                data += stream.read() if data.startswith(_MAGIC) else b""  # a file of another kind may be endless
        except FileNotFoundError:
            return None
        body = memoryview(data)[start:]
        self._digest = _sha(body)
        if not data.startswith(_MAGIC):
            if data.startswith(_MAGIC[:17]):
                raise self._other("of another version of rvaft")
            no_checkpoint = "this is no checkpoint of rvaft, or the start of it is lost: name another file"
            raise CheckpointError(self.path, no_checkpoint)
        if data[len(_MAGIC) : start] != f"{self._digest}\n".encode():
            raise CheckpointError(self.path, f"the checkpoint is damaged or cut short: {_ANEW}")
        end = data.find(b"\n", start)
        try:
            found = msgspec.json.decode(data[start:end], type=Checkpoint)
        except (ValueError, TypeError) as error:
            raise self.unreadable(error) from error
        self._require_same(found)
        try:
            with _without_collection():
                batches, state = cast("tuple[list[bytes], object]", unpacked(body[end + 1 - start :]))
                traces = self._traces.unpack(batches)
        except Exception as error:
            raise self.unreadable(error) from error
        self._saved = found.events
        self.noted = found.noted
        with suppress(OSError, ValueError):
            digest, number = self._record.read_text(encoding="ascii").split()
            if digest == self._digest:
                self.noted = int(number)
        return found, traces, state

    def _require_same(self, found: Checkpoint) -> None:

        def with_(name: str, value: str | None) -> str:
            return f"without {name}" if value is None else f"with {name} {value}".rstrip()

        about = self._about
        if found.version != about.version:
            raise self._other(f"of rvaft {found.version}, this is {about.version}")
        if found.tree != about.tree:
            raise self._other("of another tree, or of another part of it" if len(self.trees) == 1 else "of other trees")
        for name in sorted({*about.settings, *found.settings}):
            was, now = found.settings.get(name), about.settings.get(name)
            if was != now:
                raise self._other(f"of a run {with_(name, was)}, not {with_(name, now)}")
        length, _ = found.trace
        with self.trace.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size < length:
                raise self._other(f"of a longer trace ({length} bytes were read, {self.trace} has {size})")
            if identity(stream, length) != found.trace:
                raise self._other(f"of another trace: {self.trace} does not begin with what was read")

    def unreadable(self, error: Exception) -> CheckpointError:
        """Return the error for invalid contents."""
        return CheckpointError(self.path, f"the checkpoint cannot be read: {_one_line(error)}; {_ANEW}")

    def _other(self, which: str) -> CheckpointError:
        return CheckpointError(self.path, f"this is a checkpoint {which}: {_ANEW}")


def _text(tree: RVAFT) -> str:
    part = tree.part_of
    whole, branch, kind = (tree, None, None) if part is None else (part.tree, part.branch, part.kind)
    return f"{dumps(whole)}\n{branch} {kind}"


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
