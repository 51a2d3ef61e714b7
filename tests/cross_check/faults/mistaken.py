"""Mistaken versions of what several participants use, for one of them to use alone."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from rvaft.model.expressions import guard_text
from rvaft.model.guards import Guard, Operation, Operator, holds
from rvaft.model.patterns import Binding, match
from rvaft.model.values import Json, equal
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from tests.cross_check.faults.planting import with_globals

_LOOSE: Final = {Operator.GT: Operator.GE, Operator.LT: Operator.LE}


def loose(guard: Guard) -> Guard:
    """The guard with `>=` for `>` and `<=` for `<`."""
    if not isinstance(guard, Operation):
        return guard
    return Operation(_LOOSE.get(guard.operator, guard.operator), tuple(map(loose, guard.operands)))


def loose_text(guard: Guard) -> str:
    """The same, written."""
    return guard_text(loose(guard))


def loosely_holds(guard: Guard, binding: Binding) -> bool:
    """The same, evaluated."""
    return holds(loose(guard), binding)


def always_holds(guard: Guard, binding: Binding) -> bool:
    """No guard is looked at."""
    return True


def told_apart(left: Json, right: Json) -> bool:
    """1 is not 1.0."""
    return equal(left, right) and type(left) is type(right)


def confused(left: Json, right: Json) -> bool:
    """The number 1 is the text "1"."""
    return str(left) == str(right)


def python_equal(left: Json, right: Json) -> bool:
    """Python's own equality: `True == 1`."""
    return bool(left == right)


match_telling_apart: Final[Callable[..., Any]] = with_globals(match, equal=told_apart)
match_confused: Final[Callable[..., Any]] = with_globals(match, equal=confused)
match_like_python: Final[Callable[..., Any]] = with_globals(match, equal=python_equal)


def step_without_latch(monitor: Monitor, event: Mapping[str, Json]) -> Verdict:
    """`Monitor.step`, but a final verdict is looked at again."""
    monitor._read += 1
    monitor._verdict = monitor._advance(event)
    return monitor._verdict
