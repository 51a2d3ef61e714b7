"""Matching of events with event types, and the patterns that all event types of a text use.

Declarations of one name are alternatives, in order. `|` in a pattern stands for several patterns;
the first field varies slowest.
"""

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from itertools import chain, count, product
from math import prod
from typing import Any, Final, TypeAlias

from backends.rml.reader import syntax as s
from backends.rml.reader.parser import parse
from rvaft.backend import Observed
from rvaft.errors import NotExpressible, unwritten
from rvaft.model import guards as g
from rvaft.model import patterns as p
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.values import Json, equal, is_number

Number: TypeAlias = int | float
Bound: TypeAlias = Mapping[str, Json]

# Values of data expressions; `None` for wrong types and unbound variables. Integers are exact,
# other numbers are IEEE doubles, and strings compare by code points, as in trees. The published
# monitor uses Prolog's real constraints instead (see `cross_check.published`).

_MAX_BITS: Final = 100_000


def _power(base: Number, exponent: Number) -> Number:
    if isinstance(base, int) and isinstance(exponent, int) and base.bit_length() * abs(exponent) > _MAX_BITS:
        raise OverflowError
    result = base**exponent
    return math.nan if isinstance(result, complex) else result


_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
_CALCULATE: Final[Mapping[str, Callable[..., Number]]] = {
    "neg": operator.neg, "abs": abs, "sin": math.sin, "cos": math.cos, "tan": math.tan, "min": min, "max": max,
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "^": _power,
}  # fmt: skip


def value(data: s.Data, values: Bound) -> Json:
    """Return a JSON value, or None if the data has no value (null counts as none)."""

    def step(part: s.Data, given: list[Json]) -> Json:
        match part:
            case s.Constant(constant):
                return constant
            case s.Name(name):
                return values.get(name)
            case s.Apply(sign):
                return _applied(sign, given)

    return s.fold(data, step)


def _mathematical(number: Number) -> Number:
    return int(number) if isinstance(number, float) and number.is_integer() else number


def _applied(sign: str, given: list[Json]) -> Json:
    if sign in ("&&", "||"):  # the first operand if it decides, else the second
        first, second = given
        decided = first if not isinstance(first, bool) or first is (sign == "||") else second
        return decided if isinstance(decided, bool) else None
    strings = sign in _COMPARE and all(isinstance(operand, str) for operand in given)
    if not strings and not all(is_number(operand) and operand - operand == 0 for operand in given):
        return None
    if sign in _COMPARE:
        return _COMPARE[sign](*given)
    try:
        result = _CALCULATE[sign](*map(_mathematical, given))
    except (ZeroDivisionError, OverflowError, ValueError):
        return None
    return result if isinstance(result, int) or math.isfinite(result) else None


def argument(data: s.Data, values: Bound) -> Json:
    """Return the value of an argument of a generic equation; an unbound variable or an error is
    false.
    """
    found = value(data, values)
    known = isinstance(data, s.Constant) or (isinstance(data, s.Name) and data.name in values)
    return False if found is None and not known else found


# Matching.


class Sentinel(Enum):
    """Values that equal only themselves."""

    UNBOUND = auto()
    """A variable of an event type that the match does not bind."""
    UNEVALUATED = auto()


UNBOUND: Final = Sentinel.UNBOUND


class EventTypes:
    """The event types of one specification."""

    def __init__(self, program: s.RmlProgram) -> None:
        self._declared = program.declared

    def matches(self, use: s.TypeUse, event: Json) -> Iterator[dict[str, Json]]:
        """Yield for each match the value of every variable argument, or `UNBOUND`."""
        wanted = [parameter.name for parameter in use.parameters if isinstance(parameter, s.Name)]
        for found in self._ways(use, event, {}):
            yield {name: found.get(name, UNBOUND) for name in wanted}
            if not wanted:
                return

    def _ways(self, use: s.TypeUse, event: Json, bound: Bound) -> Iterator[Bound]:
        for declaration in self._declared.get(s.signature(use), ()):
            inner: dict[str, Json] = {}
            pairs = list(zip(declaration.parameters, use.parameters, strict=True))
            for name, given in pairs:
                known = _given(given, bound)
                if known is not UNBOUND and not equal(inner.setdefault(name, known), known):
                    break  # one parameter has two values
            else:
                ways = self._alternatives(declaration, event, inner)
                if declaration.negated:
                    ways = iter([inner] if next(ways, None) is None else [])
                for found in ways:
                    if declaration.guard is None or value(declaration.guard, found) is True:
                        outer = [bound]
                        for name, given in pairs:  # match pattern arguments in order
                            if name in found and isinstance(given, s.Name | s.Fields | s.Items):
                                outer = [after for before in outer for after in _matching(given, found[name], before)]
                        yield from outer

    def _alternatives(self, declaration: s.Declaration, event: Json, inner: Bound) -> Iterator[Bound]:
        for one in declaration.alternatives:
            yield from self._ways(one, event, inner) if isinstance(one, s.TypeUse) else _matching(one, event, inner)


