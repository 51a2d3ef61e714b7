"""The `rvaft` command. Each command is an entry point of the group `rvaft.commands` and is imported when it is used.

The package that a command needs contributes it: `cross_check` the command `cross-check`,
`rvaft.integrations` the command `serve`. A third-party package adds a command in the same way.

Exit status: 0 nothing found, 1 found (a detection, a finding of severity error, a disagreement), 2
could not do it; 2 wins over 1. An interrupt ends with 130 and a closed pipe with 141, as if the
signal had done it. Whatever fails is one line on standard error that says what, where and what to
do.
"""

import io
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from typing import Any, Final, TypeVar

import click

from rvaft.errors import LanguageError, RvaftError, ToolFailed
from rvaft.support.terminal import cut, visible

S = TypeVar("S")
T = TypeVar("T")

FOUND: Final = 1
FAILED: Final = 2
INTERRUPTED: Final = 130
BROKEN_PIPE: Final = 141

_WIDTH: Final = 100
"""Columns of a source line that are shown around the caret."""
_LONGEST: Final = 2000
"""Characters of a message; what is longer quotes the input at length."""
GROUP: Final = "rvaft.commands"
"""The entry points of commands: the name of each, and where its `click.Command` is."""
_LISTED: Final = {
    "check": "Report what is wrong or doubtful in trees.",
    "show": "Draw a tree, or write it in another format.",
    "branches": "List the branches of a tree: number, kinds, property.",
    "emit": "Write a specification of a tree.",
    "test": "Compare a tree's own traces with the verdicts expected of them.",
    "monitor": "Watch events for a tree and give verdicts.",
    "report": "Write a page about what happened in logs.",
    "view": "Show browsers that page, also while a log grows.",
    "coverage": "Say which branches some logs exercise.",
    "traces": "Write example logs for a tree.",
    "serve": "Answer ROSMonitoring over WebSocket.",
    "rosmonitoring": "Write a configuration of ROSMonitoring for a tree.",
    "cross-check": "Compare the specifications of trees.",
    "compare": "Compare specification languages: sizes and speeds.",
    "backends": "List the specification languages.",
    "explain": "Explain what a finding means.",
}
"""The order of the commands in `rvaft --help` and their summaries, so that the help text imports
none; others follow.
"""
_UNREADABLE: Final = "(cannot be loaded)"


class Stopped(Exception):
    """The run ends here with this status; all that had to be said has been said."""

    def __init__(self, status: int) -> None:
        self.status = status
        super().__init__(status)


@contextmanager
def guarded() -> Iterator[None]:
    """Turn a closed pipe and an interrupt into an end of the run; all output is flushed here, where
    failure is noticed.
    """
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


def _discard_output() -> None:
    """Make the flush at the end of the interpreter go nowhere."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def report(error: BaseException) -> None:
    """Say on standard error what went wrong, after whatever standard output already holds."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _discard_output()
    click.echo("\n".join(described(error)), err=True)


class Failures:
    """Reports what fails, so that the rest still runs."""

    met = False

    @contextmanager
    def reported(self, *, parts: bool = False) -> Iterator[None]:
        """Do something that may fail; with `parts` a file that only declares what trees import is no failure."""
        try:
            yield
        except (RvaftError, OSError) as error:
            if not (parts and getattr(error, "is_part", False)):
                report(error)
                self.met = True

    def collect(self, make: Callable[[S], T], given: Iterable[S]) -> Iterator[T]:
        """What can be made of these; files that only declare what trees import are left out."""
        for one in given:
            with self.reported(parts=True):
                yield make(one)


def warn(said: str) -> None:
    """Say on standard error what is doubtful."""
    click.echo(visible(f"rvaft: warning: {said}"), err=True)


