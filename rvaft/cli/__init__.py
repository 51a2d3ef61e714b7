"""The `rvaft` command. Commands are entry points of the group `rvaft.commands`, imported on use.

The package that implements a command registers it, as a third-party package does: `cross_check`
registers `cross-check`, `rvaft.integrations` registers `serve`.

Exit status: 0 nothing found; 1 found (a detection, a finding of severity error, a disagreement); 2
an error, which wins over 1; 130 interrupted; 141 closed pipe; 143 terminated. An error is one line
on standard error with the problem, its place and a remedy.
"""

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from typing import Any, Final, TextIO, TypeVar

import click

from rvaft.errors import LanguageError, RvaftError, ToolFailed
from rvaft.support import output
from rvaft.support.collector import exempt_all, no_collections
from rvaft.support.terminal import cut, inert, takes_colour, visible

S = TypeVar("S")
T = TypeVar("T")

FOUND: Final = 1
FAILED: Final = 2
INTERRUPTED: Final = 130
BROKEN_PIPE: Final = 141
TERMINATED: Final = 143
_PATIENCE: Final = 2.0
"""Seconds to end after SIGTERM."""

_WIDTH: Final = 100
"""Columns of a source line shown around the caret."""
_LONGEST: Final = 2000
GROUP: Final = "rvaft.commands"
"""The entry-point group of the commands; each value is `module:attribute` of a `click.Command`."""
_GROUPS: Final[dict[str, dict[str, str]]] = {
    "Model": {
        "check": "Report errors and doubtful parts of trees.",
        "explain": "Explain the code of a finding.",
        "test": "Compare verdicts on a tree's traces with the expected ones.",
        "show": "Draw a tree, or write it in another format.",
        "branches": "List the branches of a tree: number, kinds, property.",
        "fields": "List the kinds of events in a log, and their fields.",
        "infer": "Write a tree to start from, inferred from a log.",
        "new": "Write a tree to start from, with the language in comments.",
        "lsp": "Serve editors: findings, completion, definitions, layout.",
    },
    "Monitor": {
        "monitor": "Monitor the events of logs and print verdicts.",
        "report": "Write an HTML page about the events in logs.",
        "view": "Serve that page to browsers, also while a log grows.",
        "coverage": "Report which branches logs exercise.",
        "traces": "Write example logs for a tree.",
        "robust": "Report what a lost, doubled or swapped event does.",
        "serve": "Serve verdicts to ROSMonitoring over WebSocket.",
        "rosmonitoring": "Write a ROSMonitoring configuration for a tree.",
    },
    "Risk": {
        "cut-sets": "List the least sets of leaves that bring the root about.",
        "risk": "Compute the probability of the root, and what matters to it.",
        "attacks": "List attacks with cost, probability and damage.",
        "rates": "Estimate the rates of the leaves from logs.",
    },
    "Translate": {
        "emit": "Write a specification of a tree in another language.",
        "backends": "List the specification languages.",
        "build": "Compile a native monitor for one tree.",
    },
    "Check translations": {"cross-check": "Compare the specifications of trees on traces."},
    "Papers": {"compare": "Compare specification languages: sizes and speeds."},
}
"""The commands by the headings of `rvaft --help`, with their summaries: the help imports no
command.
"""
_OTHERS: Final = "Other commands"
_LISTED: Final = {name: text for group in _GROUPS.values() for name, text in group.items()}
_UNREADABLE: Final = "(cannot be loaded)"
_COLOURS: Final = {"error": "red", "warning": "yellow", "information": "blue"}


class Stopped(Exception):
    """Ends the run with this status, without a message."""

    def __init__(self, status: int) -> None:
        self.status = status
        super().__init__(status)


@contextmanager
def guarded() -> Iterator[None]:
    """Flush standard output at the end; raise `Stopped` for a closed pipe or an interrupt."""
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
    """Redirect standard output, so that the interpreter's last flush succeeds."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def report(error: BaseException) -> None:
    """Print an error, after the pending standard output."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _discard_output()
    click.echo(painted(inert("\n".join(described(error))), "rvaft: error:", "error", sys.stderr), err=True)


class Failures:
    """Reports errors and lets the remaining work continue."""

    met = False

    @contextmanager
    def reported(self, *, parts: bool = False) -> Iterator[None]:
        """Report an error of the block; with `parts`, a file that only declares imports is no
        error.
        """
        try:
            yield
        except (RvaftError, OSError) as error:
            if not (parts and getattr(error, "is_part", False)):
                report(error)
                self.met = True

    def collect(self, make: Callable[[S], T], given: Iterable[S]) -> Iterator[T]:
        """Yield `make(one)` for each; skip files that only declare what trees import."""
        for one in given:
            with self.reported(parts=True):
                yield make(one)


def warn(message: str) -> None:
    """Print a warning on standard error."""
    line = inert(visible(f"rvaft: warning: {message}"))
    click.echo(painted(line, "rvaft: warning:", "warning", sys.stderr), err=True)


def painted(text: str, mark: str, severity: str, stream: TextIO) -> str:
    """Return a message whose first `mark` has the colour of a severity, on a terminal."""
    if not takes_colour(stream):
        return text
    return text.replace(mark, click.style(mark, fg=_COLOURS[severity], bold=True), 1)


