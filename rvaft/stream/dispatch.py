"""Which of several trees an event of their log concerns, and its kind for each of them.

One index over the patterns of all trees classifies events; guards are asked for each tree. An event
*concerns* a tree if its discriminating values allow a match, up to spelling. For other trees it is
only counted.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Final

from rvaft.core.guard_table import GuardTable
from rvaft.core.pattern_index import Decided, FirstLiterals, PatternIndex, literals_of
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json, JsonObject
from rvaft.stream.bulk import EventGroup, by_shape, split
from rvaft.stream.statistics import OTHERS, EventKind, EventTypeIndex, spelling

MEMORY: Final = 10_000
"""Maximum number of combinations of discriminating values whose trees are remembered."""
Classified = Mapping[int, list[tuple[EventKind, EventGroup]]]
"""By the number of a tree, the events that concern it, in groups of a kind."""


class Dispatch:
    """The common index of some trees, which are known by their numbers."""

    def __init__(self, types: Sequence[EventTypeIndex]) -> None:
        self._types = types
        of_trees: dict[Pattern, list[tuple[int, int]]] = {}
        for tree, one in enumerate(types):
            for number, pattern in enumerate(one.patterns):
                of_trees.setdefault(pattern, []).append((tree, number))
        self._of_trees = list(of_trees.values())
        """By the number of a pattern, the trees that have it, with its number there."""
        self._shapes = PatternIndex(of_trees, self._tables)
        self.fields = tuple(dict.fromkeys(field for one in types for field in one.discriminators.fields))
        different = dict.fromkeys(one.discriminators.fields for one in types)
        self._alike = [_Alike(self.fields, fields, types) for fields in different]
        self._known: dict[tuple[Json, ...], tuple[int, ...]] = {}
        self._texts: dict[tuple[str, str], bool] = {}

    def _tables(self, decided: Decided) -> dict[int, GuardTable[EventKind]]:
        """Return the guards to ask of events with these patterns, for each tree that has one of them."""
        of_trees: dict[int, tuple[list[int], list[int]]] = {}
        for which, numbers in enumerate(decided):
            for pattern in numbers:
                for tree, number in self._of_trees[pattern]:
                    of_trees.setdefault(tree, ([], []))[which].append(number)
        return {
            tree: self._types[tree].shapes.result(Decided(tuple(sorted(fits)), tuple(sorted(open_))))
            for tree, (fits, open_) in of_trees.items()
        }

    def possible(self, values: Iterable[Json]) -> bool:
        """Whether events with these discriminating values concern a tree; other values are noted."""
        return bool(self._concerned(tuple(values)))

    def may_be(self, field: str, text: str) -> bool:
        """Whether events with this text in a field may concern a tree; other texts are noted."""
        known = self._texts.get((field, text))
        if known is None:
            known = any([one.may_be(field, text) for one in self._types])  # noqa: C419 (each notes the text)
            if len(self._texts) >= MEMORY:
                self._texts.clear()
            self._texts[field, text] = known
        return known

    def _concerned(self, values: tuple[Json, ...]) -> tuple[int, ...]:
        try:
            known = self._known.get(values)
        except TypeError:  # a list or an object
            values = tuple([value if isinstance(value, str) else None for value in values])
            known = self._known.get(values)
        if known is None:
            known = tuple(sorted(tree for alike in self._alike for tree in alike.concerned(values)))
            if len(self._known) >= MEMORY:
                self._known.clear()
            self._known[values] = known
        return known

    def kinds(self, event: JsonObject) -> list[tuple[int, EventKind]]:
        """Return the trees that an event concerns, with its kind for each."""
        tables = self._shapes.of(event)
        return [
            (tree, tables[tree].of(event) if tree in tables else self._types[tree].nothing)
            for tree in self._concerned(tuple([event.get(field) for field in self.fields]))
        ]

    def classified(self, events: Sequence[JsonObject]) -> Classified | None:
        """Return the events for each tree that they concern; None if they must be asked one by one."""
        groups = by_shape(self._shapes, events) if set(map(type, events)) == {dict} else None
        if groups is None:
            return None
        found: dict[int, list[tuple[EventKind, EventGroup]]] = {}
        for group in groups:
            first = group.events[0]
            tables = self._shapes.of(first)
            for tree in self._concerned(tuple([first.get(field) for field in self.fields])):
                table = tables.get(tree)
                kinds = [(self._types[tree].nothing, group)] if table is None else split(table, group)
                found.setdefault(tree, []).extend(kinds)
        return found


class _Alike:
    """The trees with the same discriminating fields."""

    def __init__(self, all_fields: Sequence[str], fields: Sequence[str], types: Sequence[EventTypeIndex]) -> None:
        self._fields = fields
        self._places = [all_fields.index(field) for field in fields]
        own = [(tree, one) for tree, one in enumerate(types) if one.discriminators.fields == fields]
        self._trees = list[int]()
        """By the number of a pattern, its tree."""
        literals = list[Mapping[str, Hashable]]()
        for tree, one in own:
            for pattern in one.read:
                texts = {name: text for name, text in literals_of(pattern).items() if isinstance(text, str)}
                literals.append({name: spelling(texts[name]) for name in fields if name in texts})
                self._trees.append(tree)
        self._literals = literals
        self._filed = FirstLiterals(literals)
        self._noting = own
        """The trees that still note values of irrelevant events."""

    def concerned(self, every: Sequence[Json]) -> set[int]:
        """Return the trees that events with these values concern; the others note the values."""
        values = [every[place] for place in self._places]
        spelt = {
            field: spelling(value) if isinstance(value, str) else None
            for field, value in zip(self._fields, values, strict=True)
        }
        found = {
            self._trees[number]
            for number in self._filed.candidates(spelt)
            if all(spelt[field] == text for field, text in self._literals[number].items())
        }
        full = False
        for tree, one in self._noting:
            if tree not in found:
                one.note(value if isinstance(value, Hashable) else None for value in values)
                full = full or all(len(one.others.get(field, ())) >= OTHERS for field in self._fields)
        if full:
            self._noting = [
                (tree, one)
                for tree, one in self._noting
                if any(len(one.others.get(field, ())) < OTHERS for field in self._fields)
            ]
        return found
