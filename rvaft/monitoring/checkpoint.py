"""What a monitor knows in the middle of a trace, kept in a file, to go on from there after a crash.

A checkpoint belongs to one tree, semantics and set of columns and settings, to one version of rvaft, and to a trace that begins with
what was read of it; `load` refuses it for any other. After a crash the events since the last checkpoint are read again, so
output may repeat, and the verdicts are those of a run that never stopped.

The file: a line that says what it is, a line with the digest of all that follows, a line of JSON, and a pickle. A pickle can
be made to run code when it is read: `admitted` lets in only what holds data, yet a checkpoint is as trustworthy as whoever
could write to it, so keep it where only you can write. It is readable for its owner alone.
"""

import errno
import hashlib
import io
import json
import os
import pickle
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final, Protocol

import rvaft
from rvaft.errors import CheckpointError, OptionError
from rvaft.language.printer import dumps
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitoring.reader import unreadable
from rvaft.monitoring.run import Run
from rvaft.monitoring.safe_pickle import pickled, unpickled
from rvaft.support.files import SUFFIXES, damage, opened

# Whether a trace is the one that was read before.

_EDGE: Final = 1 << 16
"""Bytes at the start of a trace, and before the place that was reached, by which it is known again."""


@dataclass(frozen=True, slots=True)
class Identity:
    """By what a trace is known again: digests of the first and of the last bytes among the first `length` of the file.

    Neither the path nor the inode counts: a log that was moved, restored or synchronised is the same trace as long as it begins with the
    same bytes. Of a compressed file these are the compressed bytes, all there are; more may follow in each case.
    """

    length: int
    head: str
    tail: str


def identity(trace: Path | BinaryIO, offset: int) -> Identity:
    """The identity of a trace that was read up to this offset; a stream is an uncompressed file, and is moved.

    Raises `OSError` for what cannot be read, and `OptionError` for what is no regular file or ends before.
    """
    if not isinstance(trace, Path):
        return first(trace, offset)
    if not trace.is_file():
        trace.stat()
        raise OptionError(f"{trace}: a checkpoint needs a trace in a regular file")
    with trace.open("rb") as stream:
        return first(stream, trace.stat().st_size if compressed(trace) else offset)


def first(stream: BinaryIO, length: int) -> Identity:
    """The identity of the first `length` bytes of a file; raises `OptionError` if it has fewer."""
    stream.seek(0)
    head = stream.read(min(length, _EDGE))
    start = max(0, length - _EDGE)
    stream.seek(start)
    tail = stream.read(length - start)
    if len(tail) < length - start:
        raise OptionError(f"the trace has fewer than {length} bytes")
    return Identity(length, _sha(head), _sha(tail))


def compressed(path: Path) -> bool:
    """Whether a file is read through a decompressor."""
    return path.suffix.lower() in SUFFIXES


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


__all__ = [
    "EVERY",
    "Checkpoint",
    "CheckpointError",
    "Identity",
    "Placed",
    "digest",
    "identity",
    "load",
    "reading",
    "save",
]

EVERY: Final = 10_000
"""Events between two checkpoints unless told otherwise."""
_MAGIC: Final = b"rvaft checkpoint 1\n"
_ANY_MAGIC: Final = b"rvaft checkpoint "
_BLOCK: Final = 1 << 20
_SHOWN: Final = 5
"""Columns that a message names."""
_ANEW: Final = "remove it to begin anew"


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """What is known after `events` events: they end `offset` bytes into the trace (after decompression), `line` lines.

    `tree` is `digest` of the tree, `columns` are the labels of what has a verdict of its own, `settings` are other options on which the
    meaning of the rest depends, as text. `monitors`, `statistics` and `held`, which are events read and not yet monitored, are pickled.
    """

    tree: str
    semantics: Semantics
    columns: tuple[str, ...]
    trace: Identity
    offset: int
    line: int
    events: int
    monitors: Any
    statistics: Any = None
    held: Any = None
    settings: Mapping[str, str] = field(default_factory=dict)


def digest(tree: RVAFT) -> str:
    """A digest of the canonical text of a tree, and of which part of it is monitored."""
    part = tree.part_of
    whole, branch, kind = (tree, None, None) if part is None else (part.tree, part.branch, part.kind)
    return _checkpoint_sha(f"{dumps(whole)}\n{branch} {kind}".encode())