def described(error: BaseException) -> list[str]:
    """The error line, and for a text that is not in its language the place in it.

    The source line around the column, and a caret.
    """
    place: list[str] = []
    match error:
        case LanguageError(source=source, column=column):
            said = f"{error.file}:{error.line}:{column}: {error.message}"
            if source:
                start = max(0, column - 1 - _WIDTH // 2) if len(source) > _WIDTH else 0
                shown = "".join(c if c.isprintable() else " " for c in source[start : start + _WIDTH])
                place = [shown, f"{' ' * (column - 1 - start)}^"]
        case RvaftError():
            said = "; ".join([str(error), *getattr(error, "__notes__", ())])
        case click.UsageError(ctx=click.Context(command_path=path)):
            said = f"{error.format_message()} (see {path} --help)"
        case click.ClickException():
            said = error.format_message()
        case OSError(filename=file):
            said = error.strerror or str(error) or type(error).__name__
            said = said if file is None else f"{os.fsdecode(file) or repr('')}: {said}"
        case MemoryError():
            said = "out of memory"
        case _:
            trace = error.__traceback__
            while trace is not None and trace.tb_next is not None:
                trace = trace.tb_next
            origin = "" if trace is None else f" ({trace.tb_frame.f_globals.get('__name__')}:{trace.tb_lineno})"
            said = f"this is a defect in rvaft, please report it: {type(error).__name__}: {error}{origin}"
    return [f"rvaft: error: {visible(cut(said, _LONGEST))}", *place]


@cache
def registered() -> dict[str, str]:
    """Return the commands of all installed distributions by name, in the order of `rvaft --help`,
    as `module:attribute`.

    Reads the files of the entry points itself: importing `importlib.metadata` takes half as long as
    all of `rvaft --help`. For a name that several distributions register, rvaft's own wins, then
    the first on the path of Python.
    """
    own: dict[str, str] = {}
    others: dict[str, str] = {}
    for place in dict.fromkeys(sys.path):
        with suppress(OSError):
            for name in sorted(os.listdir(place or os.curdir)):  # noqa: PTH208 (pathlib is slow to import)
                if name.endswith((".dist-info", ".egg-info")):
                    found = own if name.startswith("rvaft-") else others
                    for command, value in _entries(os.path.join(place, name, "entry_points.txt")):  # noqa: PTH118
                        found.setdefault(command, value)
    known = {name: own[name] for name in _LISTED if name in own}
    return known | {name: value for name, value in sorted(others.items()) if name not in known}


def _entries(file: str) -> Iterator[tuple[str, str]]:
    """The commands that a file of entry points lists; none where there is no such file."""
    try:
        with open(file, "rb") as stream:  # noqa: PTH123 (pathlib is slow to import)
            data = stream.read()
    except OSError:
        return
    section = ""
    for line in map(str.strip, data.decode("utf-8", "replace").splitlines() if GROUP.encode() in data else ()):
        if line.startswith("["):
            section = line.strip("[] ")
        elif section == GROUP and "=" in line and not line.startswith(("#", ";")):
            name, _, value = line.partition("=")
            yield name.strip(), value.partition("[")[0].strip()


def loaded(name: str) -> click.Command:
    """Import the command of that name; raises `ToolFailed` where this fails."""
    module, _, attribute = registered()[name].partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except Exception as error:  # a third party's module may fail in any way
        reason = f"it cannot be loaded: {type(error).__name__}: {error}"
        raise ToolFailed(f"the command {name}", reason=reason) from error
    if not isinstance(found, click.Command):
        raise ToolFailed(f"the command {name}", reason=f"{module}:{attribute} is no command of click")
    return found


def _summary(name: str) -> str:
    """What the help text says of a command; only one of a third party is imported for it."""
    if name in _LISTED:
        return _LISTED[name]
    try:
        return loaded(name).get_short_help_str(limit=_WIDTH)
    except ToolFailed:
        return _UNREADABLE


class Commands(click.Group):
    """The commands, imported on use, and one way for all of them to fail.

    A line on standard error, never a traceback.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (the interface of click)
        """The names, in the order of use."""
        return list(registered())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, imported now; an unknown one is an error that lists those there are."""
        known = registered()
        if cmd_name in known:
            return loaded(cmd_name)
        if cmd_name.startswith("-"):
            return None
        if cmd_name in _LISTED:
            remedy = "install rvaft again, in a checkout with pip install -e ."
            raise click.ClickException(f"the command {cmd_name} is not installed: {remedy}")
        from difflib import get_close_matches  # noqa: PLC0415 -- imported on use

        meant = get_close_matches(cmd_name, known, n=1)
        hint = f"; did you mean {meant[0]}?" if meant else ""
        raise click.UsageError(f"unknown command {cmd_name!r}; known: {', '.join(known)}{hint}", ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """The list of commands in the help text."""
        if rows := [(name, _summary(name)) for name in registered()]:
            with formatter.section("Commands"):
                formatter.write_dl(rows)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """As click does it; the help text is printed here."""
        with guarded():
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; its result is the exit status."""
        with guarded():
            return super().invoke(ctx)

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run and exit; with `standalone_mode` off return the exit status instead."""
        extra["prog_name"] = extra.get("prog_name") or "rvaft"
        main: Any = super().main
        try:
            if isinstance(sys.stdout, io.TextIOWrapper):
                sys.stdout.reconfigure(errors="backslashreplace")  # it takes every text
            if sys.stdout is None:
                report(click.ClickException("standard output is closed"))
                status = FAILED
            else:
                status = int(main(*args, standalone_mode=False, **extra) or 0)
        except Stopped as stopped:
            status = stopped.status
        except (KeyboardInterrupt, click.Abort):
            status = INTERRUPTED
        except Exception as error:  # noqa: BLE001 (the last resort: no traceback for any user)
            try:
                report(error)
                status = FAILED
            except BrokenPipeError:
                status = BROKEN_PIPE
        if standalone_mode:
            sys.exit(status)
        return status


def _version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        click.echo(f"rvaft {import_module('importlib.metadata').version('rvaft')}")
        ctx.exit()


@click.group(
    "rvaft",
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit status: 0 nothing found, 1 found (a detection, an error in a tree), 2 could not do it.",
)
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Print the version and exit."
)
@click.pass_context
def main(ctx: click.Context) -> None:
    """Attack-fault trees with runtime events: check, draw, translate and monitor them."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
