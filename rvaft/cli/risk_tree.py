"""What the commands about risk share: the time that is asked for, and the tree with its numbers."""

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Final

import click

from rvaft.cli import options, warn
from rvaft.errors import OptionError
from rvaft.export import format_of
from rvaft.export.chart import FORMATS, Chart, chart_text
from rvaft.model.event_time import UNITS, scaled
from rvaft.model.nodes import Kind
from rvaft.model.quantities import NANOSECONDS
from rvaft.risk.model import RiskTree, of_draft, of_tree
from rvaft.risk.runtime import confused
from rvaft.rules.validity import valid_part
from rvaft.support.files import deliver

TIME: Final = "The time at which to ask, as in '1000 h'; a number alone if the rates have no unit."
_TIME: Final = re.compile(r"([0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]{1,4})?)\s*([a-z]*)", re.ASCII)


class Horizon:
    """A time as the user wrote it, with the option that has it.

    `value` is in the unit of the rates, which is seconds if they have units.
    """

    def __init__(self, text: str, option: str = "--time") -> None:
        self.text, self._option = text.strip(), option
        found = _TIME.fullmatch(self.text)
        number, self._unit = (found[1], found[2]) if found else ("", "")
        self.timed = bool(self._unit)
        size = scaled(number, self._unit) if self._unit in UNITS else None
        value = size / NANOSECONDS if size is not None else float(number) if number and not self._unit else math.inf
        self.value = value
        if not math.isfinite(value):
            raise OptionError(
                f"{text!r} is no time: write a number and a unit ({', '.join(UNITS)}), as in '1000 h', or a number "
                "alone if the rates have no unit"
            )

    def require(self, unit: str | None, tree: str = "the tree") -> None:
        """Raise `OptionError` if the rates have units and the time has none, or the other way round."""
        if unit is not None and self.timed != (unit == "s"):
            units = ", ".join(UNITS)
            has, asked = ("units", f"a time with a unit ({units})") if unit else ("no unit", "a number alone")
            raise OptionError(f"the rates of {tree} have {has}: write {self._option} as {asked}, not {self.text!r}")

    def shown(self, value: float) -> str:
        """Return a time, of the unit of the rates, in the unit that the user wrote."""
        if not self._unit:
            return number_text(value)
        return f"{number_text(self.scaled(value))} {self._unit}"

    def scaled(self, value: float) -> float:
        """Return a time, of the unit of the rates, as a number in the unit that the user wrote."""
        return value * NANOSECONDS / UNITS[self._unit] if self._unit else value

    @property
    def unit_text(self) -> str:
        """The unit that the user wrote, for the name of an axis; "" for none."""
        return f" in {self._unit}" if self._unit else ""


def time_option(name: str, target: str, text: str = TIME) -> Callable[[options.F], options.F]:
    """Return an option with a time."""
    return click.option(name, target, callback=_horizon, metavar="TIME", help=text)


def _horizon(_context: object, parameter: click.Parameter, text: str | None) -> Horizon | None:
    try:
        return None if text is None else Horizon(text, parameter.opts[0])
    except OptionError as error:
        raise click.BadParameter(str(error)) from None


def _drawable(_context: object, _parameter: object, file: str | None) -> str | None:
    if file is not None and format_of(file) not in FORMATS:
        raise click.BadParameter(f"{file!r} has none of the suffixes of a chart: .svg, .pdf, .png and .tex")
    return file


def risk_tree(tree: str, *, branch: int | None = None, kind: Kind | None = None) -> RiskTree:
    """Read a tree for an analysis: dynamic gates of Galileo keep their own meaning."""
    form = of_draft(options.read_draft_as_written(tree))
    if branch is None and kind is None:
        return form
    if form.tree is None:
        raise OptionError("dynamic gates of Galileo have no branches or kinds: omit --branch and --kind")
    return of_tree(valid_part(form.tree, branch, kind))


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


def number_text(value: float) -> str:
    """Return a number with ten digits."""
    return f"{value:.10g}"
