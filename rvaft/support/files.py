"""Files: reading compressed ones, and writing one or several atomically."""

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

# Compressed files: `.gz` by the standard library, `.zst` by the package `zstandard`.

SUFFIXES: Final = (".gz", ".zst")
_CHUNK: Final = 1 << 16


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open the bytes of a file, decompressed by its suffix.

    Raises `OSError` and `ToolMissing`; `damage` lists the exceptions for damaged data.
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
    """A stream of decompressed frames; the package's own reader accepts truncated files."""

    def __init__(self, source: BinaryIO) -> None:
        self._source = source
        self._start = _zstandard().ZstdDecompressor().decompressobj
        self._frame = self._start()
        self._begun = False
        self._ready = b""

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer with the available data; raises `EOFError` if the last frame is
        truncated.
        """
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
    """Return the exceptions that reading truncated or invalid compressed data raises."""
    found: list[type[Exception]] = [EOFError, zlib.error, gzip.BadGzipFile]
    with suppress(ToolMissing):
        found.append(_zstandard().ZstdError)
    return tuple(found)


def _zstandard() -> Any:
    remedy = "pip install '.[zstd]' in a checkout of rvaft, or decompress the file first"
    return installed("zstandard", "zstandard", remedy)


@contextmanager
def error_context(what: str, path: Path) -> Iterator[None]:
    """Add the failed action and the path to an `OSError`."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, f"{what}: {error.strerror}", str(path)) from error


def deliver(data: bytes, output: str | None) -> None:
    """Write to a file, or to standard output for None and `-`."""
    if output is not None and output != "-":
        write_whole(Path(output), data)
    else:
        click.echo(data, nl=False)


def write_whole(path: Path, data: bytes, *, lasting: bool = False) -> None:
    """Write a file atomically, by renaming a temporary file in the same folder.

    Devices and pipes are written directly, and so are links below /dev and /proc: `/dev/stdout` may
    resolve to `pipe:[123]`, which cannot be opened. Raises `OSError` with the path.

    A `lasting` file is a regular file with mode 0600, synced to disk before the rename. Its
    temporary name is fixed, so that the next write replaces the remains of a crash.
    """
    with error_context("cannot write", path):
        odd = path.exists() and not stat.S_ISREG(path.stat().st_mode)
        if odd and lasting:
            raise OSError(errno.EINVAL, "not a regular file")
        if odd or (path.absolute().parts[1:2] in (("dev",), ("proc",)) and path.is_symlink()):
            with path.open("ab") as stream:  # keep what standard output already holds
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
            with suppress(OSError):  # some file systems cannot sync folders
                folder = os.open(target.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)


def place(folder: Path, files: Mapping[str, str | None], *, force: bool = False) -> None:
    """Write texts into a folder, which is created if absent; a file with None must not exist.

    Unchanged files are not touched. Raises `OSError`, with all changes undone, if a file differs or
    must not exist (`force` replaces or removes it), or the folder cannot be written to. Only a
    crash between two renames can leave a partial result.
    """
    data = {folder / name: None if text is None else os.fsencode(text) for name, text in files.items()}
    with ExitStack() as unmake:
        if _made(folder):
            unmake.callback(folder.rmdir)
        changed = {path: content for path, content in data.items() if _differs(path, content, force=force)}
        with error_context("cannot write into the folder", folder):
            staged = Path(tempfile.mkdtemp(prefix=".rvaft-", dir=folder))
        unmake.callback(shutil.rmtree, staged)
        with ExitStack() as undo:
            for target, content in changed.items():
                with error_context("cannot write", target):
                    if content is not None:
                        (staged / target.name).write_bytes(content)
                        if target.exists():
                            shutil.copymode(target, staged / target.name)
            for target in changed:
                with error_context("cannot write", target):
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
    """Create the folder; return whether it was absent."""
    try:
        with error_context("cannot make the folder", folder):
            folder.mkdir()
    except OSError as error:
        if error.errno == errno.EEXIST and folder.is_dir():
            return False
        why = {errno.EEXIST: "a file has this name", errno.ENOENT: "create its parent folder first"}
        if error.errno in why:
            number = errno.ENOTDIR if error.errno == errno.EEXIST else error.errno
            raise OSError(number, f"cannot make the folder: {why[error.errno]}", str(folder)) from error
        raise
    return True


def _differs(path: Path, content: bytes | None, *, force: bool) -> bool:
    if not path.exists() and not path.is_symlink():
        return content is not None
    if not path.is_file():
        raise OSError(errno.EEXIST, "the path exists and is not a regular file; move it away", str(path))
    if content is not None and path.read_bytes() == content:
        return False
    if not force:
        how = "out of date and no longer needed; --force removes it"
        how = how if content is None else "there with another text; --force replaces it"
        raise OSError(errno.EEXIST, f"the file is {how}", str(path))
    return True
