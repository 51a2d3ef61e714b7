"""Files: reading compressed ones, and writing one or several atomically."""

import errno
import gzip
import io
import os
import shutil
import stat
import sys
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from rvaft.errors import ToolMissing, installed
from rvaft.support.terminal import visible_lines

# Compressed files: `.gz` by the standard library, `.zst` by the package `zstandard`.

SUFFIXES: Final = (".gz", ".zst")
_CHUNK: Final = 1 << 16
_INPUTS: Final = "rvaft.inputs"


def note_input(path: str | os.PathLike[str]) -> None:
    """Record a file that the running command reads, so that `target_of` refuses to overwrite it."""
    context = _command()
    if context is not None:
        with suppress(OSError, ValueError):  # whoever reads the file reports why it cannot be read
            context.meta.setdefault(_INPUTS, {})[os.path.realpath(path)] = None


def _command() -> Any:
    """Return the context of the running command, or None: it needs click, which is not imported for this."""
    click = sys.modules.get("click")
    return None if click is None else click.get_current_context(silent=True)


def _is_input(path: Path) -> bool:
    context = _command()
    return context is not None and os.fspath(path) in context.meta.get(_INPUTS, ())


def opened_within(folder: Path, path: Path) -> BinaryIO:
    """Open a regular file inside a folder; links may lead to places inside it.

    Each folder on the way is opened from the one above, and links are resolved before, so that no
    change meanwhile leads outside. Raises `OSError`.
    """
    home, real = os.path.realpath(folder), os.path.realpath(path)
    if not Path(real).is_relative_to(home):
        raise OSError(errno.EACCES, f"it is outside the folder {os.fspath(folder)!r}", os.fspath(path))
    *inner, name = Path(real).relative_to(home).parts or (".",)
    with ExitStack() as stack:
        handle = None
        for part in (home, *inner):
            handle = os.open(part, _ON_THE_WAY | (0 if handle is None else os.O_NOFOLLOW), dir_fd=handle)
            stack.callback(os.close, handle)
        stream = os.fdopen(os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=handle), "rb")
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            stream.close()
            raise OSError(errno.EINVAL, "it is not a regular file", os.fspath(path))
        return stream


_ON_THE_WAY: Final = getattr(os, "O_PATH", os.O_RDONLY) | os.O_DIRECTORY


@contextmanager
def opened(path: Path, within: Path | None = None) -> Iterator[BinaryIO]:
    """Open the bytes of a file, decompressed by its suffix; `within` as `opened_within` does.

    Raises `OSError` and `ToolMissing`; `damage` lists the exceptions for damaged data.
    """
    note_input(path)
    with path.open("rb") if within is None else opened_within(within, path) as stream:
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
        return
    from click import echo  # noqa: PLC0415 -- imported on use

    echo(_for_terminal(data) if sys.stdout.isatty() else data, nl=False)


def _for_terminal(data: bytes) -> bytes:
    """Return text with hidden characters escaped and a note, so that no text controls a terminal."""
    text = data.decode("utf-8", "backslashreplace")
    if (shown := visible_lines(text)) == text:
        return data
    sys.stderr.write("rvaft: warning: the terminal shows control characters escaped; -o FILE writes them as they are\n")
    return shown.encode()


def target_of(path: Path, *, follow: bool = True) -> Path:
    """Return the path of the regular file to write: that of a link's target with `follow`.

    Raises `OSError` if the path names another kind of file, or a file that the command reads, or if
    its folder cannot have a file.
    """
    if not follow and path.is_symlink():
        raise OSError(errno.EINVAL, "a link has this name; move it away")
    target = Path(os.path.realpath(path))
    if (kind := _kind(path)) is not None:  # a stream in /proc has no other path
        where = f"; {path} links to it" if path.is_symlink() else ""
        raise OSError(errno.EINVAL, f"{kind} is not a regular file{where}")
    if _is_input(target):
        raise OSError(errno.EINVAL, "the command reads this file, which would be overwritten: name another file")
    require_folder(target.parent)
    return target


def require_folder(folder: Path) -> None:
    """Raise `OSError` unless files can be made in the folder."""
    if not folder.is_dir():
        raise OSError(errno.ENOTDIR, f"{folder} is not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OSError(errno.EACCES, f"no permission for {folder}")


_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISBLK, "a block device"),
    (stat.S_ISCHR, "a character device"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)


