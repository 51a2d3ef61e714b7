"""Equality, event patterns and guards (definition, section 1)."""

import math
from collections.abc import Mapping
from typing import Any

from rvaft.model.guards import Guard, Operation
from rvaft.model.nodes import Node, On
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT

Binding = Mapping[str, Any]


def same(left: Any, right: Any) -> bool:
    """Clause: numbers by mathematical value, booleans only equal booleans, objects with the same keys, lists elementwise."""
    if isinstance(left, bool) or isinstance(right, bool):
        return left is right
    if isinstance(left, (int, float)) and isinstance(right, (int, float)):
        return left == right
    if isinstance(left, dict) and isinstance(right, dict):
        return set(left) == set(right) and all(same(left[k], right[k]) for k in left)
    if isinstance(left, list) and isinstance(right, list):
        return len(left) == len(right) and all(map(same, left, right))
    return type(left) is type(right) and bool(left == right)


def arguments(tree: RVAFT, on: On) -> dict[str, Pattern]:
    """Clause: arguments are variables, `_` (a fresh variable), or literals."""
    parameters = tree.events[on.event].parameters
    fresh = (
        Variable(f"_{name}") if isinstance(a, Anything) else a for name, a in zip(parameters, on.arguments, strict=True)
    )
    return dict(zip(parameters, fresh, strict=True))


def matches(pattern: Pattern, value: Any, binding: Binding, given: Mapping[str, Pattern]) -> Binding | None:
    """The binding extended so that the pattern with the given arguments matches, or None.

    Clause: an object pattern matches an object that has at least its fields, a list pattern a list of the same length; `_` and
    parameters match any value, null included, but not an absent field. One used twice demands equal values.
    """
    found: Binding | None = binding
    match pattern:
        case Anything():
            return binding
        case Literal(expected):
            return binding if same(expected, value) else None
        case Variable(name) if name in given:
            return matches(given[name], value, binding, {})
        case Variable(name):
            return {name: value} | dict(binding) if name not in binding or same(binding[name], value) else None
        case ObjectPattern(fields):
            if not isinstance(value, dict) or any(name not in value for name, _ in fields):
                return None
            parts = [(inner, value[name]) for name, inner in fields]
        case ListPattern(items):
            if not isinstance(value, list) or len(value) != len(items):
                return None
            parts = list(zip(items, value, strict=True))
    for inner, part in parts:
        found = None if found is None else matches(inner, part, found, given)
    return found


def observe(tree: RVAFT, node: Node, event: Any, binding: Binding) -> Binding | None:
    """The binding extended so that the event is the node's runtime event, or None.

    Clause: a leaf with neither event nor guard observes the default event `{"event": "<its name>"}`.
    """
    if node.on is None:
        name = tree.origins.get(node.name, node.name)
        return binding if isinstance(event, dict) and "event" in event and same(event["event"], name) else None
    found = matches(tree.events[node.on.event].pattern, event, binding, arguments(tree, node.on))
    return None if found is None else {name: value for name, value in found.items() if not name.startswith("_")}


class Undefined(Exception):
    """Clause: wrong types, division by zero, overflow and a result that is not finite are *undefined*."""


def holds(guard: Guard, binding: Binding) -> bool:
    """Clause: a guard holds when its value is `true`; undefined does not hold and never raises."""
    try:
        return evaluate(guard, binding) is True
    except (Undefined, ZeroDivisionError, OverflowError):
        return False


def evaluate(guard: Guard, binding: Binding) -> Any:
    """The value of a guard; raises `Undefined` (or what Python raises for division by zero and overflow).

    Clause: undefined propagates through every operator, except that `and` and `or` read left to right and do not look at
    the right side when the left decides.
    """
    if isinstance(guard, Literal):
        return guard.value
    if isinstance(guard, Variable):
        return binding[guard.name]
    operator, operands = guard.operator.value, guard.operands
    if operator in ("and", "or"):
        for operand in operands:
            truth = typed(evaluate(operand, binding), bool)
            if truth is (operator == "or"):
                return truth
        return operator == "and"
    values = [evaluate(operand, binding) for operand in operands]
    if operator == "not":
        return not typed(values[0], bool)
    if operator == "neg":
        return -typed(values[0], int, float)
    return binary(operator, *values)


def binary(operator: str, left: Any, right: Any) -> Any:
    """Clause: `== !=` on all JSON values; `< <= > >=` between two numbers or two strings; `+ - * /` on numbers."""
    if operator in ("==", "!="):
        return same(left, right) is (operator == "==")
    if operator in ("<", "<=", ">", ">="):
        if not (isinstance(left, str) and isinstance(right, str)):
            typed(left, int, float), typed(right, int, float)
        below, equal = left < right, left == right
        return {"<": below, "<=": below or equal, ">": not below and not equal, ">=": not below}[operator]
    a, b = typed(left, int, float), typed(right, int, float)
    result = a + b if operator == "+" else a - b if operator == "-" else a * b if operator == "*" else a / b
    if isinstance(result, float) and not math.isfinite(result):
        raise Undefined
    return result


def typed(value: Any, *types: type) -> Any:
    """The value itself where it has one of the types (a boolean is not a number), else undefined."""
    if isinstance(value, types) and (isinstance(value, bool) is (types == (bool,))):
        return value
    raise Undefined


def names(term: Guard | Pattern) -> set[str]:
    """The variables of a guard or a pattern."""
    match term:
        case Variable(name):
            return {name}
        case Operation(_, operands):
            return {name for operand in operands for name in names(operand)}
        case ObjectPattern(fields):
            return {name for _, inner in fields for name in names(inner)}
        case ListPattern(items):
            return {name for inner in items for name in names(inner)}
        case _:
            return set()


def bound_by(node: Node) -> set[str]:
    """The variables that occur in the `on` of a node."""
    return set() if node.on is None else {a.name for a in node.on.arguments if isinstance(a, Variable)}
