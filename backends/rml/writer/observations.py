"""What each occurrence looks for in an event, and which variables have to be remembered from one event to another.

A variable is remembered where two occurrences share it or a guard compares it with one of another occurrence: a *register* of the RML
text keeps its value. Any other variable belongs to one event and is called after its *place* there, `0#move` for the first parameter
of `move`, so that equal observations are equal values.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from itertools import count
from typing import TypeAlias

from backends.rml.writer.names import RmlNames, identifier
from rvaft.analysis.unification import compatible
from rvaft.model.guards import Guard, renamed
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Argument, Node, On
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable, substitute, variables
from rvaft.model.tree import RVAFT


def is_register(argument: Argument) -> bool:
    """Whether an argument of a call is a variable of the RML text, and not one of the event alone."""
    return isinstance(argument, Variable) and "#" not in argument.name


@dataclass(frozen=True, slots=True)
class Call:
    """An event type applied to arguments; `event` is None for the default event of the node called `default`."""

    event: str | None
    arguments: tuple[Argument, ...] = ()
    default: str = ""

    @property
    def registers(self) -> tuple[str, ...]:
        """The registers among the arguments, each once."""
        return tuple(dict.fromkeys(a.name for a in self.arguments if isinstance(a, Variable) and is_register(a)))

    def pattern(self, tree: RVAFT) -> Pattern:
        """The pattern of the events; registers and places stand as variables."""
        if self.event is None:
            return ObjectPattern((("event", Literal(self.default)),))
        return tree.instantiate(On(self.event, self.arguments))


def own_variables(on: On | None) -> tuple[str, ...]:
    """The variables among the arguments of an event."""
    return tuple(a.name for a in on.arguments if isinstance(a, Variable)) if on else ()


def _places(on: On | None) -> Mapping[str, str]:
    """The first place of each variable."""
    found: dict[str, str] = {}
    for position, argument in enumerate(on.arguments if on else ()):
        if isinstance(argument, Variable):
            found.setdefault(argument.name, f"{position}#{on.event}")  # type: ignore[union-attr]
    return found


def _template(on: On, used: Set[str], remembered: Set[str] = frozenset()) -> tuple[Argument, ...]:
    """The arguments with places for variables that are not remembered, where their values matter at all."""
    counts, places = Counter(on.arguments), _places(on)

    def argument(given: Argument) -> Argument:
        if not isinstance(given, Variable) or given.name in remembered:
            return given
        return Variable(places[given.name]) if counts[given] > 1 or given.name in used else Anything()

    return tuple(map(argument, on.arguments))


def closed_call(node: Node, tree: RVAFT) -> tuple[Call, Guard | None]:
    """The event of a node for any values of its variables, and its own guard where that speaks of no others."""
    if node.on is None:
        return Call(None, (), tree.origins.get(node.name, node.name)), node.when
    return closed(node.on, node.when)


def closed(on: On, when: Guard | None) -> tuple[Call, Guard | None]:
    """An event type applied to arguments, for any values of its variables, and a guard where it speaks of no others."""
    used = set(guard_variables(when)) if when is not None else set[str]()
    guard = when if used <= set(own_variables(on)) else None
    call = Call(on.event, _template(on, used if guard is not None else set()))
    return call, None if guard is None else renamed(guard, _places(on))


class Observations:
    """The occurrences of a tree, by position in `tree.occurrences`."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self._ons = [tree.nodes[name].on for name in tree.occurrences]
        self.variables = [frozenset(own_variables(on)) for on in self._ons]
        guards = [frozenset(guard_variables(node.when)) for node in tree.top_down() if node.when is not None]
        uses = Counter(name for names in self.variables for name in names)
        apart = [names for names in guards if names and not any(names <= own for own in self.variables)]
        self.remembered = frozenset(name for name, number in uses.items() if number > 1).union(*apart)
        used = [frozenset[str]().union(*(names for names in guards if names <= own)) for own in self.variables]
        self.templates = [
            () if on is None else _template(on, names, self.remembered)
            for on, names in zip(self._ons, used, strict=True)
        ]

    def call(self, index: int, registers: Mapping[str, str]) -> Call:
        """The call of an occurrence; `registers` names one for every remembered variable of it."""
        name, on = self.tree.occurrences[index], self._ons[index]
        if on is None:
            return Call(None, (), self.tree.origins.get(name, name))
        by = {name: Variable(registers[name]) for _, name in self.asked(index)}
        return Call(on.event, tuple(by.get(a.name, a) if isinstance(a, Variable) else a for a in self.templates[index]))

    def asked(self, index: int) -> list[tuple["Where", str]]:
        """The remembered variables of an occurrence, with where they stand."""
        on = self._ons[index]
        pairs = [] if on is None else [((on.event, i), a) for i, a in enumerate(self.templates[index])]
        return [(where, a.name) for where, a in pairs if isinstance(a, Variable) and is_register(a)]

    def loose(self, index: int) -> Pattern:
        """The pattern of an occurrence for any values."""
        pattern = self.tree.pattern(self.tree.occurrences[index])
        assert pattern is not None
        return substitute(pattern, {name: Anything() for name in variables(pattern)})

    def instance(self, guard: Guard, index: int, registers: Mapping[str, str]) -> Guard:
        """A guard with registers and places for the variables of an occurrence."""
        return renamed(guard, {**_places(self._ons[index]), **registers})


Where: TypeAlias = tuple[str, int]
"""An event type and the position of a parameter."""


class Registers:
    """Which register remembers a variable that the next event may bind; `used` lists all registers in order of need.

    In RML a variable is bound once. A register is called after the first variable it is for, with a number where that name is bound already on
    the way here, or where one event could have to bind it in two places at once.
    """

    def __init__(self, observations: Observations) -> None:
        self.observations = observations
        names = RmlNames()
        ordered = [name for name in observations.tree.variables if name in observations.remembered]
        self._wanted = {name: names.fresh(identifier(name, otherwise="v")) for name in ordered}
        self.used: dict[str, None] = {}

    def choose(self, waiting: Iterable[tuple[int, Set[str]]], bound: Set[str]) -> dict[Where, str]:
        """A register for each place where an occurrence (with the variables it already knows) would bind a variable."""
        here: dict[Where, list[tuple[str, int]]] = {}
        for index, known in waiting:
            for where, name in self.observations.asked(index):
                if name not in known:
                    here.setdefault(where, []).append((name, index))
        chosen: dict[Where, str] = {}
        takers: dict[str, list[int]] = {}
        for where, asking in here.items():
            names, occurrences = zip(*asking, strict=True)
            wanted = next(register for name, register in self._wanted.items() if name in names)
            chosen[where] = next(
                register
                for register in (wanted if number == 1 else f"{wanted}_{number}" for number in count(1))
                if register not in bound and not self._together(occurrences, takers.get(register, ()))
            )
            takers.setdefault(chosen[where], []).extend(occurrences)
            self.used.setdefault(chosen[where])
        return chosen

    def assign(self, index: int, known: Mapping[str, str], chosen: Mapping[Where, str]) -> dict[str, str]:
        """The registers of all remembered variables of an occurrence."""
        found = dict(known)
        for where, name in self.observations.asked(index):
            if name not in found:
                found[name] = chosen[where]
        return found

    def _together(self, some: Iterable[int], others: Iterable[int]) -> bool:
        loose = self.observations.loose
        return any(compatible(loose(one), loose(other)) for one in some for other in others)
