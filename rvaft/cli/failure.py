"""How the command fails: one line on standard error that says what, where and what to do."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

import click

from rvaft.errors import LanguageError, RvaftError
from rvaft.support.terminal import visible

FOUND: Final = 1
FAILED: Final = 2
INTERRUPTED: Final = 130
BROKEN_PIPE: Final = 141

_WIDTH: Final = 100
"""Columns of a source line that are shown around the caret."""
_LONGEST: Final = 2000
"""Characters of a message; what is longer quotes the input at length."""


class Stopped(Exception):
    """The run ends here with this status; all that had to be said has been said."""

    def __init__(self, status: int) -> None:
        self.status = status
        super().__init__(status)


@contextmanager
def guarded() -> Iterator[None]:
    """Turn a closed pipe and an interrupt into an end of the run; all output is flushed here, where failure is noticed."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        _discard_output()
        raise Stopped(BROKEN_PIPE) from None
    except KeyboardInterrupt:
        with suppress(OSError):
            sys.stdout.flush()
        _discard_output()
        raise Stopped(INTERRUPTED) from None
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, f"cannot write: {error.strerror}", "standard output") from error


def report(error: BaseException) -> None:
    """Say on standard error what went wrong, after whatever standard output already holds."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _discard_output()
    for line in described(error):
        click.echo(line, err=True)


def described(error: BaseException) -> list[str]:
    """The error line, and for a text that is not in its language the place in it."""
    match error:
        case LanguageError():
            where = f"{error.file}:{error.line}:{error.column}: {error.message}"
            return [_line(where), *_caret(error)]
        case RvaftError():
            return [_line("; ".join([str(error), *getattr(error, "__notes__", ())]))]
        case click.UsageError(ctx=ctx):
            hint = f" (see {ctx.command_path} --help)" if ctx is not None else ""
            return [_line(error.format_message() + hint)]
        case click.ClickException():
            return [_line(error.format_message())]
        case OSError():
            reason = error.strerror or str(error) or type(error).__name__
            return [_line(reason if error.filename is None else f"{os.fsdecode(error.filename) or repr('')}: {reason}")]
        case MemoryError():
            return [_line("out of memory")]
        case _:
            return [
                _line(f"this is a defect in rvaft, please report it: {type(error).__name__}: {error}{_origin(error)}")
            ]


def _line(message: str) -> str:
    short = message if len(message) <= _LONGEST else f"{message[:_LONGEST]}…"
    return f"rvaft: error: {visible(short)}"


def _caret(error: LanguageError) -> list[str]:
    """The source line, or the part of it around the column, and a caret below."""
    if not error.source:
        return []
    start = max(0, error.column - 1 - _WIDTH // 2) if len(error.source) > _WIDTH else 0
    part = error.source[start : start + _WIDTH]
    shown = "".join(c if c.isprintable() else " " for c in part)
    return [shown, f"{' ' * (error.column - 1 - start)}^"]


def _origin(error: BaseException) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return "" if trace is None else f" ({trace.tb_frame.f_globals.get('__name__')}:{trace.tb_lineno})"


def _discard_output() -> None:
    """Make the flush at the end of the interpreter go nowhere."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
