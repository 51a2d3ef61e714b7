"""Files of one folder, put there together: all or, where anything goes wrong, none."""

import errno
import gzip
import io
import os
import shutil
import stat
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

import click

from rvaft.errors import ToolMissing

# Opening a file that may be compressed: `.gz` by the standard library, `.zst` by the package `zstandard`.

SUFFIXES: Final = (".gz", ".zst")
_CHUNK: Final = 1 << 16


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """The bytes of a file, decompressed where its suffix says that they are compressed.

    Raises `OSError` where it cannot be opened, and `ToolMissing`; what reading raises for damaged data is in `damage`.
    """
    with path.open("rb") as stream:
        match path.suffix.lower():
            case ".gz":
                with gzip.GzipFile(fileobj=stream) as inner:
                    yield cast("BinaryIO", inner)
            case ".zst":
                yield io.BufferedReader(_Zstd(stream))
            case _:
                yield stream


class _Zstd(io.RawIOBase):
    """Decompressed frames, one after the other; the package's own reader takes a truncated file for a whole one."""

    def __init__(self, source: BinaryIO) -> None:
        self._source = source
        self._start = _zstandard().ZstdDecompressor().decompressobj
        self._frame = self._start()
        self._begun = False
        self._ready = b""

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer as far as there is something; raises `EOFError` where the last frame is not whole."""
        while not self._ready:
            if self._frame.eof:
                data, self._frame, self._begun = self._frame.unused_data, self._start(), False
            else:
                data = b""
            data = data or self._source.read(_CHUNK)
            if not data:
                if self._begun:
                    raise EOFError("the compressed file ended before the end of the stream")
                return 0
            self._begun = True
            self._ready = self._frame.decompress(data)
        taken = min(len(buffer), len(self._ready))
        buffer[:taken], self._ready = self._ready[:taken], self._ready[taken:]
        return taken


def damage() -> tuple[type[Exception], ...]:
    """What reading compressed data raises where it is truncated or no such data."""
    try:
        found: tuple[type[Exception], ...] = (_zstandard().ZstdError,)
    except ToolMissing:
        found = ()
    return (EOFError, zlib.error, gzip.BadGzipFile, *found)


def _zstandard() -> Any:
    try:
        import zstandard  # noqa: PLC0415 -- imported on use
    except ImportError as error:
        raise ToolMissing(
            "zstandard", remedy="pip install '.[zstd]' in a checkout of rvaft, or decompress the file first"
        ) from error
    return zstandard


# Where the output of a command goes: standard output, or a file that is whole or not there.


def deliver(data: bytes, output: str | None) -> None:
    """Write to a file, or to standard output without one or for `-`."""
    if output is not None and output != "-":
        write_whole(Path(output), data)
        return
    click.echo(data, nl=False)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under another name in its folder and rename it, so that nobody ever sees half of it.

    What is no regular file (a device, a pipe) is written to as it is. Raises `OSError` with the path in it.
    """
    try:
        if _in_place(path):
            with path.open("ab") as stream:  # what standard output holds already stays
                stream.write(data)
        else:
            _replace(path.resolve(), data)
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(path)) from error


def _in_place(path: Path) -> bool:
    """Whether a path is written to and never replaced.

    The links below /dev and /proc stand for open files, not for places in a folder: `/dev/stdout` and `/dev/fd/N` resolve
    to names such as `pipe:[123]`, which nobody can open.
    """
    if path.exists() and not stat.S_ISREG(path.stat().st_mode):
        return True
    return path.absolute().parts[1:2] in (("dev",), ("proc",)) and path.is_symlink()


def _replace(target: Path, data: bytes) -> None:
    handle, name = tempfile.mkstemp(prefix=f".{target.name[:100]}.", dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        Path(name).chmod(_mode(target))
        Path(name).replace(target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _mode(target: Path) -> int:
    """The permissions of the file that is replaced, or those that a new file gets."""
    if target.exists():
        return stat.S_IMODE(target.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def place(folder: Path, files: Mapping[str, str | None], *, force: bool = False) -> None:
    """Write texts into a folder, which is made where it is not there; a file with None instead of a text must not be there.

    Files that are already as they should be are left alone. Raises `OSError`, with everything as it was, for one that is not
    (unless `force`, which replaces or removes it) and where the folder cannot be made or written to. Only a crash between
    two renames can leave some files and not others.
    """
    data = {name: None if text is None else os.fsencode(text) for name, text in files.items()}
    with ExitStack() as unmake:
        if _made(folder):
            unmake.callback(folder.rmdir)
        changed = {name: content for name, content in data.items() if _differs(folder / name, content, force=force)}
        with _staging(folder) as staged, ExitStack() as undo:
            for name, content in changed.items():
                if content is not None:
                    _write(staged / name, content, folder / name)
            for name in changed:
                _swap(staged / name, folder / name, undo)
            undo.pop_all()
        unmake.pop_all()


def _made(folder: Path) -> bool:
    """Whether the folder had to be made."""
    try:
        folder.mkdir()
    except FileExistsError:
        if folder.is_dir():
            return False
        raise OSError(errno.ENOTDIR, "cannot make the folder: a file of this name is there", str(folder)) from None
    except FileNotFoundError as error:
        raise OSError(error.errno, "cannot make the folder: make the one above it first", str(folder)) from error
    except OSError as error:
        raise OSError(error.errno, f"cannot make the folder: {error.strerror}", str(folder)) from error
    return True


def _differs(path: Path, content: bytes | None, *, force: bool) -> bool:
    """Whether a file has to be written or removed."""
    if not path.exists() and not path.is_symlink():
        return content is not None
    if not path.is_file():
        raise OSError(errno.EEXIST, "there is something else than a file of this name; move it away", str(path))
    if content is not None and path.read_bytes() == content:
        return False
    if not force and content is None:
        raise OSError(errno.EEXIST, "the file is out of date, and there is no new one; --force removes it", str(path))
    if not force:
        raise OSError(errno.EEXIST, "the file is there already with another text; --force replaces it", str(path))
    return True


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """A folder below this one, so that a file gets from one to the other by its name alone."""
    try:
        staged = Path(tempfile.mkdtemp(prefix=".rvaft-", dir=folder))
    except OSError as error:
        raise OSError(error.errno, f"cannot write into the folder: {error.strerror}", str(folder)) from error
    try:
        yield staged
    finally:
        shutil.rmtree(staged)


def _write(path: Path, content: bytes, meant: Path) -> None:
    try:
        path.write_bytes(content)
        if meant.exists():
            shutil.copymode(meant, path)
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(meant)) from error


def _swap(new: Path, target: Path, undo: ExitStack) -> None:
    """Take away what is there, put the new file in its place if there is one, and remember how to undo that."""
    old = new.with_name(f"{new.name}.old")
    try:
        if target.exists() or target.is_symlink():
            target.rename(old)
            undo.callback(old.rename, target)
        if new.exists():
            new.rename(target)
            undo.callback(target.unlink)
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(target)) from error
