"""The time that analyses of risk ask for, as an option."""

import math
import re
from collections.abc import Callable
from typing import Final

import click

from rvaft.cli import options
from rvaft.errors import OptionError
from rvaft.model.event_time import UNITS, scaled
from rvaft.model.quantities import NANOSECONDS

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


def number_text(value: float) -> str:
    """Return a number with ten digits."""
    return f"{value:.10g}"
