"""The event orders of a property as distinct words of letters, for languages that list orders.

Choices between independent leaves are made within a letter. All steps count against a budget.
"""

from collections import Counter
from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeVar

from rvaft.core import scenarios as core
from rvaft.core.precedence import Ready
from rvaft.core.property import All, Condition, Event, One, Part, Property, Source, with_parts
from rvaft.core.scenarios import Scenario
from rvaft.errors import TooLarge, TreeError
from rvaft.model import guards
from rvaft.model.guards import Guard
from rvaft.model.patterns import Anything, rigid_variables
from rvaft.support.bits import bits

Letter = TypeVar("Letter", bound=Hashable)

_STEPS: Final = 200
"""Steps of search for each event that the limit allows."""


class GuardedEvent(NamedTuple):
    """An event with guards over its own variables."""

    event: Event
    guards: tuple[Guard, ...] = ()


class Orders:
    """The feasible scenarios of a property, and their event orders.

    Raises `TooLarge` beyond `limit` events of all orders, or 200 steps per event. `grouped`: a choice
    between leaves is one event of the scenarios; `groups` maps it to its leaves. `minimal`: votes
    keep no child beyond their minimum.

    >>> from rvaft import loads
    >>> from rvaft.core.restriction import property_of
    >>> orders = Orders(property_of(loads("top and a o; o or b c;")), limit=100)
    >>> scenario, = orders.scenarios()
    >>> def letter(event):
    ...     return "|".join(leaf.event.source.node for leaf in orders.groups.get(event, ())) or event.source.node
    >>> letters = {event: letter(event) for event in scenario.events}
    >>> sorted(orders.words(scenario, letters))
    [('a', 'b|c'), ('b|c', 'a')]
    """

    def __init__(self, prop: Property, *, limit: int, grouped: bool = True, minimal: bool = True) -> None:
        self._limit, self._left, self._minimal = limit, limit * _STEPS, minimal
        self._said: set[tuple[Hashable, ...]] = set()
        self._events = 0
        self.groups: dict[Event, tuple[GuardedEvent, ...]] = {}
        self.prop = self._grouped(prop) if grouped else prop

    def _grouped(self, prop: Property) -> Property:
        uses = Counter(name for part in prop.parts for name in _names(part))

        def leaves(part: Part) -> tuple[GuardedEvent, ...]:
            match part:
                case _ if part in prop.shared:
                    return ()
                case Event():
                    conditions: list[Part] = []
                    found = GuardedEvent(part)
                case All(parts=(Event() as event, *conditions)):
                    own_conditions = [
                        one for one in conditions if isinstance(one, Condition) and one not in prop.shared
                    ]
                    if len(own_conditions) < len(conditions):
                        return ()
                    found = GuardedEvent(
                        event, tuple(guard for one in own_conditions for guard in guards.conjuncts(one.guard))
                    )
                case One(parts=parts):
                    each = [leaves(inner) for inner in parts]
                    return tuple(leaf for some in each for leaf in some) if all(each) else ()
                case _:
                    return ()
            # the variables of the event and its guards occur nowhere else
            own = set(rigid_variables(found.event.pattern))
            alone = all(uses[name] == sum(name in _names(one) for one in (found.event, *conditions)) for name in own)
            return (found,) if alone and all(own.issuperset(_names(one)) for one in conditions) else ()

        def change(part: Part, parts: tuple[Part, ...]) -> Part:
            if isinstance(part, One) and part.source is not None and len(part.parts) > 1 and (found := leaves(part)):
                letter = Event(Source(part.source.node), Anything())
                self.groups[letter] = found
                return letter
            return with_parts(part, parts)

        return replace(prop, root=prop.with_root(prop.root).rewritten(change).root)

    def spend(self, steps: int) -> None:
        """Spend steps of the budget."""
        self._left -= steps
        if self._left < 0:
            raise TooLarge("events in all possible orders", limit=self._limit)

    def scenarios(self) -> Iterator[Scenario]:
        """Yield the feasible scenarios; raises `TreeError` if there are none."""
        found = False
        for scenario in core.scenarios(self.prop, minimal=self._minimal, limit=self._limit):
            self.spend(len(scenario.kept))
            found = True
            yield scenario
        if not found:
            root = self.prop.tree.root
            raise TreeError(f"no scenario of {root} is feasible", rule="no-scenario", nodes=[root])

    def assigned_guards(
        self,
        scenario: Scenario,
        bound: Mapping[Event, Container[str]],
        several: Callable[[str, Guard], Exception | None],
    ) -> dict[Event, list[Guard]] | None:
        """Return the guards of a scenario per event, or None if one never holds.

        A guard is assigned to one event that binds all its variables (`bound`), preferably that of
        its node. `several` receives guards over several events with their node, and may return an
        error to raise.
        """
        found: dict[Event, list[Guard]] = {event: [] for event in bound}
        for condition in scenario.conditions:
            node = condition.source.node
            for guard in guards.conjuncts(condition.guard):
                mentioned = {*guards.variables(guard)}
                if not mentioned and not guards.holds(guard, {}):
                    return None
                having = [event for event in bound if all(one in bound[event] for one in mentioned)]
                own = [event for event in having if event.source.node == node and event not in self.groups]
                if having:
                    for holder in own or having[:1]:
                        found[holder].append(guard)
                elif mentioned and (refusal := several(node, guard)) is not None:
                    raise refusal
        return found

    def words(self, scenario: Scenario, letters: Mapping[Event, Letter]) -> Iterator[tuple[Letter, ...]]:
        """Yield the event orders of a scenario as words of letters, without words of earlier
        scenarios.
        """
        events, known = scenario.events, scenario.before
        if (len(events) + 1) * (len(events) + 2) // 2 > self._left:  # the steps of the prefixes of one word
            raise TooLarge("events in all possible orders", limit=self._limit)
        needed, last = list(known), dict[Hashable, int]()
        after = [0] * len(events)
        for one, before in enumerate(known):
            for other in bits(before):
                after[other] |= 1 << one
        for one, event in enumerate(events):  # interchangeable events come in one order
            alike = letters[event], known[one], after[one]
            needed[one] |= last.get(alike, 0)
            last[alike] = 1 << one
        everything, ready = (1 << len(events)) - 1, Ready(needed)
        todo: list[tuple[frozenset[int], tuple[Letter, ...]]] = [(frozenset({0}), ())]
        while todo:
            if len(events) * len(todo) > self._limit:  # each prefix begins at least one word
                raise TooLarge("events in all possible orders", limit=self._limit)
            done, word = todo.pop()
            self.spend(len(word) + 1)
            if everything in done:
                if word not in self._said:
                    self._said.add(word)
                    self._events += len(word)
                    self.spend(0 if self._events <= self._limit else self._left + 1)
                    yield word
                continue
            nexts: dict[Letter, set[int]] = {}
            for mask in done:
                following = ready.after(mask)
                self.spend(1 + len(following))
                for one in following:
                    nexts.setdefault(letters[events[one]], set()).add(mask | 1 << one)
            todo += [(frozenset(after), (*word, letter)) for letter, after in reversed(nexts.items())]


def _names(part: Part) -> set[str]:
    if isinstance(part, Event):
        return {*rigid_variables(part.pattern)}
    return {*guards.variables(part.guard)} if isinstance(part, Condition) else set()


def merged(
    words: Iterable[tuple[Letter, ...]],
    union: Callable[[Sequence[Letter]], Letter],
    kind: Callable[[Letter], Hashable] = lambda _: None,
) -> list[tuple[Letter, ...]]:
    """Return the words with words merged that differ in one letter of the same kind.

    >>> merged([("a", "b"), ("c", "b"), ("b", "a")], "|".join)
    [('a|c', 'b'), ('b', 'a')]
    """
    found = list(dict.fromkeys(words))
    for place in range(max(map(len, found), default=0)):
        alike: dict[Hashable, list[tuple[Letter, ...]]] = {}
        for word in found:
            same = (word[:place], kind(word[place]), word[place + 1 :]) if place < len(word) else (word,)
            alike.setdefault(same, []).append(word)
        found = [
            several[0]
            if len(several) == 1
            else (*several[0][:place], union([word[place] for word in several]), *several[0][place + 1 :])
            for several in alike.values()
        ]
    return found
