"""Which events an event type matches, and what that binds.

Declarations of one name are alternatives in their order; `|` in a pattern stands for several patterns, those of the first
field varying slowest. `any` and `none` are there unless declared, and a declared `any` is wider.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, TypeAlias

from backends.rml.reader import syntax as s
from backends.rml.reader.syntax import (
    Apply,
    Constant,
    Data,
    Declaration,
    Either,
    Fields,
    Ignored,
    Items,
    Name,
    Parameter,
    TypeUse,
    Unevaluated,
    Value,
)
from rvaft.model.guards import MAX_DEPTH, Guard, Operation, Operator
from rvaft.model.patterns import Literal, Pattern, Variable
from rvaft.model.values import Json, equal, is_number

# Which variables of a declaration every match binds, however the event type is used.


def always_bound(program: s.Program) -> Mapping[s.Declaration, frozenset[str]]:
    """For each declaration the names that stand for a value once its pattern or its parents have matched."""
    known: dict[s.Declaration, frozenset[str]] = {d: frozenset() for d in program.declarations}
    for _ in program.declarations:
        now = {declaration: _bound(declaration, program, known) for declaration in program.declarations}
        if now == known:
            break
        known = now
    return known


def _bound(
    declaration: s.Declaration, program: s.Program, known: Mapping[s.Declaration, frozenset[str]]
) -> frozenset[str]:
    if declaration.negated:
        return frozenset()
    ways = [_in_value(value) for value in declaration.values]
    ways += [_in_use(parent, program, known) for parent in declaration.parents]
    return frozenset.intersection(*ways)


def _in_value(value: s.Value) -> frozenset[str]:
    """The names that every choice of a pattern binds."""
    found: set[str] = set()
    todo = [value]
    while todo:
        match todo.pop():
            case s.Name(name):
                found.add(name)
            case s.Fields(fields):
                todo.extend(inner for _, inner in fields)
            case s.Items(items):
                todo.extend(items)
            case _:  # what stands in a `|` may stay without a value
                pass
    return frozenset(found)


def _in_use(use: s.TypeUse, program: s.Program, known: Mapping[s.Declaration, frozenset[str]]) -> frozenset[str]:
    found: frozenset[str] | None = None
    for declaration in program.declarations:
        if (declaration.name, len(declaration.parameters)) == (use.name, len(use.parameters)):
            pairs = zip(declaration.parameters, use.parameters, strict=True)
            here = frozenset(p.name for name, p in pairs if isinstance(p, s.Name) and name in known[declaration])
            found = here if found is None else found & here
    return found or frozenset()


# A `with` of RML as a guard that holds for the same values.
#
# RML compares two numbers or two strings and nothing else, while `==` of a guard compares all values. So `x == y` becomes
# `x <= y and x >= y`, and `x != y` becomes `x < y or x > y`, which are undefined where RML's have no value.

NOTHING: Final = Literal(None)
"""Stands for no value: whatever is asked of null in these guards is undefined."""

_SAME: Final = {
    "<": Operator.LT,
    "<=": Operator.LE,
    ">": Operator.GT,
    ">=": Operator.GE,
    "+": Operator.ADD,
    "-": Operator.SUB,
    "*": Operator.MUL,
    "/": Operator.DIV,
    "neg": Operator.NEGATE,
    "&&": Operator.AND,
    "||": Operator.OR,
}


_TRUTHS: Final = frozenset({Operator.AND, Operator.OR, Operator.LT, Operator.LE, Operator.GT, Operator.GE})


class Untranslatable(Exception):
    """A condition that no guard says."""


def condition(data: Data, values: Mapping[str, Pattern], depth: int = 0) -> Guard:
    """The guard, with a value for each name (`NOTHING` for unbound ones, and for objects and lists); raises `Untranslatable`."""
    if depth > MAX_DEPTH:
        raise Untranslatable
    match data:
        case Constant(value):
            return Literal(value)
        case Name(name):
            value = values.get(name, NOTHING)
            return value if isinstance(value, (Literal, Variable)) else NOTHING
        case Apply(operator, operands):
            parts = tuple(condition(operand, values, depth + 1) for operand in operands)
            return _applied(operator, parts)


def _applied(operator: str, parts: tuple[Guard, ...]) -> Guard:
    if operator not in ("&&", "||") and any(
        map(_truth, parts)
    ):  # a truth value is neither compared nor calculated with
        return NOTHING
    if operator == "==":
        return Operation(Operator.AND, (Operation(Operator.LE, parts), Operation(Operator.GE, parts)))
    if operator == "!=":
        return Operation(Operator.OR, (Operation(Operator.LT, parts), Operation(Operator.GT, parts)))
    if operator not in _SAME:
        raise Untranslatable
    return Operation(_SAME[operator], parts)


def _truth(guard: Guard) -> bool:
    return isinstance(guard, Operation) and guard.operator in _TRUTHS


# The value of a data expression: exact numbers, and nothing (`None`) where types are wrong or a variable is unbound.
#
# Integers are exact, the rest are IEEE doubles, and two strings compare by code points, as in the tree language; the published monitor calculates with the real
# constraints of Prolog instead (see `deviations`). Nothing here recurses: an expression may be nested arbitrarily deep.

Number: TypeAlias = int | float

_UNARY: Final[Mapping[str, Callable[[Number], Number]]] = {
    "neg": lambda x: -x,
    "abs": abs,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
}
_BINARY: Final[Mapping[str, Callable[[Number, Number], Number]]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "min": min,
    "max": max,
}
_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "==": lambda x, y: x == y,
    "!=": lambda x, y: x != y,
    "<": lambda x, y: x < y,
    "<=": lambda x, y: x <= y,
    ">": lambda x, y: x > y,
    ">=": lambda x, y: x >= y,
}
_MAX_BITS: Final = 100_000


def truth(data: Data, values: Mapping[str, Json]) -> bool | None:
    """Whether a condition holds, or None where it has no value."""
    found = _evaluate(data, values)
    return found if isinstance(found, bool) else None


def argument(data: Data, values: Mapping[str, Json]) -> Json:
    """The value of an argument of a generic equation; a variable without a value, or an error, counts as false."""
    match data:
        case Constant(value):
            return value
        case Name(name) if name in values:
            return values[name]
        case _:
            found = _evaluate(data, values)
            return False if found is None else found


def _evaluate(data: Data, values: Mapping[str, Json]) -> Json:
    """A number, a truth value or another JSON value; None stands for no value (null counts as none)."""
    order: list[Data] = []
    todo = [data]
    while todo:
        order.append(part := todo.pop())
        if isinstance(part, Apply):
            todo.extend(reversed(part.operands))
    found: list[Json] = []
    for part in reversed(order):
        match part:
            case Constant(value):
                found.append(value)
            case Name(name):
                found.append(values.get(name))
            case Apply(operator, operands):
                # the reversed order has operands from the last to the first, so the first lies on top
                given = [found.pop() for _ in operands]
                found.append(_apply(operator, given))
    return found.pop()


def _apply(operator: str, given: list[Json]) -> Json:
    if operator in ("&&", "||"):
        return _connect(given, decides=operator == "||")
    strings = operator in _COMPARE and all(isinstance(value, str) for value in given)
    if not strings and not all(map(is_number, given)):
        return None
    return _COMPARE[operator](*given) if operator in _COMPARE else _calculate(operator, given)


def _connect(given: list[Json], *, decides: bool) -> bool | None:
    """The first operand where it decides, else the second; an operand that is needed and no truth value gives none."""
    first, second = given
    if not isinstance(first, bool) or first is decides:
        return first if isinstance(first, bool) else None
    return second if isinstance(second, bool) else None


def _calculate(operator: str, given: list[Number]) -> Number | None:
    try:
        if operator in _UNARY:
            result = _UNARY[operator](given[0])
        elif operator in _BINARY:
            result = _BINARY[operator](*given)
        else:
            result = _power(*given)
    except (ZeroDivisionError, OverflowError, ValueError):
        return None
    return result if isinstance(result, int) or math.isfinite(result) else None


def _power(base: Number, exponent: Number) -> Number:
    if isinstance(base, int) and isinstance(exponent, int) and base.bit_length() * abs(exponent) > _MAX_BITS:
        raise OverflowError
    result = base**exponent
    return math.nan if isinstance(result, complex) else result


Bound: TypeAlias = Mapping[str, Json]


class _Mark:
    """A value that equals nothing but itself."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


