"""What the commands about risk share: the tree with its numbers, and their output."""

import csv
import io
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Final

import click

from rvaft.cli import options, warn
from rvaft.cli.horizon import Horizon
from rvaft.errors import OptionError
from rvaft.export import format_of
from rvaft.export.chart import FORMATS, Chart, chart_text
from rvaft.model.nodes import Kind
from rvaft.risk.model import RiskTree, of_draft, of_tree, without
from rvaft.risk.runtime import confused
from rvaft.rules.validity import valid_part
from rvaft.support.files import deliver


def _drawable(_context: object, _parameter: object, file: str | None) -> str | None:
    if file is not None and format_of(file) not in FORMATS:
        raise click.BadParameter(f"{file!r} has none of the suffixes of a chart: .svg, .pdf, .png and .tex")
    return file


def risk_tree(tree: str, *, branch: int | None = None, kind: Kind | None = None, gone: Iterable[str] = ()) -> RiskTree:
    """Read a tree for an analysis, as if the nodes `gone` never happened.

    Dynamic gates of Galileo keep their own meaning.
    """
    form = of_draft(options.read_draft_as_written(tree))
    if branch is not None or kind is not None:
        if form.tree is None:
            raise OptionError("dynamic gates of Galileo have no branches or kinds: omit --branch and --kind")
        form = of_tree(valid_part(form.tree, branch, kind))
    return reduce(without, gone, form)


def require_time(horizon: Horizon | None, unit: str | None) -> None:
    """Refuse a missing time, or one that has another unit than the rates."""
    options.refuse(horizon is None and unit is not None, "the tree has rates: say --time TIME")
    if horizon is not None:
        horizon.require(unit)


def warn_of_bounds(form: RiskTree) -> None:
    """Warn where a probability of a tree is a bound."""
    if form.assumed:
        warn(f"guards are taken to hold, so probabilities are upper bounds: {', '.join(form.assumed)}")
    if some := confused(form):
        warn(
            f"one event may be that of {some[0]} and of {some[1]}, which are two processes here: a monitor detects "
            "earlier, so probabilities are lower bounds"
        )


without_option: Final = click.option(
    "--without", "gone", multiple=True, metavar="NODE", help="As if this node never happened; repeatable."
)


chart_option: Final = click.option(
    "-o", "--output", metavar="FILE", callback=_drawable, help="Draw a chart to FILE: .svg, .pdf, .png or .tex."
)


def write_chart(chart: Chart, output: str) -> None:
    """Write a chart to a file, in the format of its suffix."""
    form = format_of(output)
    assert form is not None, "the option has been checked"
    deliver(chart_text(chart, form), output)


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()