def _given(given: s.Parameter, bound: Bound) -> Json:
    match given:
        case s.Constant(constant):
            return constant
        case s.Name(name):
            return bound.get(name, UNBOUND)
        case s.Apply():
            return Sentinel.UNEVALUATED
        case _:
            return UNBOUND


def _matching(pattern: s.Value, event: Json, bound: Bound) -> Iterator[Bound]:
    """Yield the matches of a pattern with a value, with an explicit stack for any nesting."""
    stack: list[tuple[Any, Bound]] = [((pattern, event, None), bound)]
    while stack:
        todo, bound = stack.pop()
        if todo is None:
            yield bound
            continue
        pattern, found, rest = todo
        match pattern:
            case s.Wildcard():
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
                # the published `[...]` needs at least one item, `[x, ...]` at least one per pattern
                least = max(len(items), 1) if more else len(items)
                if isinstance(found, list) and (len(found) >= least if more else len(found) == least):
                    for inner, one in reversed(list(zip(items, found, strict=False))):
                        rest = (inner, one, rest)
                    stack.append((rest, bound))


# The patterns with guards that an RML text uses.
#
# Every use of an event type that is reachable from `Main` is unfolded into *ways* to match: one
# alternative of each declaration, with arguments and derived types filled in, and the guards. `not`
# contributes what it negates. Variables of expressions are shared between events and keep their
# names; variables of declarations are local and begin with `_`.
#
# The result is None for open lists, functions in guards, or a value that must equal a part of the
# event and match a pattern.

_CHOICES: Final = 10_000
_NESTING: Final = 100
_ALWAYS: Final = Observed(p.ObjectPattern(()))
"""Every event is an object."""
_NOTHING: Final = p.Literal(None)
"""A guard operand without value: operations on null are undefined."""
_Value: TypeAlias = p.Pattern | Sentinel
_Scope: TypeAlias = Mapping[str, _Value]


class _Unknown(Exception):
    """A use that is not expressible as a pattern with a guard."""


@dataclass(frozen=True, slots=True)
class _Way:
    """A way to match; the pattern is None after `not`."""

    pattern: p.Pattern | None
    scope: _Scope
    guards: tuple[Guard, ...] = ()

    def replaced(self, by: Mapping[str, p.Pattern]) -> "_Way":
        pattern = None if self.pattern is None else p.substitute(self.pattern, by)
        scope = {
            n: value if isinstance(value, Sentinel) else p.substitute(value, by) for n, value in self.scope.items()
        }
        return _Way(pattern, scope, tuple(_filled(guard, by) for guard in self.guards))


def observed(text: str) -> tuple[Observed, ...] | None:
    """Return the patterns and guards of a text, or None; raises `LanguageError`, `TooLarge`.

    Patterns that match every event are left out.
    """
    program = parse(text)
    questions = _Questions(program)
    try:
        for equation in program.reachable():
            for part in s.expressions(equation.body):
                if isinstance(part.data, s.TypeUse):
                    questions.ask(questions.ways(part.data, {name: p.Variable(name) for name in part.data.variables}))
    except _Unknown:
        return None
    return tuple(dict.fromkeys(one for one in questions.found if one != _ALWAYS))


def alternatives_of(program: s.RmlProgram, declaration: s.Declaration, use: s.TypeUse) -> list[Observed]:
    """Return the patterns and guards of which a use of one declaration accepts any; raises
    `NotExpressible`.
    """
    questions, derived = _Questions(program), [declaration]
    for one in derived:
        derived += chain.from_iterable(
            program.declared.get(s.signature(each), ()) for each in one.alternatives if isinstance(each, s.TypeUse)
        )
    if any(one.negated for one in derived):
        raise NotExpressible(unwritten("an event type is derived from a negated one"))
    try:
        questions.ask(questions.declared_ways(declaration, use, {name: p.Variable(name) for name in use.variables}))
    except _Unknown:
        raise NotExpressible(unwritten("an event type is no pattern with a guard")) from None
    return questions.found