UNBOUND: Final = _Mark("UNBOUND")
"""What an event type leaves a variable that occurs in it and that the match does not bind."""
_UNEVALUATED: Final = _Mark("UNEVALUATED")

ANY: Final = Declaration("any", (), negated=False, values=(Fields(()),))
NONE: Final = Declaration("none", (), negated=True, parents=(TypeUse("any"),))


class Types:
    """The event types of one specification."""

    def __init__(self, declarations: tuple[Declaration, ...]) -> None:
        self._by_name: dict[tuple[str, int], list[Declaration]] = {}
        for declaration in (*declarations, ANY, NONE):
            self._by_name.setdefault((declaration.name, len(declaration.parameters)), []).append(declaration)

    def matches(self, use: TypeUse, event: Json) -> Iterator[dict[str, Json]]:
        """What each way to match binds, for every variable among the arguments: a value or `UNBOUND`."""
        wanted = [p.name for p in use.parameters if isinstance(p, Name)]
        for found in self._declared(use, event, {}):
            yield {name: found.get(name, UNBOUND) for name in wanted}
            if not wanted:
                return

    def _declared(self, use: TypeUse, event: Json, bound: Bound) -> Iterator[Bound]:
        """The ways a use matches, as bindings of the variables around it."""
        for declaration in self._by_name.get((use.name, len(use.parameters)), ()):
            inner = _inward(declaration, use, bound)
            if inner is not None:
                for found in self._one(declaration, event, inner):
                    yield from _outward(declaration, use, found, bound)

    def _one(self, declaration: Declaration, event: Json, inner: Bound) -> Iterator[Bound]:
        guard = declaration.guard
        if not declaration.negated:
            ways = self._parts(declaration, event, inner)
        else:
            ways = iter([inner] if next(self._parts(declaration, event, inner), None) is None else [])
        for found in ways:
            if guard is None or truth(guard, found) is True:
                yield found

    def _parts(self, declaration: Declaration, event: Json, inner: Bound) -> Iterator[Bound]:
        for value in declaration.values:
            yield from _ways(value, event, inner)
        for parent in declaration.parents:
            yield from self._declared(parent, event, inner)


