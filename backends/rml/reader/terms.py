"""The states of a running specification: terms, one object for all that are equal.

A term is kept once (hash-consing), so equality is identity and a state is hashed in no time. Equations are unfolded only when a
step needs them: a call holds the name of the equation and the values that variables had where it stood, no more than the
equation can use. Nothing here recurses over a term.
"""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias
from weakref import WeakValueDictionary

from backends.rml.reader import syntax as s
from backends.rml.reader.event_types import UNBOUND, argument
from backends.rml.reader.syntax import Name
from rvaft.model.values import Json

# Hashable stand-ins for data in terms: two have the same mark only where nothing can ever tell them apart.
#
# Finer than `rvaft.values.key`: 1 and 1.0 are equal, but calculate differently once they are large.


def mark(value: Json | s.Name) -> Hashable:
    """A stand-in for a value or a variable."""
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


def marks(environment: tuple[tuple[str, Json], ...]) -> Hashable:
    """A stand-in for what variables stand for."""
    return tuple((name, mark(value)) for name, value in environment)


def mark_use(use: s.TypeUse) -> Hashable:
    """A stand-in for an event type with arguments."""
    return use.name, tuple(mark(p.value) if isinstance(p, s.Constant) else p for p in use.parameters)


# Which variables an equation can use: those that occur in it, or in equations it refers to, outside a block of their own.
#
# Equations see the variables of the place they are unfolded at (scope is dynamic), so this is what has to travel with them.
# Each body is walked once; what it finds is handed on along the references until nothing is new.


@dataclass(slots=True)
class _Uses:
    """What a body uses itself, and the equations it refers to, each with the variables of blocks around the reference."""

    variables: set[str] = field(default_factory=set)
    references: dict[tuple[str, frozenset[str]], None] = field(default_factory=dict)


def free_variables(program: s.Program) -> Mapping[str, frozenset[str]]:
    """For each equation the variables it can use, its parameters left out."""
    found: dict[str, set[str]] = {}
    users: dict[str, list[tuple[str, frozenset[str]]]] = {name: [] for name in program.equations}
    for name, equation in program.equations.items():
        uses = _uses(equation)
        found[name] = uses.variables
        for used, hidden in uses.references:
            if used in users:
                users[used].append((name, hidden))
    waiting = list(program.equations)
    while waiting:
        name = waiting.pop()
        for user, hidden in users[name]:
            more = found[name] - hidden - found[user]
            if more:
                found[user] |= more
                waiting.append(user)
    return {name: frozenset(names) for name, names in found.items()}


def _uses(equation: s.Equation) -> _Uses:
    uses = _Uses()
    todo: list[tuple[s.Expression, frozenset[str]]] = [(equation.body, frozenset(equation.parameters))]
    while todo:
        part, hidden = todo.pop()
        match part:
            case s.Occurs(use) | s.Filtered(use):
                uses.variables |= s.used_names(use) - hidden
            case s.Block(variable):
                hidden |= {variable}
            case s.Conditional(condition):
                uses.variables |= s.names(condition) - hidden
            case s.Reference(name, arguments):
                uses.variables |= frozenset[str]().union(*map(s.names, arguments)) - hidden
                uses.references[name, hidden] = None
            case _:
                pass
        todo.extend((child, hidden) for child in s.children(part))
    return uses


Values: TypeAlias = Mapping[str, Json | s.Name]
"""What variables stand for: a value, or (for one that an event passed without binding) another variable."""
Environment: TypeAlias = tuple[tuple[str, Json], ...]


class Term:
    """One term: an operator, its parts, and data that depends on the operator. `free` are the variables it can still use."""

    __slots__ = ("__weakref__", "data", "free", "halts", "operator", "parts")

    def __init__(self, operator: str, parts: tuple["Term", ...], data: Any, free: frozenset[str]) -> None:
        self.operator = operator
        self.parts = parts
        self.data = data
        self.free = free
        self.halts: bool | None = None

    def __repr__(self) -> str:
        return f"<{self.operator} of {len(self.parts)}>"


