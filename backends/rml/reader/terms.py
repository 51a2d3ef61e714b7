"""The states of a running specification: terms, one object for all that are equal.

A term is kept once (hash-consing), so equality is identity and a state is hashed in no time. Equations are unfolded only when a
step needs them: a call holds the name of the equation and the values that variables had where it stood, no more than the
equation can use. Nothing here recurses over a term.

A variable that an event passed without binding it is *open*; open variables have names that begin with `?`.
"""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias
from weakref import WeakValueDictionary

from backends.rml.reader.event_types import UNBOUND, argument
from backends.rml.reader.static_checks import references, settle
from backends.rml.reader.syntax import Constant, Data, Expression, Name, RmlProgram, TypeUse, fold, names
from rvaft.model.values import Json

Values: TypeAlias = Mapping[str, Json | Name]
"""What variables stand for: a value, or (for one that an event passed without binding) another variable."""
Environment: TypeAlias = tuple[tuple[str, Json], ...]
_FLAT: Final = ("and", "or", "shuffle")


def mark(value: Json | Name) -> Hashable:
    """A hashable stand-in for a value or a variable: two have the same one only where nothing can ever tell them apart.

    Finer than equality of JSON values: 1 and 1.0 are equal, but calculate differently once they are large.
    """
    out: list[Hashable] = []
    todo = [value]
    while todo:
        match todo.pop():
            case str(text):
                out.append(text)
            case bool() | float() | int() | None as scalar:
                out.append((type(scalar), scalar))
            case Mapping() as fields:
                out.append((Mapping, tuple(fields)))
                todo.extend(fields.values())
            case list(items):
                out.append((list, len(items)))
                todo.extend(items)
            case other:
                out.append(other)
    return out[0] if len(out) == 1 else tuple(out)


def _mark_arguments(arguments: Iterable[Any]) -> Hashable:
    """A stand-in for arguments: by their values, else variables by name and expressions by identity."""
    return tuple(mark(one.value) if isinstance(one, Constant) else one for one in arguments)


def _mark_environment(environment: Environment) -> Hashable:
    return tuple((name, mark(value)) for name, value in environment)


def _free_variables(program: RmlProgram) -> Mapping[str, frozenset[str]]:
    """For each equation the variables it can use, its parameters left out: its own, and those of equations it refers to.

    Equations see the variables of the place they are unfolded at (scope is dynamic), so this is what has to travel with them.
    """
    found: dict[str, frozenset[str]] = {}
    uses: dict[str, dict[tuple[str, frozenset[str]], None]] = {}
    for equation in program.equations.values():
        own, uses[equation.name] = set[str](), {}
        todo = [(equation.body, frozenset(equation.parameters))]
        while todo:
            part, hidden = todo.pop()
            if part.operator == "call":  # with the variables of blocks around the reference
                uses[equation.name][part.data[0], hidden] = None
            own |= _used(part) - hidden
            hidden |= {part.data} if part.operator == "block" else frozenset()
            todo.extend((inner, hidden) for inner in part.parts)
        found[equation.name] = frozenset(own)

    def is_new(name: str) -> bool:
        before = found[name]
        found[name] = before.union(*(found.get(used, before) - hidden for used, hidden in uses[name]))
        return found[name] != before

    settle({name: references(equation.body) for name, equation in program.equations.items()}, is_new)
    return found


def _used(part: Expression) -> frozenset[str]:
    """The variables in the data of an expression."""
    match part:
        case Expression("event" | "filter", data=use):
            return frozenset(use.variables)
        case Expression("if", data=(condition, _)):
            return names(condition)
        case Expression("call", data=(_, arguments, _)):
            return frozenset[str]().union(*map(names, arguments))
        case _:
            return frozenset()


@dataclass(slots=True, eq=False, weakref_slot=True, repr=False)
class RmlTerm:
    """One term: an `Expression` whose calls and conditions know the values of variables. `free` are those it can still use."""

    operator: str
    parts: tuple["RmlTerm", ...]
    data: Any
    free: frozenset[str]
    halts: bool | None = None

    @property
    def open(self) -> bool:
        """Whether it can still use an open variable."""
        return any(map(is_open, self.free))


