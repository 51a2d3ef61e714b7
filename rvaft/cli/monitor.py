"""`rvaft monitor`: watch events for a tree and give verdicts."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, Final, TypeAlias, TypeVar

import click

from rvaft.analysis.pattern_index import TreeReads
from rvaft.api import load, monitor, narrowed, translate
from rvaft.cli.failure import report
from rvaft.cli.monitor_output import JsonLines, Reporter, Shape, Sink, Text, warning
from rvaft.cli.monitor_run import SUFFIXES, TERMINAL, Manner, Trace, require_drawable, run
from rvaft.cli.options import exclusive, part_options, semantics_option, standard_input, suggesting, tree_argument
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge
from rvaft.model.expressions import on_text
from rvaft.model.nodes import Kind
from rvaft.model.patterns import match
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitoring.monitor_set import MAX_KEYS, Bank, Per, columns
from rvaft.monitoring.reader import LogFile, expanded
from rvaft.monitoring.run import Plan
from rvaft.monitoring.stream import DEFAULT_WINDOW, Field
from rvaft.monitors import Monitor
from rvaft.rules.rule import listing

if TYPE_CHECKING:
    from rvaft.monitoring.checkpoint import Keeping
    from rvaft.monitoring.hooks import Hooks


# The options of `rvaft monitor`, and which of them go together.

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


Make: TypeAlias = Callable[[RVAFT], Monitor]


@click.command("monitor", cls=MonitorCommand)
@tree_argument
@semantics_option
@part_options
@monitoring_options
def monitor_command(*, tree: str, semantics: str, branch: int | None, kind: str | None, options: Monitoring) -> int:
    """Watch the events of each TRACE (JSON Lines) for a tree and give verdicts.

    A TRACE may be a pattern such as 'logs/**/*.jsonl'. No TRACE, or -, reads standard input as it comes. The exit status is 1 when
    the tree is detected in some trace.
    """
    options.check(branch=branch, kind=kind)
    if options.explain is not None:
        require_drawable(options.explain)
    whole = load(tree)
    part = narrowed(whole, branch, kind)
    found = columns(part, options.per)
    bank = Bank(found, _maker(options, semantics), Semantics(semantics))
    traces, missing = _traces(options, whole)
    options.check_traces(len(traces) + missing, streams=sum(trace.stream is not None for trace in traces))
    several = len(traces) + missing > 1
    shape = Shape(whole, found, options.per, options.key, several)
    manner = Manner(
        _plan(options, bank, whole),
        shape,
        _reporter(options),
        tree=click.format_filename(tree),
        counted=options.form == "text" or options.checkpoint is not None,
        hooks=_hooks(options),
        drawing=None if options.explain == TERMINAL else options.explain,
        keeping=_keeping(options, part, semantics, traces),
        follow=options.follow,
    )
    return run(manner, traces, options.jobs, failed=missing > 0)


def _maker(options: Monitoring, semantics: str) -> Make:
    """What makes the monitor of a part of the tree."""
    backend = options.backend
    if backend is None:
        return partial(_engine, semantics=semantics, limit=options.max_configurations or DEFAULT_LIMIT)

    def make(part: RVAFT) -> Monitor:
        with suggesting():
            return translate(part, backend, semantics=semantics).monitor()

    return make


def _engine(part: RVAFT, *, semantics: str, limit: int) -> Monitor:
    try:
        return monitor(part, semantics=semantics, limit=limit)
    except TooLarge as error:
        error.add_note("--max-configurations allows more")
        raise


def _plan(options: Monitoring, bank: Bank, tree: RVAFT) -> Plan:
    key = None if options.key is None else Field.parse(options.key)
    order = None if options.order_by is None else Field.parse(options.order_by)
    reads = TreeReads(tree, [field.path for field in (key, order) if field is not None])
    window = options.window or DEFAULT_WINDOW
    return Plan(bank, reads, key, options.max_keys or MAX_KEYS, options.order_by, window)


def _reporter(options: Monitoring) -> Callable[[Shape, Sink], Reporter]:
    if options.form == "jsonl":
        return JsonLines
    drawn = options.explain == TERMINAL
    if options.form == "table":
        from rvaft.cli.monitor_output import Table  # noqa: PLC0415 -- imported on use

        return lambda shape, sink: Table(shape, sink, drawn=drawn)
    return lambda shape, sink: Text(shape, sink, drawn=drawn)


def _hooks(options: Monitoring) -> "Hooks | None":
    if options.execute is None and options.execute_fault is None and options.execute_attack is None:
        return None
    from rvaft.monitoring.hooks import Hooks  # noqa: PLC0415 -- imported on use

    by_kind = {Kind.FAULT: options.execute_fault, Kind.ATTACK: options.execute_attack}
    return Hooks(options.execute, {kind: command for kind, command in by_kind.items() if command is not None})


def _keeping(options: Monitoring, part: RVAFT, semantics: str, traces: Sequence[Trace]) -> "Keeping | None":
    file = traces[0].file if traces else None
    if options.checkpoint is None or file is None:
        return None
    from rvaft.monitoring.checkpoint import Keeping  # noqa: PLC0415 -- imported on use

    given = {"--key": options.key, "--order-by": options.order_by, "--window": options.window}
    return Keeping(
        Path(options.checkpoint),
        Path(file.name),
        part,
        Semantics(semantics),
        options.checkpoint_every or DEFAULT_EVERY,
        {name: str(value) for name, value in given.items() if value is not None},
    )


def _traces(options: Monitoring, tree: RVAFT) -> tuple[list[Trace], int]:
    """The traces to watch, and how many are not there, which has been reported."""
    if options.word is not None:
        return [_word(options.word, tree)], 0
    found: list[Trace] = []
    missing = 0
    for name in options.trace or ("-",):
        try:
            found += [_stream()] if name == "-" else _files(name)
        except OSError as error:
            report(error)
            missing += 1
    return found, missing


def _files(name: str) -> Iterator[Trace]:
    return (Trace(click.format_filename(file), LogFile.find(file)) for file in expanded(name))


def _stream() -> Trace:
    return Trace("<stdin>", stream=standard_input("TRACE"))


def _word(word: str, tree: RVAFT) -> Trace:
    """Each letter as the default event of that name, also where the node of that name has another event."""
    letters = word.split()
    unknown: list[str] = []
    for letter in dict.fromkeys(letters):
        node = tree.nodes.get(letter)
        if node is not None and node.on is not None:
            _warn(f"the letter {letter} is its default event, but the node {letter} has the event {on_text(node.on)}")
        elif not any(match(relevant.pattern, {"event": letter}, {}) is not None for relevant in tree.alphabet):
            unknown.append(letter)
    if unknown:
        _warn(f"no node has the default event {listing(unknown, 'or')}")
    return Trace("word", events=[{"event": letter} for letter in letters])


def _warn(said: str) -> None:
    click.echo(warning(said), err=True)
