"""Files: compressed ones read, one written whole, several put into a folder together.

All or, where anything goes wrong, none.
"""

import errno
import gzip
import io
import os
import shutil
import stat
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

import click

from rvaft.errors import ToolMissing, installed

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
    found: list[type[Exception]] = [EOFError, zlib.error, gzip.BadGzipFile]
    with suppress(ToolMissing):
        found.append(_zstandard().ZstdError)
    return tuple(found)


def _zstandard() -> Any:
    remedy = "pip install '.[zstd]' in a checkout of rvaft, or decompress the file first"
    return installed("zstandard", "zstandard", remedy)


# Where the output of a command goes: standard output, or files that are whole or not there.


@contextmanager
def telling(what: str, path: Path) -> Iterator[None]:
    """An `OSError` says what could not be done, and with which path."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, f"{what}: {error.strerror}", str(path)) from error


def deliver(data: bytes, output: str | None) -> None:
    """Write to a file, or to standard output without one or for `-`."""
    if output is not None and output != "-":
        write_whole(Path(output), data)
    else:
        click.echo(data, nl=False)


def write_whole(path: Path, data: bytes, *, lasting: bool = False) -> None:
    """Write a file under another name in its folder and rename it, so that nobody ever sees half of it.

    What is no regular file (a device, a pipe) is written to as it is; so are the links below /dev
    and /proc, which stand for open files: `/dev/stdout` resolves to a name such as `pipe:[123]`,
    which nobody can open. Raises `OSError` with the path in it.

    A `lasting` file is a regular one, for its owner alone, on the disk before it is there; the
    other name is always the same, so that what a crash leaves is overwritten the next time.
    """
    with telling("cannot write", path):
        odd = path.exists() and not stat.S_ISREG(path.stat().st_mode)
        if odd and lasting:
            raise OSError(errno.EINVAL, "not a regular file")
        if odd or (path.absolute().parts[1:2] in (("dev",), ("proc",)) and path.is_symlink()):
            with path.open("ab") as stream:  # what standard output holds already stays
                stream.write(data)
            return
        target = path.resolve()
        prefix = f".{target.name[:100]}."
        if lasting:
            new = target.with_name(f"{prefix}new")
            new.unlink(missing_ok=True)
            handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        else:
            handle, name = tempfile.mkstemp(prefix=prefix, dir=target.parent)
            new = Path(name)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                if lasting:
                    stream.flush()
                    os.fsync(handle)
            if not lasting and target.exists():
                shutil.copymode(target, new)
            elif not lasting:
                mask = os.umask(0)
                os.umask(mask)
                new.chmod(0o666 & ~mask)
            new.replace(target)
        except BaseException:
            new.unlink(missing_ok=True)
            raise
        if lasting:
            with suppress(OSError):  # some file systems have no such thing for folders, and the file is there
                folder = os.open(target.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)


def place(folder: Path, files: Mapping[str, str | None], *, force: bool = False) -> None:
    """Write texts into a folder, which is made where it is not there.

    A file with None instead of a text must not be there.

    Files that are already as they should be are left alone. Raises `OSError`, with everything as it
    was, for one that is not (unless `force`, which replaces or removes it) and where the folder
    cannot be made or written to. Only a crash between two renames can leave some files and not
    others.
    """
    data = {folder / name: None if text is None else os.fsencode(text) for name, text in files.items()}
    with ExitStack() as unmake:
        if _made(folder):
            unmake.callback(folder.rmdir)
        changed = {path: content for path, content in data.items() if _differs(path, content, force=force)}
        with telling("cannot write into the folder", folder):
            staged = Path(tempfile.mkdtemp(prefix=".rvaft-", dir=folder))
        unmake.callback(shutil.rmtree, staged)
        with ExitStack() as undo:
            for target, content in changed.items():
                with telling("cannot write", target):
                    if content is not None:
                        (staged / target.name).write_bytes(content)
                        if target.exists():
                            shutil.copymode(target, staged / target.name)
            for target in changed:
                with telling("cannot write", target):
                    new, old = staged / target.name, staged / f"{target.name}.old"
                    if target.exists() or target.is_symlink():
                        target.rename(old)
                        undo.callback(old.rename, target)
                    if new.exists():
                        new.rename(target)
                        undo.callback(target.unlink)
            undo.pop_all()
        unmake.pop_all()
        shutil.rmtree(staged)


def _made(folder: Path) -> bool:
    """Whether the folder had to be made."""
    try:
        with telling("cannot make the folder", folder):
            folder.mkdir()
    except OSError as error:
        if error.errno == errno.EEXIST and folder.is_dir():
            return False
        why = {errno.EEXIST: "a file of this name is there", errno.ENOENT: "make the one above it first"}
        if error.errno in why:
            number = errno.ENOTDIR if error.errno == errno.EEXIST else error.errno
            raise OSError(number, f"cannot make the folder: {why[error.errno]}", str(folder)) from error
        raise
    return True


def _differs(path: Path, content: bytes | None, *, force: bool) -> bool:
    """Whether a file has to be written or removed."""
    if not path.exists() and not path.is_symlink():
        return content is not None
    if not path.is_file():
        raise OSError(errno.EEXIST, "there is something else than a file of this name; move it away", str(path))
    if content is not None and path.read_bytes() == content:
        return False
    if not force:
        how = "out of date, and there is no new one; --force removes it"
        how = how if content is None else "there already with another text; --force replaces it"
        raise OSError(errno.EEXIST, f"the file is {how}", str(path))
    return True