class Terms:
    """The terms of one program."""

    def __init__(self, program: s.Program) -> None:
        self.program = program
        self._free = free_variables(program)
        self._known: WeakValueDictionary[Hashable, Term] = WeakValueDictionary()
        self._bodies: dict[str, Term] = {}
        self.empty: Final = self.make("empty")
        self.all: Final = self.make("all")
        self.nothing: Final = self.make("nothing")

    def make(
        self,
        operator: str,
        parts: tuple[Term, ...] = (),
        data: Any = None,
        distinct: Hashable = None,
        own: frozenset[str] = frozenset(),
    ) -> Term:
        """The one term of that form; `distinct` stands for the data, `own` are the variables that the data uses."""
        identity = (operator, tuple(map(id, parts)), distinct)
        known = self._known.get(identity)
        if known is None:
            free = own.union(*(part.free for part in parts if part.free))
            if operator == "block":
                free -= {data}
            known = Term(operator, parts, data, free)
            self._known[identity] = known
        return known

    # -- from the text -------------------------------------------------------------------------------------------------

    def body(self, name: str) -> Term:
        """The right-hand side of an equation."""
        if name not in self._bodies:
            self._bodies[name] = self._built(self.program.equations[name].body)
        return self._bodies[name]

    def unfolded(self, term: Term) -> Term:
        """The body of the equation that a call names, with its arguments and values; nothing where the arguments do not fit."""
        name, arguments, environment = term.data
        parameters = self.program.equations[name].parameters
        if len(parameters) != len(arguments):
            return self.nothing
        values = dict(environment)
        given = {p: argument(a, values) for p, a in zip(parameters, arguments, strict=True)}
        return self.substituted(self.body(name), {**values, **given})

    def _built(self, expression: s.Expression) -> Term:
        done: dict[int, Term] = {}
        todo = [(expression, False)]
        while todo:
            part, ready = todo.pop()
            below = s.operands(part) if isinstance(part, s.Joined) else s.children(part)
            if ready:
                done[id(part)] = self._term(part, [done[id(child)] for child in below])
            else:
                todo.append((part, True))
                todo.extend((child, False) for child in below)
        return done[id(expression)]

    def _term(self, part: s.Expression, parts: list[Term]) -> Term:
        match part:
            case s.Leaf(word):
                return self.empty if word == "empty" else self.all
            case s.Occurs(use):
                return self.occurs(use)
            case s.Joined("cat"):
                return self.sequence(parts)
            case s.Joined(operator):
                return self.make(operator, tuple(parts))
            case s.Repeated(operator, _, number):
                return self.repeated(operator, parts[0], number)
            case s.Filtered(use):
                return self.filtered(use, *parts)
            case s.Block(variable):
                return self.block(variable, parts[0])
            case s.Conditional(condition):
                return self.conditional(condition, (), *parts)
            case s.Reference(name, arguments):
                return self.call(name, arguments, {})

    # -- one form each -------------------------------------------------------------------------------------------------

    def sequence(self, parts: list[Term]) -> Term:
        """One after the other, nested to the right."""
        term = parts[-1]
        for before in reversed(parts[:-1]):
            term = self.make("cat", (before, term))
        return term

    def repeated(self, operator: str, body: Term, number: int = 0) -> Term:
        """`*`, `+`, `?`, `!`, or a number of times."""
        return self.make(operator, (body,), number, number)

    def occurs(self, use: s.TypeUse) -> Term:
        """One event."""
        return self.make("occurs", (), use, mark_use(use), s.used_names(use))

    def filtered(self, use: s.TypeUse, inside: Term, outside: Term) -> Term:
        """A filter."""
        return self.make("filter", (inside, outside), use, mark_use(use), s.used_names(use))

    def block(self, variable: str, body: Term) -> Term:
        """`{let variable; body}`; nothing can be bound where nothing is left to do."""
        return body if body in (self.empty, self.all) else self.make("block", (body,), variable, variable)

    def conditional(self, condition: s.Data, environment: Environment, yes: Term, no: Term) -> Term:
        """`if (condition) yes else no`, with what is known of the variables in the condition."""
        open_ = s.names(condition) - {name for name, _ in environment}
        own = open_ | _variables(environment)
        return self.make("if", (yes, no), (condition, environment), (id(condition), marks(environment)), own)

    def call(self, name: str, arguments: tuple[s.Data, ...], values: Values) -> Term:
        """An equation with arguments and the values that its variables had where it stands."""
        usable = self._free.get(name, frozenset()).union(*map(s.names, arguments))
        environment = _environment(values, usable)
        known = {n: v for n, v in environment if not isinstance(v, s.Name)}
        given = tuple(s.Constant(argument(a, known)) if s.names(a) <= known.keys() else a for a in arguments)
        if all(isinstance(a, s.Constant) for a in given):
            usable = self._free.get(name, frozenset())
            environment = _environment(values, usable)
        distinct = (
            name,
            tuple(mark(a.value) if isinstance(a, s.Constant) else id(a) for a in given),
            marks(environment),
        )
        own = (usable - {n for n, _ in environment}) | _variables(environment)
        return self.make("call", (), (name, given, environment), distinct, own)

    # -- substitution --------------------------------------------------------------------------------------------------

    def substituted(self, term: Term, values: Values) -> Term:
        """The term with values for variables; a block hides its own variable."""
        start = term.free.intersection(values)
        if not start:
            return term
        done: dict[tuple[Term, frozenset[str]], Term] = {}
        todo = [(term, start, False)]
        while todo:
            at, names, ready = todo.pop()
            if (at, names) in done:
                continue
            if not names:
                done[at, names] = at
                continue
            hidden = frozenset([at.data]) if at.operator == "block" else frozenset[str]()
            below = [(part, (names & part.free) - hidden) for part in at.parts]
            if ready:
                done[at, names] = self._replaced(at, tuple(done[b] for b in below), {n: values[n] for n in names})
            else:
                todo.append((at, names, True))
                todo.extend((part, inner, False) for part, inner in below)
        return done[term, start]

    def _replaced(self, term: Term, parts: tuple[Term, ...], values: Values) -> Term:
        match term.operator:
            case "occurs":
                return self.occurs(_filled(term.data, values))
            case "filter":
                return self.filtered(_filled(term.data, values), *parts)
            case "block":
                return self.block(term.data, parts[0])
            case "if":
                condition, environment = term.data
                known = {**values, **_renamed(environment, values)}
                return self.conditional(condition, _environment(known, s.names(condition)), *parts)
            case "call":
                name, arguments, environment = term.data
                return self.call(name, arguments, {**values, **_renamed(environment, values)})
            case operator:
                return self.make(operator, parts, term.data, term.data)


