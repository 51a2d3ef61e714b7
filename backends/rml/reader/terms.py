"""The states of a monitor: hash-consed terms.

Equal terms are identical objects. Equations are unfolded on demand: a call holds the equation name
and the variable values that the equation can use. Nothing recurses over terms. A variable that an
event matched without binding is *open*; its name begins with `?`.
"""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias
from weakref import WeakValueDictionary

from backends.rml.reader.event_types import UNBOUND, argument
from backends.rml.reader.syntax import Constant, Data, Expression, Name, RmlProgram, TypeUse, fold, names
from rvaft.model.values import Json

Values: TypeAlias = Mapping[str, Json | Name]
"""Values of variables; an open variable has another variable as its value."""
Environment: TypeAlias = tuple[tuple[str, Json], ...]
_FLAT: Final = ("and", "or", "shuffle")


def mark(value: Json | Name) -> Hashable:
    """Return a hashable key of a value or variable; equal keys are indistinguishable.

    Keys are finer than JSON equality: 1 and 1.0 are equal but have different keys.
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


def is_open(name: str) -> bool:
    """Return whether a variable is open."""
    return name.startswith("?")


def _free_variables(program: RmlProgram) -> Mapping[str, frozenset[str]]:
    """Return the free variables of each equation, with those of the equations that it refers to.

    Scope is dynamic: an equation uses the variables of the place where it is unfolded.
    """
    found: dict[str, frozenset[str]] = {}
    uses: dict[str, set[tuple[str, frozenset[str]]]] = {}
    for equation in program.equations.values():
        own, uses[equation.name] = set[str](), set()
        todo = [(equation.body, frozenset(equation.parameters))]
        while todo:
            part, hidden = todo.pop()
            match part:
                case Expression("call", data=(name, arguments, _)):  # with the variables of surrounding blocks
                    uses[equation.name].add((name, hidden))
                    own |= names(*arguments) - hidden
                case Expression("event" | "filter", data=use):
                    own |= use.variables - hidden
                case Expression("if", data=(condition, _)):
                    own |= names(condition) - hidden
                case Expression("block", data=variable):
                    hidden |= {variable}
            todo.extend((inner, hidden) for inner in part.parts)
        found[equation.name] = frozenset(own)

    def is_new(name: str) -> bool:
        before = found[name]
        found[name] = before.union(*(found.get(used, before) - hidden for used, hidden in uses[name]))
        return found[name] != before

    program.settle(is_new)
    return found


@dataclass(slots=True, eq=False, weakref_slot=True, repr=False)
class RmlTerm:
    """An expression whose calls and conditions hold values of variables; `free` are its free
    variables.
    """

    operator: str
    parts: tuple["RmlTerm", ...]
    data: Any
    free: frozenset[str]
    halts: bool | None = None


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
        """Return the unique term of this form; nested joins of one kind are flattened."""
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
        def marked(arguments: Iterable[Any]) -> Hashable:
            return tuple(mark(one.value) if isinstance(one, Constant) else one for one in arguments)

        identity: tuple[Hashable, ...]
        match operator, data:
            case "event" | "filter", TypeUse(name, parameters):
                return (name, marked(parameters)), data.variables
            case "if", (condition, environment):
                identity, usable = (id(condition),), names(condition)
            case "call", (name, arguments, environment):
                identity, usable = (name, marked(arguments)), self._usable(name, arguments)
            case _:
                return data, frozenset()
        # Variables that are still usable, under their own or substituted names.
        unknown = usable.difference(name for name, _ in environment)
        as_others = (value.name for _, value in environment if isinstance(value, Name))
        return (*identity, *((name, mark(value)) for name, value in environment)), unknown.union(as_others)

    def _usable(self, name: str, arguments: Iterable[Data]) -> frozenset[str]:
        return self._free.get(name, frozenset[str]()) | names(*arguments)

    # From the text.

    def body(self, name: str) -> RmlTerm:
        """Return the right-hand side of an equation."""
        if name not in self._bodies:
            self._bodies[name] = fold(
                self._equations[name].body, lambda part, below: self._filled(part, below, {}), lambda part: part.parts
            )
        return self._bodies[name]

    def unfolded(self, term: RmlTerm) -> RmlTerm:
        """Return the body of a called equation with arguments and values; `nothing` on an arity
        mismatch.
        """
        name, arguments, environment = term.data
        parameters = self._equations[name].parameters
        if len(parameters) != len(arguments):
            return self.nothing
        values = dict(environment)
        given = {p: argument(a, values) for p, a in zip(parameters, arguments, strict=True)}
        return self.substituted(self.body(name), {**values, **given})

    def _filled(self, part: Expression | RmlTerm, below: list[RmlTerm], values: Values) -> RmlTerm:

        def known(environment: Environment) -> Values:
            return {**values, **{n: values.get(v.name, v) if isinstance(v, Name) else v for n, v in environment}}

        match part.operator, part.data:
            case "cat", _:
                return self.sequence(below)
            case "event" | "filter", TypeUse(name, parameters):
                return self.make(part.operator, below, TypeUse(name, tuple(_value(one, values) for one in parameters)))
            case "if", (condition, environment):
                return self.make("if", below, (condition, _environment(known(environment), names(condition))))
            case "call", (name, arguments, environment):
                here = known(environment)
                usable = _environment(here, self._usable(name, arguments))
                bound = {n: v for n, v in usable if not isinstance(v, Name)}
                given = tuple(Constant(argument(a, bound)) if names(a) <= bound.keys() else a for a in arguments)
                if all(isinstance(a, Constant) for a in given):
                    usable = _environment(here, self._usable(name, ()))
                return self.make("call", (), (name, given, usable))
            case operator, data:
                return self.make(operator, below, data)

    # Normal forms, as in the published monitor apart from `t | all` (see `cross_check.published`).

    def sequence(self, parts: list[RmlTerm]) -> RmlTerm:
        """Return a sequence nested to the right."""
        term = parts[-1]
        for before in reversed(parts[:-1]):
            term = self.make("cat", (before, term))
        return term

    def then(self, first: RmlTerm, rest: RmlTerm) -> RmlTerm:
        """Return the remainder of a first part, then the rest; not simplified further."""
        if first in (self.all, self.nothing) or rest is self.empty:
            return first
        if first is self.empty:
            return rest
        return self.sequence([*(first.parts if first.operator == "cat" else (first,)), rest])

    def joined(self, operator: str, parts: Iterable[RmlTerm]) -> RmlTerm:
        """Return a shuffle or conjunction without its neutral elements."""
        neutral = self.empty if operator == "shuffle" else self.all
        left = [part for part in _flat(operator, parts) if part is not neutral]
        if len(left) > 1:
            return self.make(operator, left)
        return left[0] if left else neutral

    def block(self, variable: str, body: RmlTerm) -> RmlTerm:
        """Return `{let variable; body}`; the block is dropped if the body is complete."""
        return body if body in (self.empty, self.all) else self.make("block", (body,), variable)

    # Substitution.

    def substituted(self, term: RmlTerm, values: Values) -> RmlTerm:
        """Return the term with values for variables; a block hides its own variable."""
        start = term.free.intersection(values)
        if not start:
            return term
        done: dict[tuple[RmlTerm, frozenset[str]], RmlTerm] = {}
        todo = [(term, start, False)]
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
        return done[term, start]

    def opened(self, term: RmlTerm, bound: Mapping[str, Json]) -> RmlTerm:
        """Return the term with open variables replaced by their new values."""
        values = {name: value for name, value in bound.items() if is_open(name) and value is not UNBOUND}
        return self.substituted(term, values) if values else term

    def canonical(self, term: RmlTerm) -> RmlTerm:
        """Return the term with open variables numbered by occurrence, so that equal states are
        equal terms.
        """
        order: dict[str, None] = {}
        seen: set[RmlTerm] = set()
        todo = [term]
        while todo:
            at = todo.pop()
            if at not in seen and any(map(is_open, at.free)):
                seen.add(at)
                match at.operator, at.data:
                    case "event" | "filter", TypeUse(_, given):
                        order.update((one.name, None) for one in given if isinstance(one, Name) and is_open(one.name))
                    case "if" | "call", (*_, environment):
                        others = (value.name for _, value in environment if isinstance(value, Name))
                        order.update(dict.fromkeys(filter(is_open, others)))
                todo.extend(reversed(at.parts))
        return self.substituted(term, {name: Name(f"?{index}") for index, name in enumerate(order)})


def _flat(operator: str, parts: Iterable[RmlTerm]) -> list[RmlTerm]:
    return [inner for part in parts for inner in (part.parts if part.operator == operator else (part,))]


def _value(one: Any, values: Values) -> Any:
    value = values.get(one.name, one) if isinstance(one, Name) else one
    return value if value is one or isinstance(value, Name) else Constant(value)


def _environment(values: Values, wanted: frozenset[str]) -> Environment:
    return tuple(sorted(((n, v) for n, v in values.items() if n in wanted), key=lambda pair: pair[0]))