def _kind(path: Path) -> str | None:
    """Return what the path names if it exists and is not a regular file."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None
    return None if stat.S_ISREG(mode) else next((name for is_kind, name in _KINDS if is_kind(mode)), "a special file")


_PASSING: Final = (("dev",), ("proc",))
"""Folders with links to the streams of a process: `/dev/stdout` may resolve to `pipe:[123]`, which cannot be opened."""


def _passes(path: Path) -> bool:
    """Whether the path names a pipe, or a stream or character device in /dev or /proc."""
    in_passing = path.absolute().parts[1:2] in _PASSING
    if in_passing and path.is_symlink():
        return True
    kind = _kind(path)
    return kind == "a pipe" or (kind == "a character device" and in_passing)


def _pass_on(path: Path, data: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NOCTTY)  # keep what standard output already holds
    with os.fdopen(handle, "wb", buffering=0) as stream:
        if stat.S_ISBLK(os.fstat(handle).st_mode):
            raise OSError(errno.EINVAL, "a block device is not a regular file")
        rest = memoryview(_for_terminal(data) if os.isatty(handle) else data)
        while rest:
            rest = rest[stream.write(rest) or 0 :]


def require_target(path: Path, *, regular: bool = False) -> None:
    """Raise the `OSError` that `write_whole` would raise for what the path names."""
    with error_context("cannot write", path):
        if regular or not _passes(path):
            target_of(path)


def write_whole(
    path: Path, data: bytes, *, lasting: bool = False, executable: bool = False, follow: bool = True
) -> None:
    """Write a file atomically, by renaming a temporary file in the same folder.

    A link names its target, unless not `follow`. Pipes, and streams and character devices in /dev, are
    written directly; a `lasting` or `executable` file must be regular. Raises `OSError` with the
    path for anything else, and for a file that the command reads.

    A `lasting` file has mode 0600 and is synced to disk before the rename. Its temporary name is
    fixed, so that the next write replaces the remains of a crash.
    """
    with error_context("cannot write", path):
        if not lasting and not executable and follow and _passes(path):
            _pass_on(path, data)
            return
        target = target_of(path, follow=follow)
        with replacement(target, fixed_name=lasting) as stream:
            stream.write(data)
            handle = stream.fileno()
            if lasting:
                stream.flush()
                os.fsync(handle)
            else:
                os.fchmod(handle, _mode_of(target, executable=executable))
        if lasting:
            with suppress(OSError):  # some file systems cannot sync folders
                folder = os.open(target.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)


def _mode_of(target: Path, *, executable: bool) -> int:
    """Return the permissions of the file that is replaced, or of a new file."""
    try:
        mode = target.stat().st_mode & 0o777
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        mode = 0o666 & ~mask
    return mode | (mode & 0o444) >> 2 if executable else mode


def temporary_beside(target: Path) -> tuple[Path, BinaryIO]:
    """Create the temporary file of fixed name for a target, with mode 0600, after removing an old one."""
    new = target.with_name(f".{target.name[:100]}.new")
    new.unlink(missing_ok=True)
    return new, os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb")


@contextmanager
def replacement(target: Path, *, fixed_name: bool = False) -> Iterator[BinaryIO]:
    """Open a temporary file beside the target, which it replaces at the end of the block."""
    if fixed_name:
        new, stream = temporary_beside(target)
    else:
        handle, name = tempfile.mkstemp(prefix=f".{target.name[:100]}.", dir=target.parent)
        new, stream = Path(name), os.fdopen(handle, "wb")
    try:
        with stream:
            yield stream
        new.replace(target)
    except BaseException:
        new.unlink(missing_ok=True)
        raise


def place(folder: Path, files: Mapping[str, str | bytes | None], *, force: bool = False) -> None:
    """Write texts or bytes into a folder, which is created if absent; a file with None must not exist.

    Unchanged files are not touched. Raises `OSError`, with all changes undone, if a file differs or
    must not exist (`force` replaces or removes it), or the folder cannot be written to. Only a
    crash between two renames can leave a partial result.
    """
    data = {
        folder / name: os.fsencode(content) if isinstance(content, str) else content for name, content in files.items()
    }
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
    if _is_input(Path(os.path.realpath(path))):
        raise OSError(errno.EINVAL, "the command reads this file; name another folder", str(path))
    if not path.is_file():
        raise OSError(errno.EEXIST, "the path exists and is not a regular file; move it away", str(path))
    if content is not None and path.read_bytes() == content:
        return False
    if not force:
        how = "out of date and no longer needed; --force removes it"
        how = how if content is None else "there with another text; --force replaces it"
        raise OSError(errno.EEXIST, f"the file is {how}", str(path))
    return True