class TermTable:
    """The terms of one program."""

    def __init__(self, program: RmlProgram) -> None:
        self._equations = program.equations
        self._free = _free_variables(program)
        self._known: WeakValueDictionary[Hashable, RmlTerm] = WeakValueDictionary()
        self._bodies: dict[str, RmlTerm] = {}
        self.empty: Final = self.make("empty")
        self.all: Final = self.make("all")
        self.nothing: Final = self.make("nothing")

    def make(self, operator: str, parts: Iterable[RmlTerm] = (), data: Any = None) -> RmlTerm:
        """The one term of that form, nested joins of one kind made flat."""
        found = _flat(operator, parts) if operator in _FLAT else list(parts)
        distinct, own = self._described(operator, data)
        identity = (operator, tuple(map(id, found)), distinct)
        known = self._known.get(identity)
        if known is None:
            free = own.union(*(part.free for part in found if part.free))
            known = RmlTerm(operator, tuple(found), data, free - {data} if operator == "block" else free)
            self._known[identity] = known
        return known

    def _described(self, operator: str, data: Any) -> tuple[Hashable, frozenset[str]]:
        """What tells data from other data, and the variables that it uses."""
        match operator, data:
            case "event" | "filter", TypeUse(name, parameters):
                return (name, _mark_arguments(parameters)), data.variables
            case "if", (condition, environment):
                return (id(condition), _mark_environment(environment)), _open(names(condition), environment)
            case "call", (name, arguments, environment):
                usable = self._usable(name, arguments)
                marks = name, _mark_arguments(arguments), _mark_environment(environment)
                return marks, _open(usable, environment)
            case _:
                return data, frozenset()

    def _usable(self, name: str, arguments: Iterable[Data]) -> frozenset[str]:
        return self._free.get(name, frozenset[str]()).union(*map(names, arguments))

    # -- from the text -------------------------------------------------------------------------------------------------

    def body(self, name: str) -> RmlTerm:
        """The right-hand side of an equation."""
        if name not in self._bodies:
            self._bodies[name] = fold(
                self._equations[name].body, lambda part, below: self._filled(part, below, {}), lambda part: part.parts
            )
        return self._bodies[name]

    def unfolded(self, term: RmlTerm) -> RmlTerm:
        """The body of the equation that a call names, with its arguments and values; nothing where the arguments do not fit."""
        name, arguments, environment = term.data
        parameters = self._equations[name].parameters
        if len(parameters) != len(arguments):
            return self.nothing
        values = dict(environment)
        given = {p: argument(a, values) for p, a in zip(parameters, arguments, strict=True)}
        return self.substituted(self.body(name), {**values, **given})

    def _filled(self, part: Expression | RmlTerm, below: list[RmlTerm], values: Values) -> RmlTerm:
        """A term with new parts, and with values for the variables in its data."""
        match part.operator, part.data:
            case "cat", _:
                return self.sequence(below)
            case "event" | "filter", TypeUse(name, parameters):
                given = (_value(one, values) if isinstance(one, Name) else one for one in parameters)
                return self.make(part.operator, below, TypeUse(name, tuple(given)))
            case "block", variable:
                return self.block(variable, below[0])
            case "if", (condition, environment):
                known = {**values, **_renamed(environment, values)}
                return self.make("if", below, (condition, _environment(known, names(condition))))
            case "call", (name, arguments, environment):
                return self._call(name, arguments, {**values, **_renamed(environment, values)})
            case operator, data:
                return self.make(operator, below, data)

    def _call(self, name: str, arguments: tuple[Data, ...], values: Values) -> RmlTerm:
        """An equation with arguments and the values that its variables have where it stands."""
        environment = _environment(values, self._usable(name, arguments))
        known = {n: v for n, v in environment if not isinstance(v, Name)}
        given = tuple(Constant(argument(a, known)) if names(a) <= known.keys() else a for a in arguments)
        if all(isinstance(a, Constant) for a in given):
            environment = _environment(values, self._usable(name, ()))
        return self.make("call", (), (name, given, environment))

    # -- forms, as in the published monitor but for `t | all` (see `deviations`) ---------------------------------------

    def sequence(self, parts: list[RmlTerm]) -> RmlTerm:
        """One after the other, nested to the right."""
        term = parts[-1]
        for before in reversed(parts[:-1]):
            term = self.make("cat", (before, term))
        return term

    def then(self, first: RmlTerm, rest: RmlTerm) -> RmlTerm:
        """What is left of a first part, and the rest; nested to the right by one step, not simplified further."""
        if first in (self.all, self.nothing) or rest is self.empty:
            return first
        if first is self.empty:
            return rest
        if first.operator != "cat":
            return self.sequence([first, rest])
        head, tail = first.parts
        return self.sequence([head, tail, rest])

    def joined(self, operator: str, parts: Iterable[RmlTerm]) -> RmlTerm:
        """A shuffle or a conjunction without the parts that ask for nothing."""
        neutral = self.empty if operator == "shuffle" else self.all
        left = [part for part in _flat(operator, parts) if part is not neutral]
        if len(left) > 1:
            return self.make(operator, left)
        return left[0] if left else neutral

    def block(self, variable: str, body: RmlTerm) -> RmlTerm:
        """`{let variable; body}`; nothing can be bound where nothing is left to do."""
        return body if body in (self.empty, self.all) else self.make("block", (body,), variable)

    # -- substitution --------------------------------------------------------------------------------------------------

    def substituted(self, term: RmlTerm, values: Values) -> RmlTerm:
        """The term with values for variables; a block hides its own variable."""
        start = term.free.intersection(values)
        done: dict[tuple[RmlTerm, frozenset[str]], RmlTerm] = {}
        todo = [(term, start, False)] if start else []
        while todo:
            at, wanted, ready = todo.pop()
            if not wanted:
                done[at, wanted] = at
            if (at, wanted) in done:
                continue
            hidden = {at.data} if at.operator == "block" else set()
            below = [(part, (wanted & part.free) - hidden) for part in at.parts]
            if ready:
                done[at, wanted] = self._filled(at, [done[b] for b in below], {n: values[n] for n in wanted})
            else:
                todo.append((at, wanted, True))
                todo.extend((part, inner, False) for part, inner in below)
        return done[term, start] if start else term

    def canonical(self, term: RmlTerm) -> RmlTerm:
        """The term with its open variables numbered by where they first occur, so that equal states are equal terms."""
        order: dict[str, None] = {}
        seen: set[RmlTerm] = set()
        todo = [term]
        while todo:
            at = todo.pop()
            if at not in seen and at.open:
                seen.add(at)
                order.update(dict.fromkeys(filter(is_open, _own_names(at))))
                todo.extend(reversed(at.parts))
        return self.substituted(term, {name: Name(f"?{index}") for index, name in enumerate(order)})


