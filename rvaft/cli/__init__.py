"""The `rvaft` command: the top layer, thin. One module per command, imported when the command is used.

Exit status: 0 nothing found, 1 found (a detection, a finding of severity error, a disagreement), 2 could not do it; 2 wins
over 1. An interrupt ends with 130 and a closed pipe with 141, as if the signal had done it.
"""

import io
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any, Final

import click

from rvaft.cli.failure import BROKEN_PIPE, FAILED, INTERRUPTED, Stopped, guarded, report

_COMMANDS: Final = {
    "check": "Report what is wrong or doubtful in trees.",
    "show": "Draw a tree, or write it in another format.",
    "branches": "List the branches of a tree: number, kinds, property.",
    "emit": "Write a specification of a tree.",
    "test": "Compare a tree's own traces with the verdicts expected of them.",
    "monitor": "Watch events for a tree and give verdicts.",
    "coverage": "Say which branches some logs exercise.",
    "traces": "Write example logs for a tree.",
    "serve": "Answer ROSMonitoring over WebSocket.",
    "rosmonitoring": "Write a configuration of ROSMonitoring for a tree.",
    "cross-check": "Compare the specifications of trees.",
    "compare": "Compare specification languages: sizes and speeds.",
    "backends": "List the specification languages.",
    "explain": "Explain what a finding means.",
}
"""The commands and what they do; each is a function, `check_command` for `check`, in the module of its name or in the one named here."""
_MODULES: Final = {
    **dict.fromkeys(["backends", "branches", "explain"], "information"),
    **dict.fromkeys(["rosmonitoring", "serve"], "ros"),
}


class Commands(click.Group):
    """The commands, imported on use, and one way for all of them to fail: a line on standard error, never a traceback."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 (the interface of click)
        """The names, in the order of use."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of that name, imported now."""
        if cmd_name not in _COMMANDS:
            return None
        name = cmd_name.replace("-", "_")
        module = import_module(f"rvaft.cli.{_MODULES.get(name, name)}")
        found: click.Command = getattr(module, f"{name}_command")
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the arguments name; an unknown one is an error that lists those there are."""
        if args and not args[0].startswith("-") and args[0] not in _COMMANDS:
            from difflib import get_close_matches  # noqa: PLC0415 -- imported on use

            meant = get_close_matches(args[0], _COMMANDS, n=1)
            hint = f"; did you mean {meant[0]}?" if meant else ""
            raise click.UsageError(f"unknown command {args[0]!r}; known: {', '.join(_COMMANDS)}{hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """The list of commands in the help text, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))

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

        def run() -> Any:
            if isinstance(sys.stdout, io.TextIOWrapper):
                sys.stdout.reconfigure(errors="backslashreplace")  # it takes every text
            elif sys.stdout is None:
                raise click.ClickException("standard output is closed")
            return main(*args, standalone_mode=False, **extra)

        status = _status(run)
        if standalone_mode:
            sys.exit(status)
        return status


def _status(run: Callable[[], Any]) -> int:
    """The exit status of a run; whatever goes wrong is said on standard error."""
    try:
        return int(run() or 0)
    except Stopped as stopped:
        return stopped.status
    except (KeyboardInterrupt, click.Abort):
        return INTERRUPTED
    except Exception as error:  # noqa: BLE001 (the last resort: no traceback for any user)
        try:
            report(error)
        except BrokenPipeError:
            return BROKEN_PIPE
        return FAILED


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
