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
    target = path.resolve()
    try:
        if target.exists() and not stat.S_ISREG(target.stat().st_mode):
            target.write_bytes(data)
            return
        _replace(target, data)
    except OSError as error:
        raise OSError(error.errno, f"cannot write: {error.strerror}", str(path)) from error


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
