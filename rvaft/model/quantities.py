"""The numbers that nodes carry as attributes, for analyses of risk (semantics, section 8).

The attributes are `prob`, `lambda` (with or without a unit), `rate` and `shape` (Weibull), `dorm`,
`once`, `cost` and `damage`. Attributes with other names are text for people.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rvaft.model.event_time import UNITS
from rvaft.model.nodes import Node

NANOSECONDS: Final = 1_000_000_000
_NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
_NAME: Final = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""A parameter of Galileo."""
_LEAF_ONLY: Final = ("prob", "lambda", "rate", "shape", "dorm", "once", "cost")
_NEUTRAL: Final = {"cov": 0.0, "res": 0.0, "repair": 0.0, "repl": 1.0}
"""Attributes of Galileo that no analysis reads, with the value at which they have no effect."""
_REFUSED: Final = {
    "repair": "of a part that is repaired, the unavailability would be asked, which is another quantity; leave it out "
    "for parts that are not repaired",
    "cov": "the coverage of faults is not analysed; leave it out for faults that are all covered",
    "res": "the restoration of faults is not analysed; leave it out for faults that stay",
    "repl": "write replicated events one by one",
    "mean": "log-normal and other distributions are not analysed: use `lambda`, or `rate` with `shape`",
    "stddev": "log-normal and other distributions are not analysed: use `lambda`, or `rate` with `shape`",
    "phases": "Erlang phases are written `times N`",
    "interval": "an interval is not analysed: use `lambda`, or `rate` with `shape`",
}
"""Attributes that change what a number means, and why an analysis refuses them."""


@dataclass(frozen=True, slots=True)
class Quantities:
    """The numbers of one node, each None where it has none.

    `rate` is per second with a unit (`timed`), else per unit of time of the tree. `shape` is that of
    a Weibull distribution with this rate. `once` tells a failure, which happens once and stays, from
    an event that recurs. `dormancy` is the factor of the rate of a spare that is not in use.

    >>> from rvaft import Node
    >>> quantities(Node("a", attributes=(("lambda", "3.6/h"), ("cost", "20"))))
    Quantities(chance=None, rate=0.001, timed=True, shape=1.0, dormancy=None, once=None, cost=20.0, damage=None)
    """

    chance: float | None = None
    rate: float | None = None
    timed: bool = False
    shape: float = 1.0
    dormancy: float | None = None
    once: bool | None = None
    cost: float | None = None
    damage: float | None = None

    @property
    def has_chance(self) -> bool:
        """Whether a probability can be computed."""
        return self.chance is not None or self.rate is not None


class WrongQuantity(ValueError):
    """An attribute without a meaning; the message names node and attribute, with a remedy.

    `key` is the attribute, and `refused` whether it has a meaning elsewhere, which no analysis here
    reads.
    """

    def __init__(self, key: str, message: str, *, refused: bool = False) -> None:
        super().__init__(message)
        self.key, self.refused = key, refused


def quantities(node: Node) -> Quantities:
    """Return the numbers of a node; raises `WrongQuantity` for the first that has no meaning."""
    for slip in slips(node):
        raise slip
    given = dict(node.attributes)
    rate, timed = _rate(given["lambda"] if "lambda" in given else given.get("rate"))
    number = {key: float(given[key]) for key in ("prob", "shape", "dorm", "cost", "damage") if key in given}
    return Quantities(
        number.get("prob"),
        rate,
        timed,
        number.get("shape", 1.0),
        number.get("dorm"),
        {"yes": True, "no": False}[given["once"]] if "once" in given else None,
        number.get("cost"),
        number.get("damage"),
    )


def slips(node: Node) -> Iterator[WrongQuantity]:
    """Yield what is wrong with the numbers of a node."""
    given = dict(node.attributes)
    for key in sorted({key for key, _ in node.attributes if [one for one, _ in node.attributes].count(key) > 1}):
        if key in (*_LEAF_ONLY, "damage"):
            yield WrongQuantity(key, f"{node.name} has `{key}` twice: keep one")
    for key, value in given.items():
        if key in _REFUSED and _as_number(value) != _NEUTRAL.get(key, math.nan):
            yield WrongQuantity(key, f"`{key}={value}` of {node.name}: {_REFUSED[key]}", refused=True)
        elif message := _wrong(node, key, value):
            yield WrongQuantity(key, message)
    if "prob" in given and given.keys() & {"lambda", "rate"}:
        yield WrongQuantity("prob", f"{node.name} has a probability and a rate: keep `prob`, or `lambda`")
    if {"lambda", "rate"} <= given.keys():
        yield WrongQuantity("rate", f"{node.name} has two rates: keep `lambda`, or `rate` with `shape`")
    if "shape" in given and "rate" not in given:
        yield WrongQuantity("shape", f"{node.name} has a `shape` without `rate`: write both, as in rate=0.1/h shape=2")


def _wrong(node: Node, key: str, value: str) -> str | None:
    name = node.name
    if not node.leaf and key in _LEAF_ONLY and not (key in ("prob", "once", "lambda") and _own(node)):
        return f"the gate {name} has `{key}`: only leaves have it; {_REMEDY[key]}"
    match key:
        case "prob":
            number = _as_number(value)
            if number is None or not 0 <= number <= 1:
                return f"`prob={value}` of {name} is not a probability: write a number from 0 to 1"
        case "lambda" | "rate":
            if _NAME.fullmatch(value):
                return f"`{key}={value}` of {name} is not a rate: write the value of {value}, as in {key}=0.002/h"
            if _rate(value)[0] is None:
                units = ", ".join(UNITS)
                return (
                    f"`{key}={value}` of {name} is not a rate: write a number that is not negative, alone or per unit "
                    f"of time, as in {key}=0.002/h (units: {units})"
                )
        case "dorm":
            number = _as_number(value)
            if number is None or not 0 <= number <= 1:
                return f"`dorm={value}` of {name} is not a dormancy: write a factor from 0 (cold) to 1 (hot)"
        case "shape":
            number = _as_number(value)
            if number is None or number <= 0:
                return f"`shape={value}` of {name} is not a shape: write a number above 0"
        case "once":
            if value not in ("yes", "no"):
                return f"`once={value}` of {name}: write once=yes for a failure, once=no for an event that recurs"
        case "cost" | "damage":
            number = _as_number(value)
            if number is None or number < 0:
                return f"`{key}={value}` of {name} is not a {key}: write a number that is not negative"
        case _:
            return None
    return None


_REMEDY: Final = {
    "prob": "give the gate an event or a guard of its own, or write it at the leaves",
    "lambda": "give the gate an event of its own, or write it at the leaves",
    "rate": "write it at the leaves",
    "shape": "write it at the leaves",
    "dorm": "write it at the leaves below",
    "once": "give the gate an event of its own, or write it at the leaves",
    "cost": "add a leaf for what the gate itself costs",
}


def _own(node: Node) -> bool:
    return node.on is not None or node.when is not None


def _as_number(value: str) -> float | None:
    if not _NUMBER.fullmatch(value):
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def _rate(value: str | None) -> tuple[float | None, bool]:
    """Return the rate, per second if it has a unit, and whether it has one; None if it is no rate."""
    if value is None:
        return None, False
    text, slash, unit = value.partition("/")
    number = _as_number(text)
    if number is None or number < 0 or (slash and unit not in UNITS):
        return None, bool(slash)
    return (number / (UNITS[unit] / NANOSECONDS) if slash else number), bool(slash)
