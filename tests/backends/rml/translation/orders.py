"""Which traces the random comparisons leave out: those where a guard would order strings, which RML cannot."""

from typing import Any

from rvaft.guards import Guard, Operation, Operator
from rvaft.patterns import Variable
from rvaft.tree import RVAFT

ORDERS = frozenset([Operator.LT, Operator.LE, Operator.GT, Operator.GE])


def orders_strings(tree: RVAFT, trace: list[dict[str, Any]]) -> bool:
    """Whether a guard compares two variables by order and the trace has strings for them to be."""
    guards = [node.when for node in tree.top_down()] + [ignore.when for ignore in tree.ignores]
    ordered = any(_orders_variables(guard) for guard in guards)
    return ordered and any(_has_string(value) for event in trace for value in event.values())


def _orders_variables(guard: Guard | None) -> bool:
    match guard:
        case Operation(operator, (Variable(), Variable())) if operator in ORDERS:
            return True
        case Operation(_, operands):
            return any(map(_orders_variables, operands))
        case _:
            return False


def _has_string(value: Any) -> bool:
    match value:
        case str():
            return True
        case dict():
            return any(map(_has_string, value.values()))
        case list():
            return any(map(_has_string, value))
        case _:
            return False
