"""Letters: the event conditions of occurrences, and the variables remembered between events.

A variable is remembered if two occurrences share it, or if a guard compares it with a variable of
another occurrence. A *register* of the RML text holds its value. Other variables are local to an
event and named after their *place*, such as `0#move` for the first parameter of `move`, so that
equal conditions are equal values.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Set
from typing import NamedTuple, TypeAlias

from backends.rml.writer.event_types import NEVER, Call, Inexpressible, RmlTypes, is_register, when_true
from backends.rml.writer.terms import Written, named
from rvaft.core.property import Condition, Property, WithoutEvent
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.guards import Guard, conjuncts, renamed
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Argument, On
from rvaft.model.patterns import Anything, Pattern, Variable, substitute, variables

Where: TypeAlias = tuple[str, int]


def closed(on: On, when: Guard | None) -> tuple[Call, Guard | None]:
    """Return a call for any values of its variables, with a guard that uses only these."""
    used = set(guard_variables(when))
    if when is None or not used <= set(on.variables):
        return Call(on.event, _template(on, set())), None
    return Call(on.event, _template(on, used)), renamed(when, _places(on))


def _places(on: On | None) -> Mapping[str, str]:
    found: dict[str, str] = {}
    for position, argument in enumerate(on.arguments if on else ()):
        if isinstance(argument, Variable):
            found.setdefault(argument.name, f"{position}#{on.event}")  # type: ignore[union-attr]
    return found


def _template(on: On | None, used: Set[str], remembered: Set[str] = frozenset()) -> tuple[Argument, ...]:
    arguments = on.arguments if on else ()
    counts, places = Counter(arguments), _places(on)

    def argument(given: Argument) -> Argument:
        if not isinstance(given, Variable) or given.name in remembered:
            return given
        return Variable(places[given.name]) if counts[given] > 1 or given.name in used else Anything()

    return tuple(map(argument, arguments))


class RmlLetter(NamedTuple):
    """The condition of an occurrence on one event."""

    call: Call
    guards: frozenset[Guard] = frozenset()


class RmlLetters:
    """The letters of a property's events, by position in `prop.events`."""

    def __init__(self, prop: Property, types: RmlTypes) -> None:
        self.prop, self.tree = prop, prop.tree
        self.types = types
        self.nodes = tuple(event.source.node for event in prop.events)
        self._ons = [prop.tree.nodes[name].on for name in self.nodes]
        self.variables = [frozenset(on.variables if on else ()) for on in self._ons]
        having: dict[str, set[int]] = {}
        for index, names in enumerate(self.variables):
            for name in names:
                having.setdefault(name, set()).add(index)
        remembered = {name for name, places in having.items() if len(places) > 1}
        used = [set[str]() for _ in self._ons]
        guards = (part.guard for part in prop.parts if isinstance(part, Condition))
        for names in dict.fromkeys(frozenset(guard_variables(guard)) for guard in guards):
            knowing = set.intersection(*(having.get(name, set()) for name in names))
            remembered.update(() if knowing else names)
            for index in knowing:
                used[index].update(names)
        self.remembered = frozenset(remembered)
        self._templates = [_template(on, names, remembered) for on, names in zip(self._ons, used, strict=True)]
        self._rank = {name: position for position, name in enumerate(prop.tree.order)}
        self._nodes: dict[Call, str] = {}
        self._absent: dict[Call, str] = {}
        self._guards: dict[Guard, tuple[str, tuple[Guard, ...]]] = {}
        self._texts: dict[RmlLetter, tuple[str, ...]] = {}

    def remembered_parameters(self, index: int) -> list[tuple[Where, str]]:
        """Return the remembered variables of an occurrence with their parameter positions."""
        on = self._ons[index]
        return [((on.event, i), a.name) for i, a in enumerate(self._templates[index]) if on and is_register(a)]

    def loose(self, index: int) -> Pattern:
        """Return the pattern of an occurrence with variables replaced by `_`."""
        pattern = self.prop.events[index].pattern
        return substitute(pattern, {name: Anything() for name in variables(pattern)})

    def condition(self, guard: Guard, node: str) -> Guard:
        """Return the condition that a node's guard is true; raises `NotExpressible`."""
        try:
            return when_true(guard)
        except Inexpressible as error:
            raise NotExpressible(unwritten(str(error)), nodes=[node]) from None

    def letter(self, index: int, registers: Mapping[str, str], conditions: Iterable[Condition]) -> RmlLetter | None:
        """Return the letter of an occurrence under conditions, or None if no event can satisfy it.

        `registers` maps every remembered variable to its register.
        """
        name, on, template = self.nodes[index], self._ons[index], self._templates[index]
        call = Call(None, (), name)
        if on is not None:
            call = Call(on.event, tuple(Variable(registers[a.name]) if is_register(a) else a for a in template))
        self._nodes.setdefault(call, name)
        instances: set[Guard] = set()
        for condition in conditions:
            node = condition.source.node
            guard = renamed(condition.guard, {**_places(on), **registers})
            if guard not in self._guards:
                self._guards[guard] = (node, conjuncts(self.condition(guard, node)))
            required = self._guards[guard][1]
            if NEVER in required:
                return None
            instances.update((guard,) if required else ())
        return RmlLetter(call, frozenset(instances))

    def absent(self, clause: WithoutEvent) -> RmlLetter | None:
        """Return the letter of the events that break a clause, or None if there are none.

        Raises `NotExpressible` for one that shares variables with the tree.
        """
        node = clause.source.node
        stated = self.tree.nodes[node].without[clause.number - 1]
        if clause.shared:
            why = "an absent event that shares variables with the tree, of which RML tracks one value"
            raise NotExpressible(unwritten(why), nodes=[node])
        call, guard = closed(stated.on, stated.when)
        self._absent.setdefault(call, f"{node}_absent")
        if guard is None:
            return RmlLetter(call)
        required = conjuncts(self.condition(guard, node))
        self._guards.setdefault(guard, (node, required))
        return None if NEVER in required else RmlLetter(call, frozenset({guard} if required else ()))

    def texts(self, letter: RmlLetter) -> tuple[str, ...]:
        """Return the applied event types that an event must all match; the first one binds."""
        if letter not in self._texts:
            guards = sorted((self._guards[g] for g in letter.guards), key=lambda g: (self._rank[g[0]], repr(g[1])))
            conditions = [(condition, name) for name, found in guards for condition in found]
            name = self._nodes.get(letter.call) or self._absent[letter.call]
            self._texts[letter] = tuple(self.types.observed(letter.call, conditions, name))
        return self._texts[letter]

    def all_texts(self, letters: Iterable[RmlLetter]) -> list[Written]:
        """Return the distinct applied event types of several letters."""
        return [named(text) for text in dict.fromkeys(text for letter in letters for text in self.texts(letter))]
