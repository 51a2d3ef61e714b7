"""What each occurrence looks for in an event, and which variables have to be remembered from one event to another.

A variable is remembered where two occurrences share it or a guard compares it with one of another occurrence; any other belongs
to one event and is called after its place there, so that equal observations are equal values.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from rvaft.guards import Guard, Operation
from rvaft.guards import variables as guard_variables
from rvaft.model import Node, On
from rvaft.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.tree import RVAFT


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
