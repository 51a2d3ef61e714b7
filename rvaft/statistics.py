"""What a trace has to do with a tree: which event types it holds, and which events only just miss one."""

import json
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from rvaft.guards import Guard, holds
from rvaft.patterns import Binding, Literal, ObjectPattern, Pattern, match
from rvaft.tree import RVAFT
from rvaft.values import Json, Scalar, key

_SHOWN = 40
"""Characters of a value in a warning."""

Path = tuple[str, ...]


@dataclass(slots=True)
class NearMiss:
    """Events that have all fields of an event type but one.

    `first` says where the first of them is, and `found` what it has in that field, None where it lacks the field.
    """

    type: str
    field: Path
    expected: Pattern
    found: str | None
    first: str
    count: int = 0


class Statistics:
    """Counts over the events of one trace or several.

    An event type is what an `on` names; the default event of a leaf is a type of the leaf's name.
    """

    def __init__(self, tree: RVAFT) -> None:
        self.events = 0
        self.relevant: Counter[str] = Counter()
        self.near_misses: dict[tuple[str, Path], NearMiss] = {}
        self._seen: set[str] = set()
        whole = tree if tree.part_of is None else tree.part_of.tree
        types: dict[str, Pattern] = {}
        entries: dict[_Entry, None] = {}
        for relevant in whole.alphabet:
            on = whole.nodes[relevant.node].on
            name = relevant.node if on is None else on.event
            types.setdefault(name, relevant.pattern if on is None else whole.events[on.event].pattern)
            entries[_Entry(name, relevant.pattern, relevant.when)] = None
        self.types = tuple(types)
        self._types = _Index(_Entry(name, pattern) for name, pattern in types.items())
        self._entries = _Index(entries)
        self._ignored = _Index(_Entry("", whole.instantiate(ignore.on), ignore.when) for ignore in whole.ignores)
        leaves = ((entry.type, tuple(_leaves(entry.pattern))) for entry in entries)
        self._compound = tuple(dict.fromkeys(leaf for leaf in leaves if len(leaf[1]) > 1))

    def add(self, event: Mapping[str, Json], where: str) -> None:
        """Count one event; `where` is its place in words."""
        self.events += 1
        self._seen.update(entry.type for entry, _ in self._types.matching(event))
        matching = list(self._entries.matching(event))
        if not matching:
            self._add_near_misses(event, where)
        elif not any(entry.allows(binding) for entry, binding in self._ignored.matching(event)):
            self.relevant.update({entry.type for entry, binding in matching if entry.allows(binding)})

    @property
    def never_seen(self) -> tuple[str, ...]:
        """The event types that no event was of, in the order of the tree."""
        return tuple(name for name in self.types if name not in self._seen)

    def _add_near_misses(self, event: Json, where: str) -> None:
        missed: dict[tuple[str, Path], tuple[Pattern, str | None]] = {}
        for name, leaves in self._compound:
            near = _only_miss(leaves, event)
            if near is not None:
                missed.setdefault((name, near[0]), near[1:])
        for (name, path), (expected, found) in missed.items():
            new = NearMiss(name, path, expected, found, where)
            self.near_misses.setdefault((name, path), new).count += 1


@dataclass(frozen=True, slots=True)
class _Entry:
    """A pattern of an event type, and the guard that belongs to it."""

    type: str
    pattern: Pattern
    when: Guard | None = None

    def allows(self, binding: Binding) -> bool:
        return self.when is None or holds(self.when, binding)


class _Index:
    """Entries by the first literal among their fields, so that an event meets only those it could match."""

    def __init__(self, entries: Iterable[_Entry]) -> None:
        self._by_value: dict[str, dict[Hashable, list[_Entry]]] = {}
        self._others: list[_Entry] = []
        for entry in entries:
            first = _first_literal(entry.pattern)
            if first is None:
                self._others.append(entry)
            else:
                self._by_value.setdefault(first[0], {}).setdefault(key(first[1]), []).append(entry)

    def matching(self, event: Mapping[str, Json]) -> Iterator[tuple[_Entry, Binding]]:
        """The entries that match the event, each with its binding."""
        for name, entries in self._by_value.items():
            if name in event:
                yield from _matching(entries.get(key(event[name]), ()), event)
        yield from _matching(self._others, event)


def _matching(entries: Iterable[_Entry], event: Json) -> Iterator[tuple[_Entry, Binding]]:
    for entry in entries:
        binding = match(entry.pattern, event, {})
        if binding is not None:
            yield entry, binding


def _first_literal(pattern: Pattern) -> tuple[str, Scalar] | None:
    fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    return next(((name, part.value) for name, part in fields if isinstance(part, Literal)), None)


def _leaves(pattern: Pattern) -> Iterator[tuple[Path, Pattern]]:
    """The fields of an object pattern and of the object patterns in it, outermost first, in order."""
    agenda: list[tuple[Path, Pattern]] = [((), pattern)]
    while agenda:
        path, part = agenda.pop()
        if isinstance(part, ObjectPattern) and part.fields:
            agenda.extend(((*path, name), inner) for name, inner in reversed(part.fields))
        else:
            yield path, part


def _only_miss(fields: tuple[tuple[Path, Pattern], ...], event: Json) -> tuple[Path, Pattern, str | None] | None:
    """The one field that the event misses, what is expected there and what it has; None if it misses more."""
    binding: dict[str, Json] = {}
    miss: tuple[Path, Pattern, str | None] | None = None
    for path, expected in fields:
        found = _at(event, path)
        extended = None if found is None else match(expected, found[0], binding)
        if extended is not None:
            binding = extended
        elif miss is not None:
            return None
        else:
            miss = (path, expected, None if found is None else _short(found[0]))
    return miss


def _at(event: Json, path: Path) -> tuple[Json] | None:
    """The value at a path, in a tuple since it may be null, or None where there is none."""
    for name in path:
        if not isinstance(event, Mapping) or name not in event:
            return None
        event = event[name]
    return (event,)


def _short(value: Json) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