def _flat(operator: str, parts: Iterable[RmlTerm]) -> list[RmlTerm]:
    return [inner for part in parts for inner in (part.parts if part.operator == operator else (part,))]


def _value(name: Name, values: Values) -> Constant | Name:
    value = values.get(name.name, name)
    return value if isinstance(value, Name) else Constant(value)


def _environment(values: Values, wanted: frozenset[str]) -> Environment:
    return tuple(sorted(((n, v) for n, v in values.items() if n in wanted), key=lambda pair: pair[0]))


def _renamed(environment: Environment, values: Values) -> Values:
    return {n: values.get(v.name, v) if isinstance(v, Name) else v for n, v in environment}


def _open(usable: frozenset[str], environment: Environment) -> frozenset[str]:
    """The variables that something can still use when it knows some of them, by their own names or as others."""
    known = {name for name, _ in environment}
    return (usable - known).union(value.name for _, value in environment if isinstance(value, Name))


def _own_names(term: RmlTerm) -> list[str]:
    match term.operator, term.data:
        case "event" | "filter", TypeUse(_, parameters):
            return [one.name for one in parameters if isinstance(one, Name)]
        case "if" | "call", (*_, environment):
            return [value.name for _, value in environment if isinstance(value, Name)]
        case _:
            return []


def is_open(name: str) -> bool:
    """Whether a variable is one that an event passed without binding it."""
    return name.startswith("?")


def opened(bound: Mapping[str, Json]) -> Mapping[str, Json]:
    """Those of some bindings that give an open variable its value."""
    return {name: value for name, value in bound.items() if is_open(name) and value is not UNBOUND} if bound else bound
