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
from backends.rml.reader.event_types import Mark, declared
from backends.rml.reader.static_checks import checked, reachable
from rvaft.backend import Observed
from rvaft.model import patterns as p
from rvaft.model.guards import MAX_DEPTH, Guard, Operation, Operator
from rvaft.model.guards import substitute as guard_substitute
from rvaft.model.guards import variables as guard_variables

_CHOICES: Final = 10_000
_NESTING: Final = 100
_ALWAYS: Final = Observed(p.ObjectPattern(()))
"""Every event is an object."""
_NOTHING: Final = p.Literal(None)
"""Stands for no value in guards: whatever is asked of null there is undefined."""
_Value: TypeAlias = p.Pattern | Mark
"""What a name stands for; `Mark.UNEVALUATED` equals nothing."""
_Scope: TypeAlias = Mapping[str, _Value]


class _Unknown(Exception):
    """A question that has no form as a pattern with a guard."""


@dataclass(frozen=True, slots=True)
class _Way:
    """A way to match: a pattern (None after `not`), what names stand for, the guards met so far."""

    pattern: p.Pattern | None
    scope: _Scope
    guards: tuple[Guard, ...] = ()

    def replaced(self, by: Mapping[str, p.Pattern]) -> "_Way":
        """With something else for some variables."""
        pattern = None if self.pattern is None else p.substitute(self.pattern, by)
        scope = {n: value if isinstance(value, Mark) else p.substitute(value, by) for n, value in self.scope.items()}
        return _Way(pattern, scope, tuple(_filled(guard, by) for guard in self.guards))


def observed(text: str) -> tuple[Observed, ...] | None:
    """Everything that the text asks of events, or None where that cannot be said; raises `LanguageError`, `TooLarge`."""
    program = checked(text)
    try:
        return tuple(dict.fromkeys(_Questions(program).all()))
    except _Unknown:
        return None


class _Questions:
    """The questions of one program."""

    def __init__(self, program: s.RmlProgram) -> None:
        self._program = program
        self._fresh = count(1)
        self._found: list[Observed] = []
        self._declared = declared(program)

    def all(self) -> list[Observed]:
        """Those of every use in an equation that the specification can unfold; what every event matches is no question."""
        for _, body in reachable(self._program, ["Main"]):
            for part in s.expressions(body):
                if isinstance(part.data, s.TypeUse):
                    rigid = {name: p.Variable(name) for name in part.data.variables}
                    self._asked(self._ways(part.data, rigid))
        return [one for one in self._found if one != _ALWAYS]

    def _asked(self, ways: Iterator[_Way]) -> None:
        for way in ways:
            if way.pattern is not None:
                self._found.append(_observed(way.pattern, way.guards))
                if len(self._found) > _CHOICES:
                    raise _Unknown

    def _ways(self, use: s.TypeUse, scope: _Scope) -> Iterator[_Way]:
        """The ways to match a use; their scope is that around the use."""
        for declaration in self._declared.get(use.signature, ()):
            inner = _inward(declaration, use, scope)
            if inner is None:
                continue
            ways = self._alternatives(declaration, inner)
            if declaration.negated:
                self._asked(ways)
                ways = iter([_Way(None, inner)])
            for way in ways:
                guards = () if declaration.guard is None else (_condition(declaration.guard, way.scope),)
                outer = self._outward(declaration, use, replace(way, guards=(*way.guards, *guards)), scope)
                if outer is not None:
                    yield outer

    def _alternatives(self, declaration: s.Declaration, inner: _Scope) -> Iterator[_Way]:
        for one in declaration.alternatives:
            if isinstance(one, s.TypeUse):
                yield from self._ways(one, inner)
            else:
                yield from filter(None, (self._way(pattern, inner) for pattern in _choices(one)))

    def _way(self, pattern: p.Pattern, inner: _Scope) -> _Way | None:
        """A pattern with what its names stand for, the others being variables of this event; None where it never matches."""
        if any(inner.get(name) is Mark.UNEVALUATED for name in p.variables(pattern)):
            return None
        own = {name: p.Variable(f"_{next(self._fresh)}") for name in p.variables(pattern) if name not in inner}
        scope = {**inner, **own}
        values = {name: value for name, value in scope.items() if not isinstance(value, Mark)}
        return _Way(p.substitute(pattern, values), scope)

    def _outward(self, declaration: s.Declaration, use: s.TypeUse, way: _Way, scope: _Scope) -> _Way | None:
        """The way as seen from around the use: arguments take up what the parameters stand for, or have to fit it."""
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
    """What the arguments give the parameters; None where one parameter is given two values."""
    inner: dict[str, _Value] = {}
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        value: _Value | None = None
        match given:
            case s.Constant(constant):
                value = p.Literal(constant)
            case s.Name(other):
                value = scope.get(other)
            case s.Apply():
                value = Mark.UNEVALUATED
            case _:
                pass
        if value is not None and inner.setdefault(name, value) != value:
            if isinstance(value, p.Literal) and isinstance(inner[name], p.Literal):
                return None
            raise _Unknown
    return inner