def described(error: BaseException) -> list[str]:
    """Return the error line; for a syntax error also the source line and a caret."""
    place: list[str] = []
    match error:
        case LanguageError(source=source, column=column):
            message = f"{error.file}:{error.line}:{column}: {error.message}"
            if source:
                start = max(0, column - 1 - _WIDTH // 2) if len(source) > _WIDTH else 0
                shown = "".join(c if c.isprintable() else " " for c in source[start : start + _WIDTH])
                place = [shown, f"{' ' * (column - 1 - start)}^"]
        case RvaftError():
            message = "; ".join([str(error), *getattr(error, "__notes__", ())])
        case click.UsageError(ctx=click.Context(command_path=path)):
            message = f"{error.format_message()} (see {path} --help)"
        case click.ClickException():
            message = error.format_message()
        case OSError(filename=file):
            message = error.strerror or str(error) or type(error).__name__
            message = message if file is None else f"{os.fsdecode(file) or repr('')}: {message}"
        case MemoryError():
            message = "out of memory"
        case _:
            trace = error.__traceback__
            while trace is not None and trace.tb_next is not None:
                trace = trace.tb_next
            origin = "" if trace is None else f" ({trace.tb_frame.f_globals.get('__name__')}:{trace.tb_lineno})"
            message = f"this is a defect in rvaft, please report it: {type(error).__name__}: {error}{origin}"
    return [f"rvaft: error: {visible(cut(message, _LONGEST))}", *place]


@cache
def registered() -> dict[str, str]:
    """Return the installed commands as `{name: "module:attribute"}`, in help order.

    Parses the entry-point files directly: importing `importlib.metadata` takes half as long as
    `rvaft --help`. Of equal names, rvaft's own wins, then the first on `sys.path`.
    """
    own: dict[str, str] = {}
    others: dict[str, str] = {}
    for place in dict.fromkeys(sys.path):
        with suppress(OSError):
            for name in sorted(os.listdir(place or os.curdir)):  # noqa: PTH208
                if name.endswith((".dist-info", ".egg-info")):
                    found = own if name.startswith("rvaft-") else others
                    for command, value in _entries(os.path.join(place, name, "entry_points.txt")):  # noqa: PTH118
                        found.setdefault(command, value)
    known = {name: own[name] for name in _LISTED if name in own}
    return known | {name: value for name, value in sorted(others.items()) if name not in known}


def _entries(file: str) -> Iterator[tuple[str, str]]:
    try:
        with open(file, "rb") as stream:  # noqa: PTH123 (pathlib imports slowly)
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
    """Import a command; raises `ToolFailed`."""
    module, _, attribute = registered()[name].partition(":")
    try:
        with no_collections():
            found = getattr(import_module(module), attribute)
    except Exception as error:
        reason = f"it cannot be loaded: {type(error).__name__}: {error}"
        raise ToolFailed(f"the command {name}", reason=reason) from error
    if not isinstance(found, click.Command):
        raise ToolFailed(f"the command {name}", reason=f"{module}:{attribute} is not a click command")
    return found


def _summary(name: str) -> str:
    """Return the summary; only third-party commands are imported for it."""
    if name in _LISTED:
        return _LISTED[name]
    try:
        return loaded(name).get_short_help_str(limit=_WIDTH)
    except ToolFailed:
        return _UNREADABLE


class Commands(click.Group):
    """The group of commands; imports them on use and prints errors as one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names in help order."""
        return list(registered())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; the error for an unknown name lists the known ones."""
        known = registered()
        if cmd_name in known:
            return loaded(cmd_name)
        if cmd_name.startswith("-"):
            return None
        if cmd_name in _LISTED:
            remedy = "install rvaft again, in a checkout with pip install -e ."
            raise click.ClickException(f"the command {cmd_name} is not installed: {remedy}")
        from difflib import get_close_matches  # noqa: PLC0415

        meant = get_close_matches(cmd_name, known, n=1)
        if cmd_name.endswith((".rvaft", ".dft")):
            raise click.UsageError(f"{cmd_name} is a tree: name a command first, as in rvaft show {cmd_name}", ctx)
        hint = f"; did you mean {meant[0]}?" if meant else ""
        raise click.UsageError(f"unknown command {cmd_name!r}; known: {', '.join(known)}{hint}", ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the commands into the help text by purpose."""
        known = registered()
        widest = max(map(len, known), default=0)
        others = [name for name in known if name not in _LISTED]
        for heading, names in (*_GROUPS.items(), (_OTHERS, others)):
            if rows := [(name.ljust(widest), _summary(name)) for name in names if name in known]:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Make the context and print the help text, if requested."""
        with guarded():
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command and return the exit status."""
        with guarded():
            return super().invoke(ctx)

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run and exit; without `standalone_mode` return the exit status."""
        extra["prog_name"] = extra.get("prog_name") or "rvaft"
        before = None
        if standalone_mode and threading.current_thread() is threading.main_thread():
            before = signal.signal(signal.SIGTERM, _terminate)
        main: Any = super().main
        try:
            if isinstance(sys.stdout, io.TextIOWrapper):
                sys.stdout.reconfigure(errors="backslashreplace")
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
        output.finish()
        if before is not None:
            signal.signal(signal.SIGTERM, before)
        if standalone_mode:
            exempt_all()
            sys.exit(status)
        return status


def _terminate(_signal: int, _frame: object) -> None:
    """End this process with what it has started: other processes and temporary folders.

    Python drops an exception in some callbacks, so that the process is ended a little later all the same.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    later = threading.Timer(_PATIENCE, os.kill, (os.getpid(), signal.SIGTERM))
    later.daemon = True
    later.start()
    raise SystemExit(TERMINATED)


def _version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        click.echo(f"rvaft {import_module('importlib.metadata').version('rvaft')}")
        ctx.exit()


@click.group(
    "rvaft",
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit status: 0 nothing found, 1 found (a detection, an error in a tree), 2 error.",
)
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Print the version and exit."
)
@click.pass_context
def main(ctx: click.Context) -> None:
    """Attack-fault trees with runtime events: check, draw, translate and monitor them."""
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
