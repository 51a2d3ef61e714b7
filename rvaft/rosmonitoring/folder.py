"""Files of one folder, put there together: all or, where anything goes wrong, none."""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path


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
