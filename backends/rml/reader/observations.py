"""What an RML text asks of events, as patterns with guards.

Every use of an event type in an equation that `Main` reaches is unfolded into *ways* to match: one pattern for each choice in each
declaration, with the arguments and the patterns of derived types filled in, and the guards met on the way. The reader asks events nothing else,
so two events that match the same ways are the same to it. `not` asks what it negates. A variable of an expression ties events
together and keeps its name; variables of declarations belong to one event and begin with `_`.

Unknown (None) where a question has no such form: lists that are open at the end, functions in guards, a value that has to equal a part
of the event *and* to match a pattern of its own.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count, product
from math import prod
from typing import Final, TypeAlias

from backends.rml.reader import syntax as s
from backends.rml.reader.event_types import ANY, NONE, NOTHING, Untranslatable, condition
from backends.rml.reader.parser import parse
from backends.rml.reader.static_checks import check
from rvaft.backend import Observed
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    substitute,
    variables,
    walk,
)

_CHOICES: Final = 10_000
_NESTING: Final = 100


_ALWAYS: Final = Observed(ObjectPattern(()))
"""Every event is an object."""


class _Unknown(Exception):
    """A question that has no form as a pattern with a guard."""


class _Never:
    """The value of an argument that is not calculated: nothing equals it."""


_NEVER: Final = _Never()
_Value: TypeAlias = Pattern | _Never
_Scope: TypeAlias = Mapping[str, _Value]


@dataclass(frozen=True, slots=True)
class _Way:
    """A way to match: a pattern (None after `not`), what names stand for, the guards met so far."""

    pattern: Pattern | None
    scope: _Scope
    guards: tuple[Guard, ...] = ()


def observed(text: str) -> tuple[Observed, ...] | None:
    """Everything that the text asks of events, or None where that cannot be said; raises `LanguageError`, `TooLarge`."""
    check(program := parse(text))
    try:
        return tuple(dict.fromkeys(_Questions(program).all()))
    except _Unknown:
        return None


class _Questions:
    """The questions of one program."""

    def __init__(self, program: s.Program) -> None:
        self._program = program
        self._fresh = count(1)
        self._found: list[Observed] = []
        self._by_name: dict[tuple[str, int], list[s.Declaration]] = {}
        for declaration in (*program.declarations, ANY, NONE):
            self._by_name.setdefault((declaration.name, len(declaration.parameters)), []).append(declaration)

    def all(self) -> list[Observed]:
        """Those of every use; what every event matches is no question."""
        for use in _uses(self._program):
            rigid = {p.name: Variable(p.name) for p in use.parameters if isinstance(p, s.Name)}
            self._asked(self._ways(use, rigid))
        return [one for one in self._found if one != _ALWAYS]

    def _asked(self, ways: Iterator[_Way]) -> None:
        for way in ways:
            if way.pattern is not None:
                self._found.append(_observed(way))
                if len(self._found) > _CHOICES:
                    raise _Unknown

    def _ways(self, use: s.TypeUse, scope: _Scope) -> Iterator[_Way]:
        """The ways to match a use; their scope is that around the use."""
        for declaration in self._by_name.get((use.name, len(use.parameters)), ()):
            inner = _inward(declaration, use, scope)
            if inner is None:
                continue
            for way in self._declared(declaration, inner):
                outer = self._outward(declaration, use, way, scope)
                if outer is not None:
                    yield outer

    def _declared(self, declaration: s.Declaration, inner: _Scope) -> Iterator[_Way]:
        ways = self._parts(declaration, inner)
        if declaration.negated:
            self._asked(ways)
            ways = iter([_Way(None, inner)])
        for way in ways:
            if declaration.guard is None:
                yield way
                continue
            known: dict[str, Pattern] = {
                name: NOTHING if isinstance(value, _Never) else value for name, value in way.scope.items()
            }
            try:
                guard = condition(declaration.guard, known)
            except Untranslatable:
                raise _Unknown from None
            yield replace(way, guards=(*way.guards, guard))

    def _parts(self, declaration: s.Declaration, inner: _Scope) -> Iterator[_Way]:
        for value in declaration.values:
            for pattern in _choices(value):
                way = self._way(pattern, inner)
                if way is not None:
                    yield way
        for parent in declaration.parents:
            yield from self._ways(parent, inner)

    def _way(self, pattern: Pattern, inner: _Scope) -> _Way | None:
        """A pattern with what its names stand for, the others being variables of this event; None where it never matches."""
        if any(inner.get(name) is _NEVER for name in variables(pattern)):
            return None
        own = {name: Variable(f"_{next(self._fresh)}") for name in variables(pattern) if name not in inner}
        scope = {**inner, **own}
        values = {name: value for name, value in scope.items() if not isinstance(value, _Never)}
        return _Way(substitute(pattern, values), scope)

    def _outward(self, declaration: s.Declaration, use: s.TypeUse, way: _Way, scope: _Scope) -> _Way | None:
        """The way as seen from around the use: arguments take up what the parameters stand for, or have to fit it."""
        outer, inside = replace(way, scope=dict(scope)), way.scope
        for name, given in zip(declaration.parameters, use.parameters, strict=True):
            if name not in inside:
                continue
            value = inside[name]
            match given:
                case s.Name(other) if other not in outer.scope:
                    outer = replace(outer, scope={**outer.scope, other: value})
                    continue
                case s.Name(other):
                    by = _equal(value, outer.scope[other])
                case s.Fields() | s.Items():
                    fitting = self._way(next(_choices(given)), outer.scope)
                    if fitting is None:
                        return None
                    outer = replace(outer, scope=fitting.scope)
                    by = _fits(value, fitting.pattern, way_in=outer.pattern)
                case _:
                    continue
            if by is None:
                return None
            outer, inside = _replaced(outer, by), _replaced(replace(outer, scope=inside), by).scope
        return outer


def _inward(declaration: s.Declaration, use: s.TypeUse, scope: _Scope) -> _Scope | None:
    """What the arguments give the parameters; None where one parameter is given two values."""
    inner: dict[str, _Value] = {}
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        value: _Value | None = None
        match given:
            case s.Constant(constant):
                value = Literal(constant)
            case s.Name(other):
                value = scope.get(other)
            case s.Unevaluated():
                value = _NEVER
            case _:
                pass
        if value is not None and inner.setdefault(name, value) != value:
            if isinstance(value, Literal) and isinstance(inner[name], Literal):
                return None
            raise _Unknown
    return inner


def _equal(value: _Value, wanted: _Value) -> Mapping[str, Pattern] | None:
    """What to put for a variable of the event so that two values are equal; None where they cannot be."""
    for one, other in ((value, wanted), (wanted, value)):
        if isinstance(one, Variable) and one.local and isinstance(other, (Literal, Variable)):
            return {} if one == other else {one.name: other}
    if isinstance(value, (Literal, Variable)) and value == wanted:
        return {}
    if value is wanted is _NEVER:
        return {}
    if isinstance(value, Literal) and isinstance(wanted, Literal):
        return None
    raise _Unknown


def _fits(value: _Value, wanted: Pattern | None, way_in: Pattern | None) -> Mapping[str, Pattern]:
    """What to put for a variable so that a value fits a pattern: the pattern, where the variable stands nowhere else."""
    assert wanted is not None
    uses = 0 if way_in is None else sum(part == value for part in walk(way_in))
    if isinstance(value, Variable) and value.local and uses == 1:
        return {value.name: wanted}
    raise _Unknown


def _replaced(way: _Way, by: Mapping[str, Pattern]) -> _Way:
    pattern = None if way.pattern is None else substitute(way.pattern, by)
    scope = {n: value if isinstance(value, _Never) else substitute(value, by) for n, value in way.scope.items()}
    return _Way(pattern, scope, tuple(_filled(guard, by) for guard in way.guards))


def _filled(guard: Guard, by: Mapping[str, Pattern]) -> Guard:
    match guard:
        case Variable(name) if name in by:
            value = by[name]
            return value if isinstance(value, (Literal, Variable)) else NOTHING
        case Operation(operator, operands):
            return Operation(operator, tuple(_filled(operand, by) for operand in operands))
        case _:
            return guard


def _observed(way: _Way) -> Observed:
    """The question, its own variables numbered from 1: equal questions become one."""
    assert way.pattern is not None
    whole = way.guards[0] if len(way.guards) == 1 else Operation(Operator.AND, way.guards) if way.guards else None
    names = dict.fromkeys((*variables(way.pattern), *(guard_variables(whole) if whole else ())))
    by = {name: Variable(f"_{number}") for number, name in enumerate((n for n in names if n.startswith("_")), 1)}
    return Observed(substitute(way.pattern, by), None if whole is None else _filled(whole, by))


def _uses(program: s.Program) -> Iterator[s.TypeUse]:
    """The event types in every equation that the specification can unfold."""
    seen, todo = {"Main"}, ["Main"]
    while todo:
        for part in s.bottom_up(program.equations[todo.pop()].body):
            match part:
                case s.Reference(name) if name not in seen:
                    seen.add(name)
                    todo.append(name)
                case s.Occurs(use) | s.Filtered(use):
                    yield use
                case _:
                    pass


def _choices(value: s.Value) -> Iterator[Pattern]:
    """The patterns that a pattern with `|` stands for, names as variables."""
    if _number(value, 0) > _CHOICES:
        raise _Unknown
    return _alternatives(value)


def _number(value: s.Value, depth: int) -> int:
    """How many they are."""
    if depth > _NESTING:
        raise _Unknown
    match value:
        case s.Either(values):
            return sum(_number(one, depth + 1) for one in values)
        case s.Fields(fields):
            return prod(_number(one, depth + 1) for _, one in fields)
        case s.Items(items):
            return prod(_number(one, depth + 1) for one in items)
        case _:
            return 1


def _alternatives(value: s.Value) -> Iterator[Pattern]:
    match value:
        case s.Constant(constant):
            yield Literal(constant)
        case s.Name(name):
            yield Variable(name)
        case s.Ignored():
            yield Anything()
        case s.Either(values):
            for one in values:
                yield from _alternatives(one)
        case s.Fields(fields):
            for inner in product(*(list(_alternatives(one)) for _, one in fields)):
                yield ObjectPattern(tuple((name, part) for (name, _), part in zip(fields, inner, strict=True)))
        case s.Items(items, False):
            for inner in product(*(list(_alternatives(one)) for one in items)):
                yield ListPattern(inner)
        case _:
            raise _Unknown
