"""The cache of compiled programs: a folder of the user alone, whose files are checked before use."""

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Final

from backends.c.library import compile_monitor, require_compiler
from rvaft.support.files import replacement

try:
    import fcntl
except ImportError:  # a system without owners of files has no cache
    fcntl = None  # type: ignore[assignment]

_MAGIC: Final = b"rvaft native 2\n"
"""Begins a file of the cache; the checksum of the program and the program follow."""
_STAGED: Final = ".rvaft-"
_OTHERS: Final = stat.S_IWGRP | stat.S_IWOTH


@contextmanager
def cached_program(text: str, capacity: int, warn: Callable[[str], object]) -> Iterator[Path]:
    """Yield a program with places from the cache of the user, compiled where it is not there."""
    options = ("-DRVAFT_MAIN=1", f"-DRVAFT_CAPACITY={capacity}", "-DRVAFT_PLACES=1")
    with _cached(text, options, warn) as program:
        yield program


@contextmanager
def cached_library(text: str, capacity: int, keys: int, warn: Callable[[str], object]) -> Iterator[Path]:
    """Yield a library for `rvaft_log_read` from the cache of the user, compiled where it is not there."""
    sizes = f"-DRVAFT_CAPACITY={capacity}", f"-DRVAFT_KEYS={keys}"
    with _cached(text, (*sizes, "-DRVAFT_PLACES=1", "-shared", "-fPIC"), warn) as library:
        yield library


@contextmanager
def _cached(text: str, options: Sequence[str], warn: Callable[[str], object]) -> Iterator[Path]:
    """Yield a private copy of a compiled text, which exists during the block.

    The copy consists of the bytes whose checksum was verified, so that nothing that happens to the
    cache afterwards changes it. A cache that cannot be trusted or written is not used.
    """
    command = require_compiler()
    with ExitStack() as stack:
        cache, private = _folders(stack, warn)
        program = private / "monitor"
        entry = None if cache is None else cache / _key(text, options, command)
        data = None if entry is None else _verified(entry)
        if data is not None:
            program.write_bytes(data)
            program.chmod(0o700)
        else:
            compile_monitor(text, program, options)
            if entry is not None:
                try:
                    _store(entry, program.read_bytes())
                except OSError as error:
                    warn(f"{entry}: cannot keep the native program: {error.strerror}")
        yield program


def _folders(stack: ExitStack, warn: Callable[[str], object]) -> tuple[Path | None, Path]:
    """Return the folder of the cache, or None with a warning, and a private folder for the run."""
    try:
        cache = _trusted_folder()
        _lock(stack, cache)
        return cache, Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=_STAGED, dir=cache)))
    except OSError as error:
        where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
        warn(f"{where}the cache of native programs is not used: {error.strerror}")
        return None, Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rvaft-")))


def _trusted_folder() -> Path:
    """Return the folder of the cache, created if absent; raises `OSError` if others could write into it."""
    if fcntl is None:
        raise OSError(None, "this system does not tell the owners of files")
    named = os.environ.get("XDG_CACHE_HOME", "")
    try:
        home = Path(named) if os.path.isabs(named) else Path.home() / ".cache"  # noqa: PTH117 (as XDG defines it)
    except RuntimeError as error:
        raise OSError(None, str(error)) from error
    above = next(place for place in (home, *home.parents) if place.exists())
    _require_own(above, above.stat(), (os.geteuid(), 0))
    home.mkdir(parents=True, exist_ok=True, mode=0o700)
    folder = home
    for name in ("rvaft", "native"):
        folder = folder / name
        folder.mkdir(exist_ok=True, mode=0o700)
        _require_own(folder, folder.lstat(), (os.geteuid(),))
    return folder


def _require_own(folder: Path, found: os.stat_result, owners: Sequence[int]) -> None:
    if not stat.S_ISDIR(found.st_mode):
        raise OSError(None, "this is no folder, or a link to one", os.fspath(folder))
    if found.st_uid not in owners:
        raise OSError(None, "the folder belongs to another user", os.fspath(folder))
    sticky = found.st_mode & stat.S_ISVTX and 0 in owners  # a folder such as /tmp: nobody can rename what is ours
    if found.st_mode & _OTHERS and not sticky:
        raise OSError(None, "others may write to the folder (chmod go-w)", os.fspath(folder))


def _lock(stack: ExitStack, cache: Path) -> None:
    """Mark the cache as in use; remove what killed runs left, if no other run uses it."""
    handle = os.open(cache / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    stack.callback(os.close, handle)
    with suppress(BlockingIOError):
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for left in cache.glob(f"{_STAGED}*"):
            shutil.rmtree(left, ignore_errors=True)
    fcntl.flock(handle, fcntl.LOCK_SH)


def _key(text: str, options: Sequence[str], command: Sequence[str]) -> str:
    """Return the name of a program: of its text, options, machine, and compiler with size and date of its file."""
    found = shutil.which(command[0])
    about = None if found is None else os.stat(found)  # noqa: PTH116 (follows links)
    version = None if about is None else (os.path.realpath(found or ""), about.st_size, about.st_mtime_ns)
    machine = sys.platform, os.uname().machine
    return sha256(repr((text, *options, *command, version, *machine)).encode()).hexdigest()


def _verified(entry: Path) -> bytes | None:
    """Return the program in a file of the cache; None unless it is whole and of the user alone."""
    try:
        handle = os.open(entry, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    with os.fdopen(handle, "rb") as stream:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & _OTHERS:
            return None
        data = stream.read()
    start = len(_MAGIC) + sha256().digest_size
    checksum, program = data[len(_MAGIC) : start], data[start:]
    return program if data.startswith(_MAGIC) and checksum == sha256(program).digest() else None


def _store(entry: Path, program: bytes) -> None:
    with replacement(entry) as stream:  # with mode 0600
        stream.write(_MAGIC + sha256(program).digest() + program)