def _filled(use: s.TypeUse, values: Values) -> s.TypeUse:
    return s.TypeUse(use.name, tuple(_value(p, values) if isinstance(p, s.Name) else p for p in use.parameters))


def _value(name: s.Name, values: Values) -> s.Parameter:
    value = values.get(name.name, name)
    return value if isinstance(value, s.Name) else s.Constant(value)


def _environment(values: Values, wanted: frozenset[str]) -> Environment:
    return tuple(sorted(((n, v) for n, v in values.items() if n in wanted), key=lambda pair: pair[0]))


def _renamed(environment: Environment, values: Values) -> Values:
    return {n: values.get(v.name, v) if isinstance(v, s.Name) else v for n, v in environment}


def _variables(environment: Environment) -> frozenset[str]:
    return frozenset(value.name for _, value in environment if isinstance(value, s.Name))


# Variables that an event passed without binding them; their names begin with "?".


def is_open(name: str) -> bool:
    """Whether a variable is one of these."""
    return name.startswith("?")


def opened(bound: Mapping[str, Json]) -> Mapping[str, Json]:
    """Those of some bindings that give an open variable its value."""
    return {name: value for name, value in bound.items() if is_open(name) and value is not UNBOUND} if bound else bound


def canonical(terms: Terms, term: Term) -> Term:
    """The term with its open variables numbered by where they first occur, so that equal states are equal terms."""
    if not any(map(is_open, term.free)):
        return term
    order = list(dict.fromkeys(_open_names(term)))
    return terms.substituted(term, {name: Name(f"?{index}") for index, name in enumerate(order)})


def _open_names(term: Term) -> Iterator[str]:
    seen: set[Term] = set()
    todo = [term]
    while todo:
        at = todo.pop()
        if at not in seen and any(map(is_open, at.free)):
            seen.add(at)
            yield from _own_names(at)
            todo.extend(reversed(at.parts))


def _own_names(term: Term) -> list[str]:
    match term.operator:
        case "occurs" | "filter":
            names = [p.name for p in term.data.parameters if isinstance(p, Name)]
        case "if" | "call":
            names = [value.name for _, value in term.data[-1] if isinstance(value, Name)]
        case _:
            names = []
    return [name for name in names if is_open(name)]


# The forms that terms are brought to after a step, as in the published monitor but for `t | all` (see `deviations`).


class Forms:
    """The forms over the terms of one program."""

    def __init__(self, terms: Terms) -> None:
        self._terms = terms

    def then(self, first: Term, rest: Term) -> Term:
        """One after the other, nested to the right by one step; what that puts together is not simplified."""
        terms = self._terms
        if first in (terms.all, terms.nothing):
            return first
        if first is terms.empty:
            return rest
        if rest is terms.empty:
            return first
        if first.operator != "cat":
            return terms.sequence([first, rest])
        head, tail = first.parts
        return terms.sequence([head, terms.make("cat", (tail, rest))])

    def shuffle(self, parts: tuple[Term, ...]) -> Term:
        """Side by side, flat."""
        left = tuple(part for part in _flat("shuffle", parts) if part is not self._terms.empty)
        if not left:
            return self._terms.empty
        return left[0] if len(left) == 1 else self._terms.make("shuffle", left)

    def both(self, parts: tuple[Term, ...]) -> Term:
        """All at once, flat."""
        left = tuple(part for part in _flat("and", parts) if part is not self._terms.all)
        if not left:
            return self._terms.all
        return left[0] if len(left) == 1 else self._terms.make("and", left)

    def closure(self, body: Term) -> Term:
        """Every prefix."""
        return body if body is self._terms.all else self._terms.repeated("closure", body)

    def filtered(self, term: Term, inside: Term, outside: Term) -> Term:
        """A filter with new parts."""
        if inside is self._terms.all and outside is self._terms.all:
            return self._terms.all
        return self._terms.filtered(term.data, inside, outside)


def _flat(operator: str, parts: tuple[Term, ...]) -> list[Term]:
    found: list[Term] = []
    for part in parts:
        found.extend(part.parts if part.operator == operator else (part,))
    return found
