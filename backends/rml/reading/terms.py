"""The states of a running specification: terms, one object for all that are equal.

A term is kept once (hash-consing), so equality is identity and a state is hashed in no time. Equations are unfolded only when a
step needs them: a call holds the name of the equation and the values that variables had where it stood, no more than the
equation can use. Nothing here recurses over a term.
"""

from collections.abc import Hashable, Mapping
from typing import Any, Final, TypeAlias
from weakref import WeakValueDictionary

from backends.rml.reading import syntax as s
from backends.rml.reading.data import argument
from backends.rml.reading.free import free_variables
from backends.rml.reading.marks import mark, mark_use, marks
from rvaft.values import Json

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
