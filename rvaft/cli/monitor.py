"""`rvaft monitor`: watch events for a tree and give verdicts."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import click

from rvaft.api import monitor, narrowed, translate
from rvaft.cli.detections import TERMINAL, require_drawable
from rvaft.cli.failure import report
from rvaft.cli.fleet import run
from rvaft.cli.languages import suggesting
from rvaft.cli.monitor_options import DEFAULT_EVERY, MonitorCommand, Monitoring, monitoring_options
from rvaft.cli.options import part_options, semantics_option, standard_input, tree_argument
from rvaft.cli.sink import Sink, warning
from rvaft.cli.verdict_text import Text
from rvaft.cli.verdicts import JsonLines, Reporter, Shape
from rvaft.cli.watching import Manner, Trace
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge
from rvaft.language import load, on_text
from rvaft.model import Kind
from rvaft.monitoring.bank import Bank
from rvaft.monitoring.columns import columns
from rvaft.monitoring.fields import Field
from rvaft.monitoring.keys import MAX_KEYS
from rvaft.monitoring.ordering import DEFAULT_WINDOW
from rvaft.monitoring.run import Plan
from rvaft.monitoring.sources import LogFile, expanded
from rvaft.monitors import Monitor
from rvaft.patterns import match
from rvaft.reads import TreeReads
from rvaft.rules.words import listing
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

if TYPE_CHECKING:
    from rvaft.monitoring.hooks import Hooks
    from rvaft.monitoring.keeping import Keeping

Make: TypeAlias = Callable[[RVAFT], Monitor]


@click.command("monitor", cls=MonitorCommand)
@tree_argument
@semantics_option
@part_options
@monitoring_options
def command(*, tree: str, semantics: str, branch: int | None, kind: str | None, options: Monitoring) -> int:
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
        from rvaft.cli.verdict_table import Table  # noqa: PLC0415 -- imported on use

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
    from rvaft.monitoring.keeping import Keeping  # noqa: PLC0415 -- imported on use

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