class _Questions:
    def __init__(self, program: s.RmlProgram) -> None:
        self._fresh = count(1)
        self.found: list[Observed] = []
        self._declared = program.declared

    def ask(self, ways: Iterator[_Way]) -> None:
        for way in ways:
            if way.pattern is None:
                continue
            guards = way.guards
            whole = guards[0] if len(guards) == 1 else Operation(Operator.AND, guards) if guards else None
            names = dict.fromkeys((*p.variables(way.pattern), *(g.variables(whole) if whole else ())))
            by = {name: p.Variable(f"_{number}") for number, name in enumerate((n for n in names if n[0] == "_"), 1)}
            self.found.append(Observed(p.substitute(way.pattern, by), None if whole is None else _filled(whole, by)))
            if len(self.found) > _CHOICES:
                raise _Unknown

    def ways(self, use: s.TypeUse, scope: _Scope) -> Iterator[_Way]:
        for declaration in self._declared.get(s.signature(use), ()):
            yield from self.declared_ways(declaration, use, scope)

    def declared_ways(self, declaration: s.Declaration, use: s.TypeUse, scope: _Scope) -> Iterator[_Way]:
        inner = _inward(declaration, use, scope)
        if inner is None:
            return
        ways = self._alternatives(declaration, inner)
        if declaration.negated:
            self.ask(ways)
            ways = iter([_Way(None, inner)])
        for way in ways:
            guards = () if declaration.guard is None else (_condition(declaration.guard, way.scope),)
            outer = self._outward(declaration, use, replace(way, guards=(*way.guards, *guards)), scope)
            if outer is not None:
                yield outer

    def _alternatives(self, declaration: s.Declaration, inner: _Scope) -> Iterator[_Way]:
        for one in declaration.alternatives:
            if isinstance(one, s.TypeUse):
                yield from self.ways(one, inner)
            else:
                yield from filter(None, (self._way(pattern, inner) for pattern in _choices(one)))

    def _way(self, pattern: p.Pattern, inner: _Scope) -> _Way | None:
        """Return a pattern with its scope, or None if it never matches; it makes unknown names
        local.
        """
        if any(inner.get(name) is Sentinel.UNEVALUATED for name in p.variables(pattern)):
            return None
        own = {name: p.Variable(f"_{next(self._fresh)}") for name in p.variables(pattern) if name not in inner}
        scope = {**inner, **own}
        values = {name: value for name, value in scope.items() if not isinstance(value, Sentinel)}
        return _Way(p.substitute(pattern, values), scope)

    def _outward(self, declaration: s.Declaration, use: s.TypeUse, way: _Way, scope: _Scope) -> _Way | None:
        """Return the way in the surrounding scope: arguments take or must match the parameters'
        values.
        """
        outer, inner = replace(way, scope=dict(scope)), way.scope
        for name, given in zip(declaration.parameters, use.parameters, strict=True):
            if name not in inner:
                continue
            match given:
                case s.Name(other) if other not in outer.scope:
                    outer = replace(outer, scope={**outer.scope, other: inner[name]})
                    continue
                case s.Name(other):
                    by = _equal(inner[name], outer.scope[other])
                case s.Fields() | s.Items():
                    fitting = self._way(next(_choices(given)), outer.scope)
                    if fitting is None or fitting.pattern is None:
                        return None
                    outer = replace(outer, scope=fitting.scope)
                    by = _fits(inner[name], fitting.pattern, outer.pattern)
                case _:
                    continue
            if by is None:
                return None
            outer, inner = outer.replaced(by), replace(outer, scope=inner).replaced(by).scope
        return outer


def _inward(declaration: s.Declaration, use: s.TypeUse, scope: _Scope) -> _Scope | None:
    inner: dict[str, _Value] = {}
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        known = _given(given, scope)
        if known is UNBOUND:
            continue
        value = p.Literal(known) if isinstance(given, s.Constant) else known
        if inner.setdefault(name, value) != value:
            if isinstance(value, p.Literal) and isinstance(inner[name], p.Literal):
                return None
            raise _Unknown
    return inner


