"""Events read against all patterns of a tree at once: which occurrences an event can serve, and whether it is relevant.

Equal patterns are one *letter*, tried once per event. Letters are found through an index: each is filed under one field
of its pattern that has a literal, so an event that concerns nothing costs a few dictionary look-ups, however large the tree.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rvaft.engine.plan import Plan
from rvaft.guards import Guard, holds
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Literal, ObjectPattern, Pattern, match, rigid
from rvaft.patterns import variables as pattern_variables
from rvaft.tree import RVAFT
from rvaft.values import Json, key


class Letter(NamedTuple):
    """A pattern and a guard over its variables."""

    pattern: Pattern
    when: Guard | None = None

    def read(self, event: Json) -> dict[str, Json] | None:
        """The values of the pattern's variables in an event that fits, else None."""
        found = match(self.pattern, event, {})
        return found if found is not None and (self.when is None or holds(self.when, found)) else None


class Hit(NamedTuple):
    """Nodes whose runtime event an event can be, and the values it gives to their variables."""

    nodes: tuple[int, ...]
    values: Mapping[str, Json]


@dataclass(frozen=True, slots=True)
class Reading:
    """What one event means to a tree."""

    relevant: bool
    hits: tuple[Hit, ...]


class Letters:
    """All letters of a tree: those of its occurrences, those of its alphabet, and those it ignores."""

    def __init__(self, tree: RVAFT, plan: Plan) -> None:
        serves: dict[Letter, list[int]] = {}
        for node, name in enumerate(plan.names):
            pattern = tree.pattern(name)
            if pattern is not None:
                serves.setdefault(Letter(pattern, plan.filters[node]), []).append(node)
        alphabet = dict.fromkeys(Letter(entry.pattern, entry.when) for entry in tree.alphabet)
        self.letters = tuple(dict.fromkeys([*serves, *alphabet]))
        self.serves = tuple(tuple(serves.get(letter, ())) for letter in self.letters)
        """For each letter the nodes whose runtime event it is."""
        self._relevant = tuple(letter in alphabet for letter in self.letters)
        self._index = Index(letter.pattern for letter in self.letters)
        ignored = [Letter(tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores]
        self._ignored = tuple(letter for letter in ignored if _decidable(letter))
        self._ignored_index = Index(letter.pattern for letter in self._ignored)

    def serving(self, event: Json, wanted: Callable[[int], bool]) -> Iterator[tuple[int, Mapping[str, Json]]]:
        """The letters that an event fits, of those wanted, and the values it gives to their variables."""
        for number in self._index.candidates(event):
            if wanted(number):
                values = self.letters[number].read(event)
                if values is not None:
                    yield number, rigid(values)

    def read(self, event: Json) -> Reading:
        """What an event means."""
        relevant = False
        hits: list[Hit] = []
        for number in self._index.candidates(event):
            values = self.letters[number].read(event)
            if values is not None:
                relevant = relevant or self._relevant[number]
                if self.serves[number]:
                    hits.append(Hit(self.serves[number], rigid(values)))
        return Reading(relevant and not self._ignores(event), tuple(hits))

    def _ignores(self, event: Json) -> bool:
        candidates = self._ignored_index.candidates(event)
        return any(self._ignored[number].read(event) is not None for number in candidates)


def _decidable(letter: Letter) -> bool:
    """Whether the pattern binds all variables of the guard; a guard that is not bound never holds."""
    return letter.when is None or set(guard_variables(letter.when)) <= set(pattern_variables(letter.pattern))


class Index:
    """Patterns by the literals that tell them apart."""

    def __init__(self, patterns: Iterable[Pattern]) -> None:
        literals = [dict(_literals(pattern)) for pattern in patterns]
        frequency = Counter(item for fields in literals for item in fields.items())
        self._tables: dict[str, dict[Hashable, list[int]]] = {}
        self._rest: list[int] = []
        for number, fields in enumerate(literals):
            if not fields:
                self._rest.append(number)
                continue
            field, value = min(fields.items(), key=lambda item: frequency[item])
            self._tables.setdefault(field, {}).setdefault(value, []).append(number)

    def candidates(self, event: Json) -> list[int]:
        """The numbers of the patterns that an event may match, in order."""
        if not isinstance(event, Mapping):
            return self._rest
        found = [self._rest]
        for field, table in self._tables.items():
            value = event.get(field, ())
            if not isinstance(value, (Mapping, list, tuple)):
                numbers = table.get(key(value))
                if numbers is not None:
                    found.append(numbers)
        return found[0] if len(found) == 1 else sorted(number for numbers in found for number in numbers)


def _literals(pattern: Pattern) -> Iterator[tuple[str, Hashable]]:
    """The fields of an object pattern that must have one value."""
    if isinstance(pattern, ObjectPattern):
        for field, inner in pattern.fields:
            if isinstance(inner, Literal):
                yield field, key(inner.value)