def _equal(value: _Value, wanted: _Value) -> Mapping[str, p.Pattern] | None:
    """What to put for a variable of the event so that two values are equal; None where they cannot be."""
    for one, other in ((value, wanted), (wanted, value)):
        if isinstance(one, p.Variable) and one.local and isinstance(other, p.Literal | p.Variable):
            return {} if one == other else {one.name: other}
    if isinstance(value, p.Literal | p.Variable | Mark) and value == wanted:
        return {}
    if isinstance(value, p.Literal) and isinstance(wanted, p.Literal):
        return None
    raise _Unknown


def _fits(value: _Value, wanted: p.Pattern, whole: p.Pattern | None) -> Mapping[str, p.Pattern]:
    """What to put for a variable so that a value fits a pattern: the pattern, where the variable stands nowhere else."""
    uses = 0 if whole is None else sum(part == value for part in p.walk(whole))
    if isinstance(value, p.Variable) and value.local and uses == 1:
        return {value.name: wanted}
    raise _Unknown


def _observed(pattern: p.Pattern, guards: tuple[Guard, ...]) -> Observed:
    """The question, its own variables numbered from 1: equal questions become one."""
    whole = guards[0] if len(guards) == 1 else Operation(Operator.AND, guards) if guards else None
    names = dict.fromkeys((*p.variables(pattern), *(guard_variables(whole) if whole else ())))
    by = {name: p.Variable(f"_{number}") for number, name in enumerate((n for n in names if n.startswith("_")), 1)}
    return Observed(p.substitute(pattern, by), None if whole is None else _filled(whole, by))


# -- patterns ----------------------------------------------------------------------------------------------------------


def _choices(value: s.Value) -> Iterator[p.Pattern]:
    """The patterns that a pattern with `|` stands for, names as variables; counted before any is made."""

    def size(part: s.Part, below: list[tuple[int, int]]) -> tuple[int, int]:
        sizes, depths = zip(*below, strict=True) if below else ((), (-1,))
        return (sum if isinstance(part, s.Either) else prod)(sizes), 1 + max(depths)

    number, depth = s.fold(value, size)
    if number > _CHOICES or depth > _NESTING:
        raise _Unknown
    return _alternatives(value)


def _alternatives(value: s.Value) -> Iterator[p.Pattern]:
    match value:
        case s.Constant(constant):
            yield p.Literal(constant)
        case s.Name(name):
            yield p.Variable(name)
        case s.Ignored():
            yield p.Anything()
        case s.Either(values):
            for one in values:
                yield from _alternatives(one)
        case s.Fields(fields):
            for inner in product(*(list(_alternatives(one)) for _, one in fields)):
                yield p.ObjectPattern(tuple((name, part) for (name, _), part in zip(fields, inner, strict=True)))
        case s.Items(items, more):
            if more:
                raise _Unknown
            yield from map(p.ListPattern, product(*(list(_alternatives(one)) for one in items)))


# -- guards ------------------------------------------------------------------------------------------------------------
#
# RML compares two numbers or two strings and nothing else, while `==` of a guard compares all values. So `x == y` becomes
# `x <= y and x >= y`, and `x != y` becomes `x < y or x > y`, which are undefined where RML's have no value.

_SAME: Final = {
    **{sign: Operator(sign) for sign in ("<", "<=", ">", ">=", "+", "-", "*", "/", "neg")},
    "&&": Operator.AND,
    "||": Operator.OR,
}
_TRUTHS: Final = frozenset({Operator.AND, Operator.OR, Operator.LT, Operator.LE, Operator.GT, Operator.GE})


def _condition(data: s.Data, scope: _Scope, depth: int = 0) -> Guard:
    """A `with` of RML as a guard that holds for the same values; unbound names, objects and lists have no value there."""
    if depth > MAX_DEPTH:
        raise _Unknown
    match data:
        case s.Constant(value):
            return p.Literal(value)
        case s.Name(name):
            return _value(scope.get(name, _NOTHING))
        case s.Apply(sign, operands):
            parts = tuple(_condition(operand, scope, depth + 1) for operand in operands)
            return _operation(sign, parts)


def _operation(sign: str, parts: tuple[Guard, ...]) -> Guard:
    truths = any(isinstance(part, Operation) and part.operator in _TRUTHS for part in parts)
    if truths and sign not in ("&&", "||"):  # a truth value is neither compared nor calculated with
        return _NOTHING
    if sign == "==":
        return Operation(Operator.AND, (Operation(Operator.LE, parts), Operation(Operator.GE, parts)))
    if sign == "!=":
        return Operation(Operator.OR, (Operation(Operator.LT, parts), Operation(Operator.GT, parts)))
    if sign not in _SAME:
        raise _Unknown
    return Operation(_SAME[sign], parts)


def _value(value: _Value) -> Guard:
    return value if isinstance(value, p.Literal | p.Variable) else _NOTHING


def _filled(guard: Guard, by: Mapping[str, p.Pattern]) -> Guard:
    return guard_substitute(guard, {name: _value(pattern) for name, pattern in by.items()})
