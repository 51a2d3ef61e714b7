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
from rvaft.model.event_time import UNITS, duration
from rvaft.model.nodes import Kind
from rvaft.model.quantities import NANOSECONDS
from rvaft.risk.model import RiskTree, of_draft, of_tree
from rvaft.risk.runtime import confused
from rvaft.rules.validity import valid_part

TIME: Final = "The time at which to ask, as in '1000 h'; a number alone if the rates have no unit."


class Horizon:
    """A time as the user wrote it: `value` is in the unit of the rates, which is seconds if they have units."""

    def __init__(self, text: str) -> None:
        self.text = text.strip()
        self.timed = not re.fullmatch(r"[0-9.eE+-]+", self.text)
        if self.timed:
            self.value = duration(self.text) / NANOSECONDS
            self._unit = re.sub(r"[0-9.eE+\s-]", "", self.text)
        else:
            try:
                self.value = float(self.text)
            except ValueError:
                self.value = -1.0
            self._unit = ""
        if not 0 <= self.value < math.inf:
            raise OptionError(f"{text!r} is no time: write a number and a unit, as in '1000 h', or a number alone")

    def require(self, unit: str | None) -> None:
        """Raise `OptionError` if the rates have units and the time has none, or the other way round."""
        if unit is not None and self.timed != (unit == "s"):
            units = ", ".join(UNITS)
            has, asked = ("units", f"a time with a unit ({units})") if unit else ("no unit", "a number alone")
            raise OptionError(f"the rates of the tree have {has}: write --time as {asked}, not {self.text!r}")

    def shown(self, value: float) -> str:
        """Return a time, of the unit of the rates, in the unit that the user wrote."""
        if not self._unit:
            return number_text(value)
        return f"{number_text(value * NANOSECONDS / UNITS[self._unit])} {self._unit}"


def time_option(name: str, target: str, text: str = TIME) -> Callable[[options.F], options.F]:
    """Return an option with a time."""
    return click.option(name, target, callback=_horizon, metavar="TIME", help=text)


def _horizon(_context: object, _parameter: object, text: str | None) -> Horizon | None:
    try:
        return None if text is None else Horizon(text)
    except OptionError as error:
        raise click.BadParameter(str(error)) from None


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


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def number_text(value: float) -> str:
    """Return a number with ten digits."""
    return f"{value:.10g}"
