"""Which events an event type matches, and what that binds.

Declarations of one name are alternatives in their order; `|` in a pattern stands for several patterns, those of the first
field varying slowest. `any` and `none` are there unless declared, and a declared `any` is wider.
"""

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from enum import Enum, auto
from typing import Any, Final, TypeAlias

from backends.rml.reader import syntax as s
from rvaft.model.values import Json, equal, is_number

Number: TypeAlias = int | float
Bound: TypeAlias = Mapping[str, Json]

# The value of a data expression: exact numbers, and nothing (`None`) where types are wrong or a variable is unbound.
#
# Integers are exact, the rest are IEEE doubles, and two strings compare by code points, as in the tree language; the published monitor
# calculates with the real constraints of Prolog instead (see `deviations`).

_MAX_BITS: Final = 100_000


def _power(base: Number, exponent: Number) -> Number:
    if isinstance(base, int) and isinstance(exponent, int) and base.bit_length() * abs(exponent) > _MAX_BITS:
        raise OverflowError
    result = base**exponent
    return math.nan if isinstance(result, complex) else result


_CALCULATE: Final[Mapping[str, Callable[..., Number]]] = {
    "neg": operator.neg,
    "abs": abs,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "^": _power,
    "min": min,
    "max": max,
}
_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def value(data: s.Data, values: Bound) -> Json:
    """A number, a truth value or another JSON value; None stands for no value (null counts as none)."""

    def step(part: s.Data, given: list[Json]) -> Json:
        match part:
            case s.Constant(constant):
                return constant
            case s.Name(name):
                return values.get(name)
            case s.Apply(sign):
                return _applied(sign, given)

    return s.fold(data, step)


def _applied(sign: str, given: list[Json]) -> Json:
    if sign in ("&&", "||"):  # the first operand where it decides, else the second
        first, second = given
        decided = first if not isinstance(first, bool) or first is (sign == "||") else second
        return decided if isinstance(decided, bool) else None
    strings = sign in _COMPARE and all(isinstance(operand, str) for operand in given)
    if not strings and not all(map(is_number, given)):
        return None
    if sign in _COMPARE:
        return _COMPARE[sign](*given)
    try:
        result = _CALCULATE[sign](*given)
    except (ZeroDivisionError, OverflowError, ValueError):
        return None
    return result if isinstance(result, int) or math.isfinite(result) else None


def truth(data: s.Data, values: Bound) -> bool | None:
    """Whether a condition holds, or None where it has no value."""
    found = value(data, values)
    return found if isinstance(found, bool) else None


def argument(data: s.Data, values: Bound) -> Json:
    """The value of an argument of a generic equation; a variable without a value, or an error, counts as false."""
    if isinstance(data, s.Constant) or (isinstance(data, s.Name) and data.name in values):
        return value(data, values)
    found = value(data, values)
    return False if found is None else found


class Mark(Enum):
    """Values that equal nothing but themselves."""

    UNBOUND = auto()
    """What an event type leaves a variable that occurs in it and that the match does not bind."""
    UNEVALUATED = auto()
    """An argument that is not calculated."""


UNBOUND: Final = Mark.UNBOUND


def declared(program: s.RmlProgram) -> Mapping[tuple[str, int], list[s.Declaration]]:
    """The declarations of each event type, those that every specification has among them."""
    found: dict[tuple[str, int], list[s.Declaration]] = {}
    for declaration in (*program.declarations, s.ANY, s.NONE):
        found.setdefault(declaration.signature, []).append(declaration)
    return found


class EventTypes:
    """The event types of one specification."""

    def __init__(self, program: s.RmlProgram) -> None:
        self._declared = declared(program)

    def matches(self, use: s.TypeUse, event: Json) -> Iterator[dict[str, Json]]:
        """What each way to match binds, for every variable among the arguments: a value or `UNBOUND`."""
        wanted = [parameter.name for parameter in use.parameters if isinstance(parameter, s.Name)]
        for found in self._ways(use, event, {}):
            yield {name: found.get(name, UNBOUND) for name in wanted}
            if not wanted:
                return

    def _ways(self, use: s.TypeUse, event: Json, bound: Bound) -> Iterator[Bound]:
        """The ways a use matches, as bindings of the variables around it."""
        for declaration in self._declared.get(use.signature, ()):
            inner = _inward(declaration, use, bound)
            if inner is None:
                continue
            ways = self._alternatives(declaration, event, inner)
            if declaration.negated:
                ways = iter([inner] if next(ways, None) is None else [])
            for found in ways:
                if declaration.guard is None or truth(declaration.guard, found) is True:
                    yield from _outward(declaration, use, found, bound)

    def _alternatives(self, declaration: s.Declaration, event: Json, inner: Bound) -> Iterator[Bound]:
        for one in declaration.alternatives:
            yield from self._ways(one, event, inner) if isinstance(one, s.TypeUse) else _matching(one, event, inner)


def _inward(declaration: s.Declaration, use: s.TypeUse, bound: Bound) -> Bound | None:
    """The parameters that the arguments give a value; None where one parameter is given two."""
    inner: dict[str, Json] = {}
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        known = _given(given, bound)
        if known is not UNBOUND and not equal(inner.setdefault(name, known), known):
            return None
    return inner


def _given(given: s.Parameter, bound: Bound) -> Json:
    match given:
        case s.Constant(constant):
            return constant
        case s.Name(name):
            return bound.get(name, UNBOUND)
        case s.Apply():
            return Mark.UNEVALUATED
        case _:
            return UNBOUND


def _outward(declaration: s.Declaration, use: s.TypeUse, found: Bound, bound: Bound) -> list[Bound]:
    """What a match of the declaration binds around the use, with patterns among the arguments matched in turn."""
    ways = [bound]
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        if name in found and isinstance(given, s.Name | s.Fields | s.Items):
            ways = [after for before in ways for after in _matching(given, found[name], before)]
    return ways


def _matching(pattern: s.Value, event: Json, bound: Bound) -> Iterator[Bound]:
    """The ways a pattern matches a value, by an explicit stack of what is still to match."""
    stack: list[tuple[Any, Bound]] = [((pattern, event, None), bound)]
    while stack:
        todo, bound = stack.pop()
        if todo is None:
            yield bound
            continue
        pattern, found, rest = todo
        match pattern:
            case s.Ignored():
                stack.append((rest, bound))
            case s.Constant(expected):
                if equal(expected, found):
                    stack.append((rest, bound))
            case s.Name(name):
                if name not in bound:
                    stack.append((rest, {**bound, name: found}))
                elif equal(bound[name], found):
                    stack.append((rest, bound))
            case s.Either(values):
                stack.extend(((one, found, rest), bound) for one in reversed(values))
            case s.Fields(fields):
                if isinstance(found, Mapping) and all(name in found for name, _ in fields):
                    for name, inner in reversed(fields):
                        rest = (inner, found[name], rest)
                    stack.append((rest, bound))
            case s.Items(items, more):
                # the published `[...]` wants at least one item, `[x, ...]` at least as many as there are patterns
                least = max(len(items), 1) if more else len(items)
                if isinstance(found, list) and (len(found) >= least if more else len(found) == least):
                    for inner, one in reversed(list(zip(items, found, strict=False))):
                        rest = (inner, one, rest)
                    stack.append((rest, bound))
