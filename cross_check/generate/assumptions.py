"""Traces that keep the assumptions of a tree, made from others by few changes."""

from collections.abc import Iterable, Sequence
from functools import reduce
from random import Random
from typing import Final

from cross_check.generate.times import TODAY, grown, written
from cross_check.generate.values import interesting_values
from rvaft.model.assumptions import AssumptionCheck, Violation, first_violation, has_type
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

_ROUNDS: Final = 8
"""The maximum number of changes of one value; a change can break another assumption."""
_LARGEST: Final = 1_000


def conforming(tree: RVAFT, trace: Iterable[Json], assumptions: Iterable[Assumption]) -> list[Json]:
    """Return the trace with the values changed that break the assumptions, as far as possible."""
    asked = frozenset(assumptions)
    found = [_mended(tree, event, asked - {Assumption.ORDER}) for event in trace]
    late = first_violation(tree, found, asked & {Assumption.ORDER})
    return found if late is None else grown(Random(0), tree, found)  # noqa: S311 -- no secret


def _mended(tree: RVAFT, event: Json, assumptions: Iterable[Assumption]) -> Json:
    check = AssumptionCheck(tree, assumptions)
    for number in range(_ROUNDS):
        broken = check.broken(event)
        for violation in broken:
            old = reduce(_step, violation.path, event)  # equal values stay equal
            event = _with(event, violation.path, _sample(tree, violation, Random(f"{number} {old}")))  # noqa: S311
        if not broken:
            break
    return event


def _sample(tree: RVAFT, violation: Violation, random: Random) -> Json:
    """Return a value that keeps the assumption; often one that the tree mentions."""
    if violation.literal is not None:
        return violation.literal
    match violation.wanted:
        case ValueType.TIME:
            assert tree.time is not None, "a rule requires it"
            return written(random, tree.time.format, TODAY, plain=True)
        case ValueType.ANY:
            return random.choice((1, "a", True))
        case ValueType.TEXT | ValueType.INTEGER | ValueType.NUMBER | ValueType.BOOLEAN as type_:
            fitting = [one for one in interesting_values(tree) if has_type(one, type_)]
            small = [one for one in fitting if not isinstance(one, int | float) or abs(one) < _LARGEST]
            return random.choice(small or fitting)


def _step(value: Json, step: str | int) -> Json:
    if isinstance(step, str):
        return value.get(step) if isinstance(value, dict) else None
    return value[step] if isinstance(value, list) and step < len(value) else None


def _with(event: Json, path: Sequence[str | int], value: Json) -> Json:
    """Return the event with a value at a path, whose objects are made where they are missing."""
    if not path:
        return value
    step, *rest = path
    if isinstance(step, str):
        inside = dict(event) if isinstance(event, dict) else {}
        return {**inside, step: _with(inside.get(step), rest, value)}
    items = list(event) if isinstance(event, list) else []
    items += [None] * (step + 1 - len(items))
    items[step] = _with(items[step], rest, value)
    return items
