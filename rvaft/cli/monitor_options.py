"""The options of `rvaft monitor`, and which of them go together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import PurePath
from typing import Any, Final, TypeVar

import click

from rvaft.cli.detections import SUFFIXES, TERMINAL
from rvaft.cli.options import exclusive
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.monitoring.columns import Per
from rvaft.monitoring.keys import MAX_KEYS
from rvaft.monitoring.ordering import DEFAULT_WINDOW

F = TypeVar("F", bound=Callable[..., Any])
DEFAULT_EVERY: Final = 10_000
"""Events between two checkpoints."""


@dataclass(frozen=True, slots=True)
class Monitoring:
    """The options of one call, beside the tree and what part of it is monitored under which semantics."""

    trace: tuple[str, ...]
    word: str | None
    backend: str | None
    per: Per
    form: str
    max_configurations: int | None
    key: str | None
    max_keys: int | None
    order_by: str | None
    window: int | None
    follow: bool
    jobs: int
    explain: str | None
    execute: str | None
    execute_fault: str | None
    execute_attack: str | None
    checkpoint: str | None
    checkpoint_every: int | None

    def check(self, *, branch: int | None, kind: str | None) -> None:
        """Raise `UsageError` for options that do not go together."""
        exclusive(branch=branch, kind=kind, per=None if self.per is Per.TREE else self.per)
        if self.word is not None and self.trace:
            _refuse("--word and TRACE exclude each other")
        if self.backend is not None:
            self._check_backend()
        for option, needed, given in (
            ("--max-keys", "--key", self.key is None and self.max_keys is not None),
            ("--window", "--order-by", self.order_by is None and self.window is not None),
            ("--checkpoint-every", "--checkpoint", self.checkpoint is None and self.checkpoint_every is not None),
        ):
            if given:
                _refuse(f"{option} needs {needed}")
        if self.explain == TERMINAL and self.form == "jsonl":
            _refuse("--explain draws among the text: name a FILE for it with --format jsonl")
        if self.form == "table" and self.key is not None:
            _refuse("--format table is for whole traces, not for --key")

    def check_traces(self, count: int, *, streams: int) -> None:
        """The same once it is known for how many traces the patterns stand, and how many are no files."""
        for option, wanted in (("--follow", self.follow), ("--checkpoint", self.checkpoint is not None)):
            if wanted and (count != 1 or streams or self.word is not None):
                _refuse(f"{option} needs one TRACE, a file")
        if self.jobs > 1 and streams:
            _refuse("--jobs is for files: standard input is read by one process")

    def _check_backend(self) -> None:
        """What only the engine can do."""
        for option, value in (
            ("--explain", self.explain),
            ("--checkpoint", self.checkpoint),
            ("--max-configurations", self.max_configurations),
            # A text knows no kinds: these would never run.
            ("--exec-fault", self.execute_fault),
            ("--exec-attack", self.execute_attack),
        ):
            if value is not None:
                _refuse(f"{option} needs the engine: leave out --backend")


def _refuse(why: str) -> None:
    raise click.UsageError(why, click.get_current_context())


class MonitorCommand(click.Command):
    """`--explain` takes a FILE only where one follows that it can draw to: else the next word is a TRACE."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does it, with what `--explain` means without FILE written out."""
        return super().parse_args(ctx, list(_with_file(args)))


def _with_file(args: Sequence[str]) -> list[str]:
    made: list[str] = []
    for place, word in enumerate(args):
        if word == "--":
            return [*made, *args[place:]]
        following = args[place + 1] if place + 1 < len(args) else ""
        bare = word == "--explain" and PurePath(following).suffix.lower() not in SUFFIXES
        made.append(f"--explain={TERMINAL}" if bare else word)
    return made


def _drawable(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    if value is not None and value != TERMINAL and PurePath(value).suffix.lower() not in SUFFIXES:
        raise click.BadParameter(f"{value!r} has none of the suffixes {', '.join(SUFFIXES)}")
    return value


_OPTIONS: Final = (
    click.argument("trace", nargs=-1, metavar="[TRACE]..."),
    click.option("--word", metavar='"b a c"', help="Watch the default events of these names instead of a trace."),
    click.option("--backend", metavar="BACKEND", help="Run the specification of this backend instead of the engine."),
    click.option(
        "--per",
        type=click.Choice([choice.value for choice in Per]),
        default=Per.TREE.value,
        show_default=True,
        help="Monitor also each branch or each kind.",
    ),
    click.option(
        "--format",
        "form",
        type=click.Choice(["text", "table", "jsonl"]),
        default="text",
        show_default=True,
        help="What to print.",
    ),
    click.option("--explain", metavar="[FILE]", callback=_drawable, help="Draw a detection, in the text or to FILE."),
    click.option("--key", metavar="FIELD", help="Monitor each value of this field by itself."),
    click.option(
        "--max-keys", type=click.IntRange(min=1), metavar="N", help=f"Values of --key.  [default: {MAX_KEYS}]"
    ),
    click.option("--order-by", metavar="FIELD", help="Put events in the order of this number first."),
    click.option(
        "--window",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Events held back by --order-by.  [default: {DEFAULT_WINDOW}]",
    ),
    click.option("--follow", is_flag=True, help="Go on as the file grows, until Ctrl-C."),
    click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, metavar="N", help="Processes."),
    click.option("--exec", "execute", metavar="CMD", help="Run this command on detection."),
    click.option("--exec-fault", "execute_fault", metavar="CMD", help="Run it on detection of a fault."),
    click.option("--exec-attack", "execute_attack", metavar="CMD", help="Run it on detection of an attack."),
    click.option("--checkpoint", metavar="FILE", help="Keep the state in FILE, and go on from it."),
    click.option(
        "--checkpoint-every",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Events between checkpoints.  [default: {DEFAULT_EVERY}]",
    ),
    click.option(
        "--max-configurations",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Partial matches that are followed.  [default: {DEFAULT_LIMIT}]",
    ),
)


def monitoring_options(function: F) -> F:
    """All of them, handed over as one value, `options`."""
    names = set(Monitoring.__dataclass_fields__)

    @wraps(function)
    def called(**given: Any) -> Any:
        own = {name: given.pop(name) for name in names}
        own["per"] = Per(own["per"])
        return function(options=Monitoring(**own), **given)

    made: Any = called
    for option in reversed(_OPTIONS):
        made = option(made)
    return made  # type: ignore[no-any-return]
