"""Where the output of a command goes: standard output, or a file that is whole or not there."""

import os
import stat
import sys
import tempfile
from pathlib import Path

import click


def deliver(data: bytes, output: str | None, *, binary: bool = False) -> None:
    """Write to a file, or to standard output without one or for `-`; binary data is refused by a terminal."""
    if output is not None and output != "-":
        write_whole(Path(output), data)
        return
    if binary and sys.stdout.isatty():
        raise click.UsageError("this format is binary: name a file with -o, or redirect standard output")
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
