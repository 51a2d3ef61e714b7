"""What each occurrence looks for in an event, and which variables have to be remembered from one event to another.

A variable is remembered where two occurrences share it or a guard compares it with one of another occurrence; any other belongs
to one event and is called after its place there, so that equal observations are equal values.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import TypeAlias

from backends.rml.writer.names import Names, identifier
from rvaft.model.guards import Guard, Operation
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Node, On
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
from rvaft.model.tree import RVAFT

# What can be said of two patterns without seeing an event: whether none matches both, whether one implies the other.


def disjoint(left: Pattern, right: Pattern) -> bool:
    """Whether certainly no event matches both patterns: they differ in a literal or in shape at a common place."""
    todo = [(left, right)]
    while todo:
        match todo.pop():
            case (Variable() | Anything(), _) | (_, Variable() | Anything()):
                continue
            case (Literal(), Literal()) as pair:
                if pair[0] != pair[1]:
                    return True
            case (ObjectPattern(fields), ObjectPattern(others)):
                there = dict(others)
                todo.extend((inner, there[name]) for name, inner in fields if name in there)
            case (ListPattern(items), ListPattern(others)):
                if len(items) != len(others):
                    return True
                todo.extend(zip(items, others, strict=True))
            case _:
                return True
    return False


def implies(special: Pattern, general: Pattern, bound: Set[str]) -> bool:
    """Whether certainly every event that matches the special pattern matches the general one.

    `bound` names the variables that have a value already; any other one that stands once in the general pattern takes what is there.
    """
    parts = [part for part in walk(general) if isinstance(part, Variable)]
    free = {part.name for part in parts if part.name not in bound and parts.count(part) == 1}
    todo = [(special, general)]
    while todo:
        match todo.pop():
            case (_, Anything()):
                continue
            case (_, Variable(name)) if name in free:
                continue
            case (ObjectPattern(fields), ObjectPattern(others)):
                there = dict(fields)
                if any(name not in there for name, _ in others):
                    return False
                todo.extend((there[name], inner) for name, inner in others)
            case (ListPattern(items), ListPattern(others)):
                if len(items) != len(others):
                    return False
                todo.extend(zip(items, others, strict=True))
            case (one, other):
                if one != other or isinstance(one, Anything):
                    return False
    return True


def overlaps(patterns: Sequence[Pattern]) -> list[int]:
    """For each pattern the set of those that one event might match as well, itself among them.

    Patterns that have a literal in a common field are compared only where it is the same.
    """
    field = _telling(patterns)
    groups: dict[object, list[int]] = {}
    for i, one in enumerate(patterns):
        groups.setdefault(_literals(one).get(field), []).append(i)
    found = [1 << i for i in range(len(patterns))]
    others = groups.pop(None, [])
    for group in (*([*group, *others] for group in groups.values()), others):
        for position, i in enumerate(group):
            for j in group[position + 1 :]:
                if not found[i] >> j & 1 and not disjoint(patterns[i], patterns[j]):
                    found[i] |= 1 << j
                    found[j] |= 1 << i
    return found


def _telling(patterns: Sequence[Pattern]) -> str:
    """The field that has the most different literals."""
    values: dict[str, set[Literal]] = {}
    for one in patterns:
        for name, literal in _literals(one).items():
            values.setdefault(name, set()).add(literal)
    return max(values, key=lambda name: (len(values[name]), name), default="")


def _literals(one: Pattern) -> Mapping[str, Literal]:
    fields = one.fields if isinstance(one, ObjectPattern) else ()
    return {name: inner for name, inner in fields if isinstance(inner, Literal)}


@dataclass(frozen=True, slots=True)
class Register:
    """A variable of the RML text: it keeps a value from the event that binds it on."""

    name: str


@dataclass(frozen=True, slots=True)
class Place:
    """The value at the place of an event type's parameter, within one event."""

    event: str
    parameter: int


Argument: TypeAlias = Literal | Register | Place | Anything
Template: TypeAlias = Literal | Variable | Place | Anything
"""An argument of an occurrence before its remembered variables are given registers."""


