"""`rvaft monitor`: watch events for a tree and give verdicts."""

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, Final

import click

from rvaft.analysis.pattern_index import TreeReads
from rvaft.api import load, monitor, narrowed, translate
from rvaft.cli.failure import report
from rvaft.cli.monitor_output import (
    JsonReporter,
    OutputShape,
    Reporter,
    Sink,
    TableReporter,
    TextReporter,
    warning,
)
from rvaft.cli.monitor_run import SUFFIXES, TERMINAL, MonitorSettings, TraceSource, require_drawable, run
from rvaft.cli.options import exclusive, part_options, semantics_option, standard_input, suggesting, tree_argument
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge
from rvaft.model.expressions import on_text
from rvaft.model.nodes import Kind
from rvaft.model.patterns import match
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitoring.checkpoint import EVERY, CheckpointFile
from rvaft.monitoring.explanation_json import told_fields
from rvaft.monitoring.monitor_set import MonitorSet, Per, columns
from rvaft.monitoring.reader import expanded
from rvaft.monitoring.run import MAX_KEYS, MonitoringPlan
from rvaft.monitoring.stream import DEFAULT_WINDOW, Field, Key
from rvaft.monitors import Monitor
from rvaft.rules.rule import listing

if TYPE_CHECKING:
    from rvaft.monitoring.hooks import Hooks

_POSITIVE: Final = click.IntRange(min=1)


class MonitorCommand(click.Command):
    """`--explain` takes a FILE only where one follows that it can draw to: else the next word is a TRACE."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does it, with what `--explain` means without FILE written out."""
        made: list[str] = []
        for place, word in enumerate(args):
            if word == "--":
                made += args[place:]
                break
            following = args[place + 1] if place + 1 < len(args) else ""
            bare = word == "--explain" and PurePath(following).suffix.lower() not in SUFFIXES
            made.append(f"--explain={TERMINAL}" if bare else word)
        return super().parse_args(ctx, made)


