"""`rvaft monitor`: watch events for a tree and give verdicts."""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import click

from rvaft.api import monitor, narrowed, translate
from rvaft.cli.failure import FAILED, FOUND, report
from rvaft.cli.languages import suggesting
from rvaft.cli.options import exclusive, part_options, semantics_option, standard_input, tree_argument
from rvaft.cli.verdicts import JsonLines, Reporter, Text
from rvaft.errors import RvaftError
from rvaft.language import load, on_text
from rvaft.monitors import Monitor
from rvaft.patterns import match
from rvaft.printable import visible
from rvaft.rules.words import listing
from rvaft.statistics import Statistics
from rvaft.traces import Reads, read, reads_of
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Verdict


@dataclass(frozen=True, slots=True)
class Trace:
    """One trace to watch: its name for people, its events, and whether they come while we watch."""

    name: str
    events: Iterable[Json]
    live: bool = False


@click.command("monitor")
@tree_argument
@click.argument("trace", nargs=-1, metavar="[TRACE]...")
@click.option("--word", metavar='"b a c"', help="Watch the default events of these names instead of a trace.")
@semantics_option
@click.option("--backend", metavar="BACKEND", help="Run the specification of this backend instead of the engine.")
@part_options
@click.option(
    "--format", "form", type=click.Choice(["text", "jsonl"]), default="text", show_default=True, help="What to print."
)
def command(
    *,
    tree: str,
    trace: tuple[str, ...],
    word: str | None,
    semantics: str,
    backend: str | None,
    branch: int | None,
    kind: str | None,
    form: str,
) -> int:
    """Watch the events of each TRACE (JSON Lines) for a tree and give verdicts.

    No TRACE, or -, reads standard input as it comes. The exit status is 1 when the tree is detected in some trace.
    """
    exclusive(branch=branch, kind=kind)
    if word is not None and trace:
        raise click.UsageError("--word and TRACE exclude each other", click.get_current_context())
    whole = load(tree)
    part = narrowed(whole, branch, kind)
    fresh: Callable[[], Monitor]
    if backend is None:
        fresh = lambda: monitor(part, semantics=semantics)  # noqa: E731
    else:
        with suggesting():
            fresh = translate(part, backend, semantics=semantics).monitor
    traces = [_word(word, whole)] if word is not None else [_trace(name, reads_of(whole)) for name in trace or ("-",)]
    several = len(traces) > 1
    reporter = JsonLines(several, whole) if form == "jsonl" else Text(several, whole, Statistics(whole))
    statuses = [_watch(one, fresh(), reporter) for one in traces]
    if min(statuses) < FAILED:
        reporter.finish()
    return max(statuses)


def _watch(trace: Trace, watching: Monitor, reporter: Reporter) -> int:
    """Report one trace; a malformed one is reported up to the fault."""
    try:
        reporter.begin(trace.name, watching)
        for number, event in enumerate(trace.events, 1):
            watching.step(event)
            reporter.step(number, event)
            if trace.live:
                sys.stdout.flush()
        reporter.end()
    except RvaftError as error:
        report(error)
        return FAILED
    except OSError as error:
        if error.filename is None:  # not the trace but standard output
            raise
        report(error)
        return FAILED
    return FOUND if watching.verdict is Verdict.TRUE else 0


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
    return Trace("word", [{"event": letter} for letter in letters])


def _warn(said: str) -> None:
    click.echo(visible(f"rvaft: warning: {said}"), err=True)


def _trace(name: str, reads: Reads) -> Trace:
    if name == "-":
        return Trace("<stdin>", read(standard_input("TRACE"), name="<stdin>", reads=reads), live=True)
    return Trace(click.format_filename(name), read(name, reads=reads))