def _equal(value: _Value, wanted: _Value) -> Mapping[str, p.Pattern] | None:
    for one, other in ((value, wanted), (wanted, value)):
        if isinstance(one, p.Variable) and one.local and isinstance(other, p.Literal | p.Variable):
            return {} if one == other else {one.name: other}
    if isinstance(value, p.Literal | p.Variable | Sentinel) and value == wanted:
        return {}
    if isinstance(value, p.Literal) and isinstance(wanted, p.Literal):
        return None
    raise _Unknown


def _fits(value: _Value, wanted: p.Pattern, whole: p.Pattern | None) -> Mapping[str, p.Pattern]:
    """Return the substitution that makes a value match a pattern; its variable must occur once."""
    uses = 0 if whole is None else sum(part == value for part in p.walk(whole))
    if isinstance(value, p.Variable) and value.local and uses == 1:
        return {value.name: wanted}
    raise _Unknown


def _choices(value: s.Value) -> Iterator[p.Pattern]:

    def size(part: s.Part, below: list[tuple[int, int]]) -> tuple[int, int]:
        sizes, depths = zip(*below, strict=True) if below else ((), (-1,))
        return (sum if isinstance(part, s.Either) else prod)(sizes), 1 + max(depths)

    def patterns(part: s.Part, below: list[list[p.Pattern]]) -> list[p.Pattern]:
        match part:
            case s.Constant(constant):
                return [p.Literal(constant)]
            case s.Name(name):
                return [p.Variable(name)]
            case s.Wildcard():
                return [p.Anything()]
            case s.Either():
                return [one for found in below for one in found]
            case s.Fields(fields):
                names = [name for name, _ in fields]
                return [p.ObjectPattern(tuple(zip(names, inner, strict=True))) for inner in product(*below)]
            case s.Items(_, more) if not more:
                return [p.ListPattern(inner) for inner in product(*below)]
            case _:
                raise _Unknown

    number, depth = s.fold(value, size)
    if number > _CHOICES or depth > _NESTING:
        raise _Unknown
    made: list[p.Pattern] = s.fold(value, patterns)
    return iter(made)


# RML compares only two numbers or two strings, but `==` of guards compares all values. `x == y`
# therefore becomes `x <= y and x >= y`, and `x != y` becomes `x < y or x > y`: undefined exactly
# where RML's comparisons are.

_NUMBERS: Final = frozenset({Operator.ABS, Operator.MIN, Operator.MAX})
"""Functions that trees also have."""
_SAME: Final = {
    **{sign: Operator(sign) for sign in ("<", "<=", ">", ">=", "+", "-", "*", "/", "neg", *_NUMBERS)},
    "&&": Operator.AND,
    "||": Operator.OR,
}
_PAIRS: Final = {
    "==": (Operator.AND, Operator.LE, Operator.GE),
    "!=": (Operator.OR, Operator.LT, Operator.GT),
}


def _condition(data: s.Data, scope: _Scope, depth: int = 0) -> Guard:
    """Return an RML `with` as a guard; unbound names, objects and lists have no value."""
    if depth > g.MAX_DEPTH:
        raise _Unknown
    match data:
        case s.Constant(value):
            return p.Literal(value)
        case s.Name(name):
            return _value(scope.get(name, _NOTHING))
        case s.Apply(sign, operands):
            parts = tuple(_condition(operand, scope, depth + 1) for operand in operands)
            truths = any(isinstance(part, Operation) and part.operator not in g.ARITHMETIC | _NUMBERS for part in parts)
            if truths and sign not in ("&&", "||"):  # Booleans are neither compared nor calculated with
                return _NOTHING
            if sign in _PAIRS:
                joint, *compared = _PAIRS[sign]
                return Operation(joint, tuple(Operation(one, parts) for one in compared))
            if sign not in _SAME:
                raise _Unknown
            return Operation(_SAME[sign], parts)


def _value(value: _Value) -> Guard:
    return value if isinstance(value, p.Literal | p.Variable) else _NOTHING


def _filled(guard: Guard, by: Mapping[str, p.Pattern]) -> Guard:
    return g.substitute(guard, {name: _value(pattern) for name, pattern in by.items()})