def _drawable(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    if value is not None and value != TERMINAL and PurePath(value).suffix.lower() not in SUFFIXES:
        raise click.BadParameter(f"{value!r} has none of the suffixes {', '.join(SUFFIXES)}")
    return value


@click.command("monitor", cls=MonitorCommand)
@tree_argument
@semantics_option
@part_options
@click.argument("traces", nargs=-1, metavar="[TRACE]...")
@click.option("--word", metavar='"b a c"', help="Watch the default events of these names instead of a trace.")
@click.option("--backend", metavar="BACKEND", help="Run the specification of this backend instead of the engine.")
@click.option(
    "--per",
    type=click.Choice([choice.value for choice in Per]),
    default=Per.TREE.value,
    show_default=True,
    help="Monitor also each branch or each kind.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "table", "jsonl"]),
    default="text",
    show_default=True,
    help="What to print.",
)
@click.option("--detections", is_flag=True, help="With --format jsonl, only the events that detect something.")
@click.option("--explain", metavar="[FILE]", callback=_drawable, help="Draw a detection, in the text or to FILE.")
@click.option(
    "--key", multiple=True, metavar="FIELD", help="Monitor each value of this field by itself; several are one key."
)
@click.option("--max-keys", type=_POSITIVE, metavar="N", help=f"Values of --key.  [default: {MAX_KEYS}]")
@click.option("--order-by", metavar="FIELD", help="Put events in the order of this number first.")
@click.option(
    "--window", type=_POSITIVE, metavar="N", help=f"Events held back by --order-by.  [default: {DEFAULT_WINDOW}]"
)
@click.option("--follow", is_flag=True, help="Go on as the file grows, until Ctrl-C.")
@click.option("--jobs", type=_POSITIVE, default=1, show_default=True, metavar="N", help="Processes.")
@click.option("--exec", "execute", metavar="CMD", help="Run this command on detection.")
@click.option("--exec-fault", metavar="CMD", help="Run it on detection of a fault.")
@click.option("--exec-attack", metavar="CMD", help="Run it on detection of an attack.")
@click.option("--checkpoint", metavar="FILE", help="Keep the state in FILE, and go on from it.")
@click.option(
    "--checkpoint-every", type=_POSITIVE, metavar="N", help=f"Events between checkpoints.  [default: {EVERY}]"
)
@click.option(
    "--max-configurations",
    type=_POSITIVE,
    metavar="N",
    help=f"Partial matches that are followed.  [default: {DEFAULT_LIMIT}]",
)
def monitor_command(*, tree: str, semantics: str, branch: int | None, kind: str | None, **options: Any) -> int:
    """Watch the events of each TRACE (JSON Lines) for a tree and give verdicts.

    A TRACE may be a pattern such as 'logs/**/*.jsonl'. No TRACE, or -, reads standard input as it comes. The exit status is 1 when
    the tree is detected in some trace.
    """
    per = Per(options["per"])
    exclusive(branch=branch, kind=kind, per=None if per is Per.TREE else per)
    _check(options)
    if options["explain"] is not None:
        require_drawable(options["explain"])
    whole = load(tree)
    part = narrowed(whole, branch, kind)
    found = columns(part, per)
    meaning = Semantics(semantics)
    monitors = MonitorSet(found, _maker(options["backend"], meaning, options["max_configurations"]), meaning)
    traces, missing = _sources(options, whole)
    count = len(traces) + missing
    _check_traces(options, traces, count)
    key = Key.parse(options["key"]) if options["key"] else None
    order = None if options["order_by"] is None else Field.parse(options["order_by"])
    also = [field.path for field in (*(key.fields if key else ()), *([order] if order else []))]
    checkpoints = None
    if options["checkpoint"] is not None and traces[0].file is not None:
        given = {
            "--key": ", ".join(options["key"]) or None,
            "--order-by": order and order.text,
            "--window": options["window"],
        }
        checkpoints = CheckpointFile(
            Path(options["checkpoint"]),
            tree=part,
            semantics=meaning,
            columns=[column.label for column in found],
            trace=Path(traces[0].file),
            every=options["checkpoint_every"] or EVERY,
            settings={name: str(value) for name, value in given.items() if value is not None},
        )
    form, drawn = options["form"], options["explain"] == TERMINAL
    reporter: Callable[[OutputShape, Sink], Reporter] = partial(JsonReporter, detections=options["detections"])
    if form != "jsonl":
        reporter = partial(TableReporter if form == "table" else TextReporter, drawn=drawn)
    settings = MonitorSettings(
        MonitoringPlan(
            monitors,
            TreeReads(whole, also),
            key,
            options["max_keys"] or MAX_KEYS,
            options["order_by"],
            options["window"] or DEFAULT_WINDOW,
            told_fields(whole),
        ),
        OutputShape(whole, found, per, key, several=count > 1),
        reporter,
        tree=click.format_filename(tree),
        counted=form == "text" or checkpoints is not None,
        hooks=_hooks(options),
        drawing=None if drawn else options["explain"],
        checkpoints=checkpoints,
        follow=options["follow"],
    )
    return run(settings, traces, options["jobs"], failed=missing > 0)


# -- which options go together ------------------------------------------------------------------------------------------


def _refuse(why: str) -> None:
    raise click.UsageError(why, click.get_current_context())


def _check(options: dict[str, Any]) -> None:
    if options["word"] is not None and options["traces"]:
        _refuse("--word and TRACE exclude each other")
    if options["backend"] is not None:
        # A text explains nothing, keeps nothing, and knows no kinds: commands for these would never run.
        for name in ("explain", "checkpoint", "max_configurations", "exec_fault", "exec_attack"):
            if options[name] is not None:
                _refuse(f"--{name.replace('_', '-')} needs the engine: leave out --backend")
    for name, needed in (("max_keys", "key"), ("window", "order_by"), ("checkpoint_every", "checkpoint")):
        if options[name] is not None and not options[needed] and options[needed] != "":
            _refuse(f"--{name.replace('_', '-')} needs --{needed.replace('_', '-')}")
    if options["explain"] == TERMINAL and options["form"] == "jsonl":
        _refuse("--explain draws among the text: name a FILE for it with --format jsonl")
    if options["form"] == "table" and options["key"]:
        _refuse("--format table is for whole traces, not for --key")
    if options["detections"] and options["form"] != "jsonl":
        _refuse("--detections needs --format jsonl: the text tells changes of verdict alone")


def _check_traces(options: dict[str, Any], traces: Sequence[TraceSource], count: int) -> None:
    """The same once it is known for how many traces the patterns stand, and how many are no files."""
    streams = any(trace.file is None for trace in traces)
    for option, wanted in (("--follow", options["follow"]), ("--checkpoint", options["checkpoint"] is not None)):
        if wanted and (count != 1 or streams):
            _refuse(f"{option} needs one TRACE, a file")
    if options["jobs"] > 1 and streams and options["word"] is None:
        _refuse("--jobs is for files: standard input is read by one process")


# -- what the options stand for -----------------------------------------------------------------------------------------


def _maker(backend: str | None, semantics: Semantics, limit: int | None) -> Callable[[RVAFT], Monitor]:
    """What makes the monitor of a part of the tree."""

    def make(part: RVAFT) -> Monitor:
        if backend is not None:
            with suggesting():
                return translate(part, backend, semantics=semantics).monitor()
        try:
            return monitor(part, semantics=semantics, limit=limit or DEFAULT_LIMIT)
        except TooLarge as error:
            error.add_note("--max-configurations allows more")
            raise

    return make


def _hooks(options: dict[str, Any]) -> "Hooks | None":
    named = {Kind.FAULT: options["exec_fault"], Kind.ATTACK: options["exec_attack"]}
    by_kind = {kind: command for kind, command in named.items() if command is not None}
    if options["execute"] is None and not by_kind:
        return None
    from rvaft.monitoring.hooks import Hooks  # noqa: PLC0415 -- imported on use

    return Hooks(options["execute"], by_kind)


def _sources(options: dict[str, Any], tree: RVAFT) -> tuple[list[TraceSource], int]:
    """The traces to watch, and how many are not there, which has been reported."""
    if options["word"] is not None:
        return [_word(options["word"], tree)], 0
    found: list[TraceSource] = []
    missing = 0
    for name in options["traces"] or ("-",):
        if name == "-":
            stream = standard_input("TRACE")
            if sys.stdin.isatty():
                click.echo(
                    "rvaft: reading events from standard input, one JSON object per line (Ctrl-D ends)", err=True
                )
            found.append(TraceSource("<stdin>", events=stream))
            continue
        try:
            found += [TraceSource(click.format_filename(file), file) for file in expanded(name)]
        except OSError as error:
            report(error)
            missing += 1
    return found, missing


def _word(word: str, tree: RVAFT) -> TraceSource:
    """Each letter as the default event of that name, also where the node of that name has another event."""
    letters = word.split()
    unknown: list[str] = []
    for letter in dict.fromkeys(letters):
        node = tree.nodes.get(letter)
        if node is not None and node.on is not None:
            other = f"the letter {letter} is its default event, but the node {letter} has the event {on_text(node.on)}"
            click.echo(warning(other), err=True)
        elif not any(match(relevant.pattern, {"event": letter}, {}) is not None for relevant in tree.alphabet):
            unknown.append(letter)
    if unknown:
        click.echo(warning(f"no node has the default event {listing(unknown, 'or')}"), err=True)
    return TraceSource("word", events=[{"event": letter} for letter in letters])