def _inward(declaration: Declaration, use: TypeUse, bound: Bound) -> Bound | None:
    """The parameters that the arguments give a value; None where one parameter is given two."""
    inner: dict[str, Json] = {}
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        value = _given(given, bound)
        if value is not UNBOUND and not equal(inner.setdefault(name, value), value):
            return None
    return inner


def _given(given: Parameter, bound: Bound) -> Json:
    match given:
        case Constant(value):
            return value
        case Name(name):
            return bound.get(name, UNBOUND)
        case Unevaluated():
            return _UNEVALUATED
        case _:
            return UNBOUND


def _outward(declaration: Declaration, use: TypeUse, found: Bound, bound: Bound) -> Iterator[Bound]:
    """What a match of the declaration binds around the use, with patterns among the arguments matched in turn."""
    ways: list[Bound] = [bound]
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        if name in found and isinstance(given, (Name, Fields, Items)):
            ways = [after for before in ways for after in _ways(given, found[name], before)]
    yield from ways


def _ways(pattern: Value, value: Json, bound: Bound) -> Iterator[Bound]:
    """The ways a pattern matches a value, by an explicit stack of what is still to match."""
    stack: list[tuple[Any, Bound]] = [((pattern, value, None), bound)]
    while stack:
        todo, bound = stack.pop()
        if todo is None:
            yield bound
            continue
        pattern, value, rest = todo
        match pattern:
            case Ignored():
                stack.append((rest, bound))
            case Constant(expected):
                if equal(expected, value):
                    stack.append((rest, bound))
            case Name(name):
                if name not in bound:
                    stack.append((rest, {**bound, name: value}))
                elif equal(bound[name], value):
                    stack.append((rest, bound))
            case Either(values):
                stack.extend(((one, value, rest), bound) for one in reversed(values))
            case Fields(fields):
                if isinstance(value, Mapping) and all(name in value for name, _ in fields):
                    for name, inner in reversed(fields):
                        rest = (inner, value[name], rest)
                    stack.append((rest, bound))
            case Items(items, more):
                # the published `[...]` wants at least one item, `[x, ...]` at least as many as there are patterns
                least = max(len(items), 1) if more else len(items)
                if isinstance(value, list) and (len(value) >= least if more else len(value) == least):
                    for inner, one in reversed(list(zip(items, value, strict=False))):
                        rest = (inner, one, rest)
                    stack.append((rest, bound))
