"""What a trace has to do with a tree: which event types it holds, and which events only just miss one."""

import json
from collections import Counter
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from rvaft.analysis.pattern_index import Decided, Letter, Reader, Shapes, TreeReads, reader
from rvaft.model.guards import Predicate
from rvaft.model.patterns import ObjectPattern, Pattern, match
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

LOOKED_AT: Final = 20
"""Near misses are looked for in so many events of those that match nothing and have the same strings in the discriminating fields."""
MOST: Final = 10_000
"""How many different such strings are told apart; events with others are not looked at."""
_SHOWN = 40
"""Characters of a value in a warning."""

Path = tuple[str, ...]


@dataclass(slots=True)
class NearMiss:
    """Events that have all fields of an event type but one.

    `first` says where the first of them is, and `found` what it has in that field, None where it lacks the field. With `more` there are
    events like these that were not looked at.
    """

    type: str
    field: Path
    expected: Pattern
    found: str | None
    first: str
    count: int = 0
    more: bool = False


class Statistics:
    """Counts over the events of one trace or several; can be pickled.

    An event type is what an `on` names; the default event of a leaf is a type of the leaf's name.
    """

    def __init__(self, tree: RVAFT) -> None:
        self.events = 0
        self.relevant: Counter[str] = Counter()
        self.near_misses: dict[tuple[str, Path], NearMiss] = {}
        self._tree = tree if tree.part_of is None else tree.part_of.tree
        self._seen: set[str] = set()
        self._looked_at: Counter[tuple[Hashable, ...]] = Counter()
        self._missed: dict[tuple[Hashable, ...], list[NearMiss]] = {}
        self._compile()

    def __getstate__(self) -> dict[str, Any]:
        """The tree and the counts; what is compiled from the tree is compiled again."""
        compiled = {"types", "discriminators", "_readers", "_kinds", "_shapes", "_compound"}
        return {name: value for name, value in vars(self).items() if name not in compiled}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._compile()

    def _compile(self) -> None:
        tree = self._tree
        types: dict[str, Pattern] = {}
        entries: dict[tuple[str, Letter], None] = {}
        for relevant in tree.alphabet:
            on = tree.nodes[relevant.node].on
            name = relevant.node if on is None else on.event
            types.setdefault(name, relevant.pattern if on is None else tree.events[on.event].pattern)
            entries[name, Letter(relevant.pattern, relevant.when)] = None
        self.types = tuple(types)
        self.discriminators = TreeReads(tree).discriminators
        letters: list[tuple[str, str, Letter]] = [("type", name, Letter(pattern)) for name, pattern in types.items()]
        letters.extend(("entry", name, letter) for name, letter in entries)
        letters.extend(("ignored", "", Letter(tree.instantiate(ignore.on), ignore.when)) for ignore in tree.ignores)
        self._kinds = tuple((kind, name) for kind, name, _ in letters)
        self._readers = tuple(reader(number, letter) for number, (_, _, letter) in enumerate(letters))
        self._shapes = Shapes((letter.pattern for _, _, letter in letters), self._sketch)
        leaves = ((name, tuple(_leaves(letter.pattern))) for name, letter in entries)
        self._compound = tuple(dict.fromkeys(leaf for leaf in leaves if len(leaf[1]) > 1))

    def add(self, event: Mapping[str, Json], number: int, prefix: str = "") -> bool:
        """Count one event and say whether it is relevant to the tree; `number`, with a prefix, is its place."""
        self.events += 1
        sketch = self._shapes.of(event)
        if not sketch.ready:
            if sketch.open:
                sketch = self._sketch(self._decided(sketch, event))
            self._seen.update(sketch.types)
            if not sketch.entries:
                self._look_at(event, number, prefix)
                return False
            sketch.ready = not sketch.open
        for admits in sketch.ignored:
            if admits(event):
                return False
        relevant = sketch.relevant(event)
        for name in relevant:
            self.relevant[name] += 1
        return bool(relevant)

    def pass_over(self, values: tuple[Hashable, ...], count: int) -> None:
        """Count events that match nothing, and are not to be looked at, with these strings in the discriminating fields."""
        self.events += count
        if count:
            self._note_more(values)

    def wants(self, values: tuple[Hashable, ...]) -> int:
        """How many more events that match nothing, with these strings in the discriminating fields, are looked at for near misses."""
        if not self._compound or (values not in self._looked_at and len(self._looked_at) >= MOST):
            return 0
        return max(0, LOOKED_AT - self._looked_at[values])

    @property
    def never_seen(self) -> tuple[str, ...]:
        """The event types that no event was of, in the order of the tree."""
        return tuple(name for name in self.types if name not in self._seen)

    def _sketch(self, decided: Decided) -> "_Sketch":
        kinds = self._kinds
        return _Sketch(
            frozenset(kinds[n][1] for n in decided.fits if kinds[n][0] == "type"),
            tuple((kinds[n][1], self._readers[n]) for n in decided.fits if kinds[n][0] == "entry"),
            tuple(_admitting(self._readers[n]) for n in decided.fits if kinds[n][0] == "ignored"),
            decided,
        )

    def _decided(self, sketch: "_Sketch", event: Mapping[str, Json]) -> Decided:
        """What the event itself decides beside its shape. Here only patterns count: guards are asked afterwards."""
        fits, open_ = sketch.decided
        found = (number for number in open_ if match(self._readers[number].pattern, event, {}) is not None)
        return Decided((*fits, *found), ())

    def _look_at(self, event: Mapping[str, Json], number: int, prefix: str) -> None:
        values = self.discriminators.apart(map(event.get, self.discriminators.fields))
        if self.wants(values):
            self._looked_at[values] += 1
            self._add_near_misses(event, f"{prefix}event {number}", values)
        else:
            self._note_more(values)

    def _note_more(self, values: tuple[Hashable, ...]) -> None:
        for miss in self._missed.get(values, ()):
            miss.more = True

    def _add_near_misses(self, event: Json, where: str, values: tuple[Hashable, ...]) -> None:
        missed: dict[tuple[str, Path], tuple[Pattern, str | None]] = {}
        for name, leaves in self._compound:
            near = _only_miss(leaves, event)
            if near is not None:
                missed.setdefault((name, near[0]), near[1:])
        for (name, path), (expected, found) in missed.items():
            new = NearMiss(name, path, expected, found, where)
            miss = self.near_misses.setdefault((name, path), new)
            miss.count += 1
            like = self._missed.setdefault(values, [])
            if miss not in like:
                like.append(miss)


def _admitting(one: Reader) -> Predicate:
    """What an event is asked whose shape does not exclude it."""
    return one.holds if one.plain and one.holds is not None else one.admits


class _Sketch:
    """What events of one shape may be: the types they have, and the entries of the alphabet and ignored letters that they fit."""

    __slots__ = ("_fixed", "decided", "entries", "ignored", "open", "ready", "types")

    def __init__(
        self,
        types: frozenset[str],
        entries: tuple[tuple[str, Reader], ...],
        ignored: tuple[Predicate, ...],
        decided: Decided,
    ) -> None:
        self.types = types
        self.entries = entries
        self.ignored = ignored
        self.decided = decided
        self.open = bool(decided.open)
        self.ready = False
        """Whether its types are noted, and its events have to be asked no more than what is ignored and what is relevant."""
        guarded = any(one.holds is not None for _, one in entries)
        self._fixed = None if guarded else tuple(dict.fromkeys(name for name, _ in entries))

    def relevant(self, event: Mapping[str, Json]) -> tuple[str, ...]:
        """The types of which an event that is not ignored is relevant."""
        if self._fixed is not None:
            return self._fixed
        return tuple(dict.fromkeys(name for name, one in self.entries if one.admits(event)))


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
