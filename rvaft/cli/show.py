"""`rvaft show`: draw a tree, or write it in another format."""

import re
import sys
from collections.abc import Mapping
from pathlib import Path, PurePath

import click

from rvaft.analysis.pattern_index import TreeReads
from rvaft.api import load, loads, monitor
from rvaft.cli.options import misused, output_option, semantics_option, standard_bytes, tree_argument
from rvaft.errors import OptionError
from rvaft.export import SUFFIXES, Format, Look, draw, format_of, losses
from rvaft.export.layout import NARROWEST, WIDTH, Marks, branch_marks, marks
from rvaft.language.parser import decoded
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitoring.explanation_json import counted, matched_events
from rvaft.monitoring.reader import read
from rvaft.support.files import deliver


def load_tree(tree: str) -> RVAFT:
    """The tree in a file, or for `-` on standard input; raises as `rvaft.load` does."""
    return loads(decoded(standard_bytes("TREE"), "<stdin>"), "<stdin>") if tree == "-" else load(tree)


_BRANCH = re.compile(r"branch:(.*)", re.DOTALL)


def highlighted(tree: RVAFT, what: str, semantics: str) -> Marks:
    """The marks for `branch:N`, or for the trace of that name.

    Raises `TreeError` where there is no such branch, `OptionError` for a number that is none and a trace that detects nothing,
    `TraceError` and `OSError` for one that cannot be read.
    """
    if found := _BRANCH.fullmatch(what):
        if not re.fullmatch(r"[0-9]{1,9}", found[1]):
            raise OptionError(f"--highlight branch:N takes the number of a branch, not {found[1]!r}")
        return branch_marks(tree, int(found[1]))
    if re.fullmatch(r"[0-9]{1,9}", what) and not Path(what).exists():
        raise OptionError(f"{what}: no such trace; a branch is marked by --highlight branch:{what}")
    watching = monitor(tree, semantics=semantics)
    events = {}
    for number, event in enumerate(read(what, reads=TreeReads(tree)), 1):
        events[number] = event
        if watching.step(event).final:
            break
    explanation = watching.explanation
    if explanation is None:
        raise OptionError(
            f"{what}: nothing is detected (the verdict is {watching.verdict} after {counted(len(events))})"
        )
    return marks(tree, explanation, {number: events[number] for number in matched_events([explanation])})


@click.command("show")
@tree_argument
@click.option(
    "--format",
    "form",
    type=click.Choice([form.value for form in Format]),
    help="The format; by default that of FILE's suffix, else tree. svg, pdf and png need Graphviz.",
)
@click.option(
    "--events/--no-events",
    default=None,
    help="Runtime events and guards under the label; by default in the terminal only.",
)
@click.option("--names/--no-names", default=None, help="The names of nodes that have a label; by default shown.")
@click.option(
    "--wrap",
    type=click.IntRange(min=NARROWEST),
    metavar="N",
    help=f"Columns of text in a box, {WIDTH} by default.",
)
@click.option("--depth", type=click.IntRange(min=0), metavar="N", help="Only so many levels below the root.")
@click.option("--collapse", multiple=True, metavar="NODE", help="Leave out what is below this node; repeatable.")
@click.option("--highlight", multiple=True, metavar="branch:N|TRACE", help="Mark a branch, or what a trace detects.")
@semantics_option
@click.option("--legend", is_flag=True, default=None, help="Say below the tree what its signs mean.")
@click.option(
    "--stagger",
    is_flag=True,
    default=None,
    help="Set every other leaf of a gate lower: a narrower tree (Graphviz only).",
)
@output_option
def show_command(
    *,
    tree: str,
    form: str | None,
    output: str | None,
    events: bool | None,
    names: bool | None,
    wrap: int | None,
    depth: int | None,
    collapse: tuple[str, ...],
    highlight: tuple[str, ...],
    semantics: str,
    legend: bool | None,
    stagger: bool | None,
) -> int:
    """Draw a tree, or write it in another format. The TREE - is standard input."""
    chosen = Format(form) if form is not None else _suggested(output)
    everywhere = {
        "--events": events,
        "--depth": depth,
        "--collapse": collapse or None,
        "--highlight": highlight or None,
    }
    in_boxes = {"--names": names, "--wrap": wrap, "--legend": legend, "--stagger": stagger}
    if not chosen.drawing:
        _refuse({**everywhere, **in_boxes}, chosen, "which writes the whole tree")
    if chosen is Format.TREE:
        _refuse(in_boxes, chosen, "which has no boxes")
    if chosen is Format.TIKZ:
        _refuse({"--stagger": stagger}, chosen, "which forest lays out")
    if len(highlight) > 1:
        raise misused("--highlight marks one branch or one trace: give it once")
    if chosen.binary and output in (None, "-") and sys.stdout.isatty():
        raise misused("this format is binary: name a file with -o, or redirect standard output")
    loaded = load_tree(tree)
    look = Look(
        events=chosen is Format.TREE if events is None else events,
        names=names is not False,
        wrap=WIDTH if wrap is None else wrap,
        depth=depth,
        collapse=collapse,
        marks=highlighted(loaded, highlight[0], Semantics(semantics)) if highlight else None,
        legend=bool(legend),
        stagger=bool(stagger),
    )
    deliver(draw(loaded, chosen, look), output)
    if chosen is Format.GALILEO:
        for loss in losses(loaded):
            click.echo(f"rvaft: warning: galileo: {loss}", err=True)
    return 0


def _refuse(options: Mapping[str, object], form: Format, why: str) -> None:
    """Refuse options that a format has no use for."""
    given = [
        name.replace("--", "--no-") if value is False else name for name, value in options.items() if value is not None
    ]
    if given:
        raise misused(f"{' and '.join(given)}: not for the format {form}, {why}")


def _suggested(output: str | None) -> Format:
    """The format of a file without `--format`: that of its suffix, and a drawing for the terminal where it has none."""
    suffix = PurePath(output or "").suffix
    if output is None or not suffix:
        return Format.TREE
    found = format_of(output)
    if found is None:
        raise misused(f"no format has the suffix {suffix}; known: {', '.join(SUFFIXES)}; or name one with --format")
    return found