def save(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint so that there is always a whole one: the one before, until the new one is safe on the disk.

    Raises `OSError`, with the path, where it cannot be written, and `CheckpointError` for monitors that cannot be kept.
    """
    try:
        payload = pickled((checkpoint.monitors, checkpoint.statistics, checkpoint.held))
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError) as error:
        raise CheckpointError(path, f"these monitors cannot be kept: {_one_line(error)}") from error
    header = _Header(
        version=rvaft.__version__,
        tree=checkpoint.tree,
        semantics=checkpoint.semantics.value,
        columns=list(checkpoint.columns),
        settings=dict(checkpoint.settings),
        trace=asdict(checkpoint.trace),
        offset=checkpoint.offset,
        line=checkpoint.line,
        events=checkpoint.events,
    )
    body = json.dumps(asdict(header)).encode() + b"\n" + payload
    try:
        _replace(path, _MAGIC + _checkpoint_sha(body).encode() + b"\n" + body)
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(path)) from error


def load(
    path: Path,
    *,
    tree: RVAFT,
    semantics: Semantics,
    columns: tuple[str, ...],
    trace: Path,
    settings: Mapping[str, str] | None = None,
) -> Checkpoint | None:
    """The checkpoint to go on from; None where there is no file yet.

    Raises `CheckpointError` for one that was made with anything else than what is given here, and for a file that is damaged or no
    checkpoint; `OSError` and what `identity` raises for a file that cannot be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    header, payload = _parted(path, data)
    if header.version != rvaft.__version__:
        raise _other(path, f"of rvaft {header.version}, this is {rvaft.__version__}")
    if header.tree != digest(tree):
        raise _other(path, "of another tree, or of another part of it")
    if header.semantics != semantics.value:
        raise _other(path, f"of a run with --semantics {header.semantics}, not {semantics.value}")
    if tuple(header.columns) != columns:
        raise _other(path, f"of other monitors ({_listed(header.columns)}, not {_listed(columns)})")
    wanted = dict(settings or {})
    for name in sorted({*wanted, *header.settings}):
        was, now = header.settings.get(name), wanted.get(name)
        if was != now:
            raise _other(path, f"of a run {_setting(name, was)}, not {_setting(name, now)}")
    known = Identity(**header.trace)
    _check_same(path, trace, known)
    try:
        monitors, statistics, held = unpickled(payload)
    except Exception as error:  # whatever a pickle makes of a class
        raise CheckpointError(path, f"the checkpoint cannot be read: {_one_line(error)}; {_ANEW}") from error
    return Checkpoint(
        tree=header.tree,
        semantics=semantics,
        columns=columns,
        trace=known,
        offset=header.offset,
        line=header.line,
        events=header.events,
        monitors=monitors,
        statistics=statistics,
        held=held,
        settings=wanted,
    )


class Placed(io.BufferedIOBase):
    """The lines of a stream, which knows where it is: `offset` bytes and `line` lines into the trace."""

    def __init__(self, stream: BinaryIO, *, offset: int = 0, line: int = 0) -> None:
        super().__init__()
        self._stream = stream
        self.offset = offset
        self.line = line

    def readable(self) -> bool:
        """It is."""
        return True

    def readline(self, size: int | None = -1) -> bytes:
        """The next line, or the first `size` bytes of a longer one."""
        line = self._stream.readline(-1 if size is None else size)
        self.offset += len(line)
        self.line += line.endswith(b"\n")
        return line


@contextmanager
def reading(trace: Path, *, offset: int = 0, line: int = 0) -> Iterator[Placed]:
    """The lines of a trace from an offset on, which counts bytes after decompression, and knows its place at any time.

    Raises what `rvaft.compressed.opened` raises, and `TraceError` where a compressed file is damaged or ends before the offset.
    """
    with opened(trace) as stream:
        if compressed(trace):
            _skip(trace, stream, offset, line)
        else:
            stream.seek(offset)
        yield Placed(stream, offset=offset, line=line)


# -- the file -------------------------------------------------------------------------------------------------------


def _replace(path: Path, data: bytes) -> None:
    """Write under another name in the same folder and rename, each on the disk before the next.

    The other name is always the same: what a crash leaves is overwritten by the next checkpoint.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "not a regular file")
    new = target.with_name(f".{target.name[:100]}.new")
    new.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        new.replace(target)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
    with suppress(OSError):  # some file systems have no such thing for folders, and the file is there
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


@dataclass(frozen=True, slots=True)
class _Header:
    """The line of JSON."""

    version: str
    tree: str
    semantics: str
    columns: list[str]
    settings: dict[str, str]
    trace: dict[str, Any]
    offset: int
    line: int
    events: int


def _parted(path: Path, data: bytes) -> tuple[_Header, memoryview]:
    """The header and the pickle of a file that is whole."""
    if not data.startswith(_MAGIC):
        if data.startswith(_ANY_MAGIC):
            raise _other(path, "of another version of rvaft")
        raise CheckpointError(path, "this is no checkpoint of rvaft, or the start of it is lost: name another file")
    start = len(_MAGIC) + 65
    body = memoryview(data)[start:]
    if data[len(_MAGIC) : start] != f"{_checkpoint_sha(body)}\n".encode():
        raise CheckpointError(path, f"the checkpoint is damaged or cut short: {_ANEW}")
    end = data.find(b"\n", start)
    try:
        return _Header(**json.loads(data[start:end])), body[end + 1 - start :]
    except (ValueError, TypeError) as error:
        raise CheckpointError(path, f"the checkpoint cannot be read: {_one_line(error)}; {_ANEW}") from error


def _other(path: Path, which: str) -> CheckpointError:
    return CheckpointError(path, f"this is a checkpoint {which}: {_ANEW}")


def _setting(name: str, value: str | None) -> str:
    return f"without {name}" if value is None else f"with {name} {value}"


def _listed(labels: Sequence[str]) -> str:
    more = len(labels) - _SHOWN
    return ", ".join([*labels[:_SHOWN], *([f"{more} more"] if more > 0 else [])])


def _checkpoint_sha(data: bytes | memoryview) -> str:
    return hashlib.sha256(data).hexdigest()


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


# -- the trace ------------------------------------------------------------------------------------------------------


def _check_same(path: Path, trace: Path, known: Identity) -> None:
    with trace.open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        if size < known.length:
            raise _other(path, f"of a longer trace ({known.length} bytes were read, {trace} has {size})")
        if first(stream, known.length) != known:
            raise _other(path, f"of another trace: {trace} does not begin with what was read")


def _skip(trace: Path, stream: BinaryIO, offset: int, line: int) -> None:
    damaged: tuple[type[Exception], ...] = (OSError, *damage())
    left = offset
    try:
        while left:
            block = stream.read(min(left, _BLOCK))
            if not block:
                raise EOFError("it ends before the place of the checkpoint")
            left -= len(block)
    except damaged as error:
        raise unreadable(error, str(trace), line + 1) from error


# Checkpoints of a run: written now and then, and gone on from.


class Place(Protocol):
    """How far a trace has been read: bytes after decompression, and lines."""

    @property
    def offset(self) -> int:
        """In bytes."""

    @property
    def line(self) -> int:
        """In lines."""


@dataclass(frozen=True, slots=True)
class Keeping:
    """Where checkpoints of a run over a trace are kept, and how often: every so many events; `settings` are options that matter."""

    file: Path
    trace: Path
    tree: RVAFT
    semantics: Semantics
    every: int = EVERY
    settings: Mapping[str, str] = field(default_factory=dict)

    def resume(self, run: Run) -> tuple[int, int, int]:
        """Bring a run to where the last checkpoint left it; the events, bytes and lines before that place, 0 without one.

        Raises `CheckpointError` for a checkpoint of anything else, and `OSError`.
        """
        labels = tuple(column.label for column in run.plan.bank.columns)
        found = load(
            self.file,
            tree=self.tree,
            semantics=self.semantics,
            columns=labels,
            trace=self.trace,
            settings=self.settings,
        )
        if found is None:
            return 0, 0, 0
        run.restore(found.monitors, found.held, found.statistics)
        return found.events, found.offset, found.line

    def save(self, run: Run, events: int, place: Place, trace: BinaryIO | None = None) -> None:
        """Write a checkpoint after so many events; `trace` is the file where the path may name another by now.

        Raises `CheckpointError` and `OSError`.
        """
        save(
            self.file,
            Checkpoint(
                tree=digest(self.tree),
                semantics=self.semantics,
                columns=tuple(column.label for column in run.plan.bank.columns),
                trace=identity(trace or self.trace, place.offset),
                offset=place.offset,
                line=place.line,
                events=events,
                monitors=run.state,
                statistics=run.statistics,
                held=run.ordering,
                settings=self.settings,
            ),
        )