@dataclass(frozen=True, slots=True)
class Call:
    """An event type applied to arguments; `event` is None for the default event of the node called `default`."""

    event: str | None
    arguments: tuple[Argument, ...] = ()
    default: str = ""

    @property
    def registers(self) -> tuple[str, ...]:
        """The registers among the arguments, each once."""
        return tuple(dict.fromkeys(a.name for a in self.arguments if isinstance(a, Register)))


class Observations:
    """The occurrences of a tree, by position in `tree.occurrences`."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        ons = [tree.nodes[name].on for name in tree.occurrences]
        self.variables = [frozenset(_variables(on)) for on in ons]
        self.remembered = self._remembered()
        self.templates = [self._template(i, on) for i, on in enumerate(ons)]

    def _remembered(self) -> frozenset[str]:
        uses = Counter(name for names in self.variables for name in names)
        shared = {name for name, count in uses.items() if count > 1}
        for node in self.tree.top_down():
            names = set(guard_variables(node.when)) if node.when is not None else set()
            if names and not any(names <= own for own in self.variables):
                shared |= names
        return frozenset(shared)

    def _template(self, index: int, on: On | None) -> tuple[Template, ...]:
        if on is None:
            return ()
        counts = Counter(argument for argument in on.arguments if isinstance(argument, Variable))
        guarded = {
            name
            for node in self.tree.top_down()
            if node.when is not None and set(guard_variables(node.when)) <= self.variables[index]
            for name in guard_variables(node.when)
        }
        first: dict[str, Place] = {}
        made: list[Template] = []
        for position, argument in enumerate(on.arguments):
            if isinstance(argument, Variable) and argument.name not in self.remembered:
                place = first.setdefault(argument.name, Place(on.event, position))
                made.append(place if counts[argument] > 1 or argument.name in guarded else Anything())
            else:
                made.append(argument)
        return tuple(made)

    def call(self, index: int, registers: Mapping[str, str]) -> Call:
        """The call of an occurrence; `registers` names one for every remembered variable of it."""
        name = self.tree.occurrences[index]
        on = self.tree.nodes[name].on
        if on is None:
            return Call(None, (), self.tree.origins.get(name, name))
        arguments = (Register(registers[a.name]) if isinstance(a, Variable) else a for a in self.templates[index])
        return Call(on.event, tuple(arguments))

    def instance(self, guard: Guard, index: int, registers: Mapping[str, str]) -> Guard:
        """A guard with registers and places (written as variables, `place_name`) for the variables of an occurrence."""
        on = self.tree.nodes[self.tree.occurrences[index]].on
        names = dict(registers)
        for position, argument in enumerate(on.arguments if on else ()):
            if isinstance(argument, Variable) and argument.name not in self.remembered:
                assert on is not None
                names.setdefault(argument.name, place_name(Place(on.event, position)))
        return renamed(guard, names)


def closed_call(node: Node, tree: RVAFT) -> tuple[Call, Guard | None]:
    """The event of a node for any values of its variables, and its own guard where that speaks of no others."""
    if node.on is None:
        return Call(None, (), tree.origins.get(node.name, node.name)), node.when
    return closed(node.on, node.when)


def closed(on: On, when: Guard | None) -> tuple[Call, Guard | None]:
    """An event type applied to arguments, for any values of its variables, and a guard where it speaks of no others."""
    own = set(_variables(on))
    guard = when if when is not None and set(guard_variables(when)) <= own else None
    counts = Counter(argument for argument in on.arguments if isinstance(argument, Variable))
    used = set(guard_variables(guard)) if guard is not None else set()
    first: dict[str, Place] = {}
    made: list[Argument] = []
    for position, argument in enumerate(on.arguments):
        if isinstance(argument, Variable):
            place = first.setdefault(argument.name, Place(on.event, position))
            made.append(place if counts[argument] > 1 or argument.name in used else Anything())
        else:
            made.append(argument)
    names = {name: place_name(place) for name, place in first.items()}
    return Call(on.event, tuple(made)), None if guard is None else renamed(guard, names)


def place_name(place: Place) -> str:
    """The name that stands for a place in a guard; no variable is called so."""
    return f"{place.parameter}#{place.event}"


def renamed(guard: Guard, names: Mapping[str, str]) -> Guard:
    """The guard with other names for its variables."""
    match guard:
        case Variable(name):
            return Variable(names[name])
        case Operation(operator, operands):
            return Operation(operator, tuple(renamed(operand, names) for operand in operands))
        case Literal():
            return guard


def pattern(tree: RVAFT, call: Call) -> Pattern:
    """The pattern of a call; registers and places stand as variables."""
    if call.event is None:
        return ObjectPattern((("event", Literal(call.default)),))
    return tree.instantiate(On(call.event, tuple(_argument(argument) for argument in call.arguments)))


def _argument(argument: Argument) -> Literal | Variable | Anything:
    match argument:
        case Register(name):
            return Variable(name)
        case Place():
            return Variable(place_name(argument))
        case _:
            return argument


def _variables(on: On | None) -> tuple[str, ...]:
    return tuple(a.name for a in on.arguments if isinstance(a, Variable)) if on else ()


# Which register remembers a variable that the next event may bind.
#
# In RML a variable is bound once. A register is called after the first variable it is for, with a number where that name is bound already on
# the way here, or where one event could have to bind it in two places at once.

Where = tuple[str, int]
"""An event type and the position of a parameter."""


class Registers:
    """Gives registers to variables; `used` lists all of them in order of need."""

    def __init__(self, observations: Observations) -> None:
        self.observations = observations
        tree = observations.tree
        names = Names()
        ordered = [name for name in tree.variables if name in observations.remembered]
        self._wanted = {name: names.fresh(identifier(name, otherwise="v")) for name in ordered}
        self._rank = {name: position for position, name in enumerate(ordered)}
        self.used: dict[str, None] = {}

    def choose(self, waiting: Iterable[tuple[int, Set[str]]], bound: Set[str]) -> dict[Where, str]:
        """A register for each place where an occurrence (with the variables it already knows) would bind a variable."""
        here: dict[Where, tuple[list[str], list[int]]] = {}
        for index, known in waiting:
            for position, argument in enumerate(self.observations.templates[index]):
                if isinstance(argument, Variable) and argument.name not in known:
                    names, occurrences = here.setdefault((self._event(index), position), ([], []))
                    names.append(argument.name)
                    occurrences.append(index)
        chosen: dict[Where, str] = {}
        takers: dict[str, list[int]] = {}
        for where, (names, occurrences) in here.items():
            wanted = self._wanted[min(names, key=self._rank.__getitem__)]
            chosen[where] = next(
                name
                for name in _numbered(wanted)
                if name not in bound and not self._together(occurrences, takers.get(name, []))
            )
            takers.setdefault(chosen[where], []).extend(occurrences)
            self.used.setdefault(chosen[where])
        return chosen

    def assign(self, index: int, known: dict[str, str], chosen: dict[Where, str]) -> dict[str, str]:
        """The registers of all remembered variables of an occurrence."""
        found = dict(known)
        for position, argument in enumerate(self.observations.templates[index]):
            if isinstance(argument, Variable) and argument.name not in found:
                found[argument.name] = chosen[self._event(index), position]
        return found

    def _event(self, index: int) -> str:
        on = self.observations.tree.nodes[self.observations.tree.occurrences[index]].on
        assert on is not None
        return on.event

    def _together(self, some: list[int], others: list[int]) -> bool:
        return any(not disjoint(self._loose(one), self._loose(other)) for one in some for other in others)

    def _loose(self, index: int) -> Pattern:
        tree = self.observations.tree
        pattern = tree.pattern(tree.occurrences[index])
        assert pattern is not None
        return substitute(pattern, {name: Anything() for name in variables(pattern)})


def _numbered(name: str) -> Iterable[str]:
    yield name
    number = 2
    while True:
        yield f"{name}_{number}"
        number += 1
