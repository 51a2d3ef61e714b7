"""What a trace has to do with a tree: which event types it holds, and which events only just miss one."""

import json
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from rvaft.core.branches import whole
from rvaft.core.classifier import (
    Decided,
    Discriminators,
    GuardTable,
    Letter,
    PatternIndex,
    Reader,
    TreeReads,
    guard_table,
    literals_of,
    reader,
)
from rvaft.engine.compiled_tree import EventClass
from rvaft.model.expressions import pattern_text
from rvaft.model.guards import Predicate
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, match
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, JsonObject, at
from rvaft.support.terminal import cut

LOOKED_AT: Final = 20
"""Near misses are looked for in so many events of those that match nothing and have the same
strings in the discriminating fields.
"""
MOST: Final = 10_000
"""How many different such strings are told apart; events with others are not looked at."""
UNSEEN: Final[tuple[int, ...]] = (-1,)
"""In place of letters where data_warnings did not look yet, or where the shape does not say which there are."""

Path = tuple[str, ...]


class EventKind:
    """What events of one shape are: the types they have, the entries of the alphabet and the
    ignored letters that they fit.

    All such events are relevant of the `constant` types unless they are ignored, or, where that is
    None, this has to be asked of each; with `plain` whatever else they hold. `noted` are the
    statistics that know these types as seen, `monitored` is what the shape says to each monitor,
    `looked_at` the letters of which data_warnings ask something, and `good` what they know to be
    well: who knows it, since when, of which fields, and the types there.
    """

    __slots__ = (
        "_asked",
        "classes",
        "constant",
        "counted",
        "decided",
        "entries",
        "good",
        "ignored",
        "looked_at",
        "noted",
        "plain",
        "types",
    )

    def __init__(self, decided: Decided, letters: Sequence[tuple[str, str, Reader]]) -> None:
        self.decided = decided
        self.types = frozenset(name for kind, name, _ in letters if kind == "type")
        self.entries = tuple((name, one) for kind, name, one in letters if kind == "entry")
        self.ignored: tuple[Predicate, ...] = tuple(
            one.holds if one.plain and one.holds is not None else one.admits
            for kind, _, one in letters
            if kind == "ignored"
        )
        self._asked = tuple((name, one.holds if one.plain else one.admits) for name, one in self.entries)
        asked = any(one.holds is not None for _, one in self.entries)
        self.constant = None if asked else tuple(dict.fromkeys(name for name, _ in self.entries))
        self.plain = bool(self.constant) and not self.ignored and not decided.open
        self.counted: GuardTable[tuple[str, ...] | None] | None = None
        """Where the fields of an event say it, from it to the types of which it is relevant, and
        None where it is ignored.
        """
        ignored = [one for kind, _, one in letters if kind == "ignored"]
        readers = [one for _, one in self.entries] + ignored
        if (asked or ignored) and not decided.open and all(one.plain for one in readers):
            self.counted = guard_table([one.asked for one in readers], self._types)
        self.noted: object = None
        self.classes: tuple[EventClass, ...] | None = None
        self.looked_at = UNSEEN
        self.good: tuple[object, int, Sequence[str] | None, set[tuple[type, ...]]] | None = None

    def _types(self, holds: Callable[[int], bool]) -> tuple[str, ...] | None:
        """The types of which an event is relevant, of which these letters hold; None where it is ignored."""
        if any(holds(len(self.entries) + place) for place in range(len(self.ignored))):
            return None
        return tuple(dict.fromkeys(name for place, (name, _) in enumerate(self.entries) if holds(place)))

    def relevant(self, event: Mapping[str, Json]) -> tuple[str, ...]:
        """The types of which an event that is not ignored is relevant."""
        found: tuple[str, ...] = ()
        for name, admits in self._asked:
            if (admits is None or admits(event)) and name not in found:
                found = (*found, name)
        return found


class EventTypeIndex:
    """What events can be to a tree: of which types they are, by one look-up for the types and for
    all monitors of the tree.

    An event type is what an `on` names; the default event of a leaf is a type of the leaf's name.
    `also` are patterns of monitors. `of` says what an event is as far as its shape decides;
    `compound` are the types with several fields, of which an event can miss one.
    """

    def __init__(self, tree: RVAFT, also: Iterable[Pattern] = ()) -> None:
        self.tree = tree = whole(tree)
        types: dict[str, Pattern] = {}
        entries: dict[tuple[str, Letter], None] = {}
        for relevant in tree.alphabet:
            on = tree.nodes[relevant.node].on
            name = relevant.node if on is None else on.event
            types.setdefault(name, relevant.pattern if on is None else tree.events[on.event].pattern)
            entries[name, Letter(relevant.pattern, relevant.when)] = None
        self.names = tuple(types)
        self.entries = frozenset(letter for _, letter in entries)
        """What says of events that they are relevant, unless they are ignored."""
        letters = [("type", name, Letter(pattern)) for name, pattern in types.items()]
        letters += [("entry", name, letter) for name, letter in entries]
        letters += [("ignored", "", Letter(tree.instantiate(one.on), one.when)) for one in tree.ignores]
        letters += [("monitor", "", Letter(pattern)) for pattern in dict.fromkeys(also)]
        self.letters = [(kind, name, reader(number, one)) for number, (kind, name, one) in enumerate(letters)]
        self.guards = {number: one.when for number, (_, _, one) in enumerate(letters)}
        index = PatternIndex((letter.pattern for _, _, letter in letters), self._sight)
        self.index, self.of = index, index.of
        reads = TreeReads(tree)
        self.discriminators: Discriminators = reads.discriminators
        self._patterns = reads.patterns
        self._texts: dict[str, frozenset[Json] | None] = {}
        """What may stand in a field in which every pattern asks for a text."""
        self._meant: dict[str, dict[Json, Json]] = {field: {} for field in self.discriminators.fields}
        for pattern in reads.patterns:
            for field, value in pattern.fields if isinstance(pattern, ObjectPattern) else ():
                if field in self._meant and isinstance(value, Literal) and isinstance(value.value, str):
                    self._meant[field][_spelling(value.value)] = value.value
        fields = ((name, tuple(_leaves(letter.pattern))) for name, letter in entries)
        self.compound = tuple(dict.fromkeys(one for one in fields if len(one[1]) > 1))

    def possible(self, values: Iterable[Hashable]) -> bool:
        """Whether events with these values in the discriminating fields may fit a pattern, perhaps
        if the values were spelled as they are there.
        """
        meant = {
            field: self._meant[field].get(_spelling(value), value) if isinstance(value, str) else None
            for field, value in zip(self.discriminators.fields, values, strict=True)
        }
        return bool(self.discriminators.candidates(self.discriminators.values(meant)))

    def may_be(self, field: str, text: str) -> bool:
        """Whether an event with this text in this field may fit a pattern, whatever else it has,
        perhaps if the text were spelled as it is there.
        """
        if field not in self._texts:
            asked = [literals_of(pattern).get(field) for pattern in self._patterns]
            texts = frozenset(_spelling(one) for one in asked if isinstance(one, str))
            self._texts[field] = texts if all(isinstance(one, str) for one in asked) else None
        known = self._texts[field]
        return known is None or _spelling(text) in known

    def entries_of(self, event_kind: EventKind, event: JsonObject) -> list[Letter]:
        """The entries of the alphabet that an event of a kind is, ignored or not."""
        numbers = (number for number in (*event_kind.decided.fits, *event_kind.decided.open))
        letters = ((self.letters[number], self.guards[number]) for number in numbers)
        return [Letter(one.pattern, when) for (kind, _, one), when in letters if kind == "entry" and one.admits(event)]

    def possible_patterns(self, event_kind: EventKind) -> frozenset[Pattern]:
        """The patterns that events of a kind match, or may match."""
        fits, open_ = event_kind.decided
        return frozenset(self.letters[number][2].pattern for number in (*fits, *open_))

    def decided(self, event_kind: EventKind, event: Mapping[str, Json]) -> EventKind:
        """What the event itself decides beside its shape. Here only patterns count: guards are asked afterwards."""
        fits, open_ = event_kind.decided
        found = (number for number in open_ if match(self.letters[number][2].pattern, event, {}) is not None)
        return self._sight(Decided((*fits, *found), ()))

    def _sight(self, decided: Decided) -> EventKind:
        return EventKind(decided, [self.letters[number] for number in decided.fits])


@dataclass(slots=True)
class NearMissCount:
    """Events that have all fields of an event type but one.

    `expected` is the text of the pattern there, `found` what the first event has in that field,
    None where it lacks the field, and `first` says where that event is. With `more` there are
    events like these that were not looked at.
    """

    type: str
    field: Path
    expected: str
    found: str | None
    first: str
    count: int = 0
    more: bool = False


class Statistics:
    """Counts over the events of one trace or several; can be pickled, and added to those of other
    traces of the same tree.

    `tally` says how many events were relevant of these types together, `seen` are the types that some event was of.
    """

    def __init__(self, types: EventTypeIndex) -> None:
        self.types = types
        self.names = types.names
        self.events = 0
        self.tally: Counter[tuple[str, ...]] = Counter()
        self.near_misses: dict[tuple[str, Path], NearMissCount] = {}
        self.seen: set[str] = set()
        self._looked_at: Counter[tuple[Hashable, ...]] = Counter()
        self._missed: dict[tuple[Hashable, ...], list[NearMissCount]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """The counts, without what the tree says."""
        return {name: value for name, value in vars(self).items() if name != "types"}

    def add(
        self, event: Mapping[str, Json], number: int, prefix: str = "", event_kind: EventKind | None = None
    ) -> bool:
        """Count one event and say whether it is relevant to the tree; `number`, with a prefix, is its place."""
        self.events += 1
        event_kind = event_kind or self.types.of(event)
        if event_kind.decided.open:
            event_kind = self.types.decided(event_kind, event)
        if event_kind.noted is not self:
            self.seen |= event_kind.types
            if event_kind.constant == ():
                self._look_at(event, f"{prefix}event {number}")
                return False
            event_kind.noted = self
        if event_kind.counted is not None:
            found = event_kind.counted.of(event)
            if found is None:
                return False
            self.tally[found] += 1
            return bool(found)
        for admits in event_kind.ignored:
            if admits(event):
                return False
        names = event_kind.constant or event_kind.relevant(event)
        self.tally[names] += 1
        return bool(names)

    def add_many(self, event_kind: EventKind, types: tuple[str, ...] | None, count: int) -> None:
        """Count so many events of one shape, some type's own, that are relevant of these types,
        None where they are ignored.
        """
        self.events += count
        self.seen |= event_kind.types
        if types is not None:
            self.tally[types] += count

    @property
    def relevant(self) -> Counter[str]:
        """How many events were relevant of each type."""
        found: Counter[str] = Counter()
        for names, count in self.tally.items():
            found.update(dict.fromkeys(names, count))
        return found

    @property
    def never_seen(self) -> tuple[str, ...]:
        """The event types that no event was of, in the order of the tree."""
        return tuple(name for name in self.names if name not in self.seen)

    def merge(self, other: "Statistics") -> None:
        """Add the counts of a later trace of the same tree."""
        self.events += other.events
        self.tally.update(other.tally)
        self.seen |= other.seen
        for name, miss in other.near_misses.items():
            known = self.near_misses.get(name, replace(miss, count=0))
            self.near_misses[name] = replace(known, count=known.count + miss.count, more=known.more or miss.more)

    def _look_at(self, event: Mapping[str, Json], place: str) -> None:
        discriminators = self.types.discriminators
        values = discriminators.apart(map(event.get, discriminators.fields))
        if not self.types.compound or not self.types.possible(values):
            return
        known = self._looked_at[values] if values in self._looked_at or len(self._looked_at) < MOST else LOOKED_AT
        if known >= LOOKED_AT:
            for miss in self._missed.get(values, ()):
                miss.more = True
            return
        self._looked_at[values] = known + 1
        missed: dict[tuple[str, Path], tuple[Pattern, str | None]] = {}
        for name, leaves in self.types.compound:
            if (near := _only_miss(leaves, event, discriminators.fields)) is not None:
                missed.setdefault((name, near[0]), near[1:])
        for (name, path), (expected, found) in missed.items():
            new = NearMissCount(name, path, pattern_text(expected), found, place)
            miss = self.near_misses.setdefault((name, path), new)
            miss.count += 1
            like = self._missed.setdefault(values, [])
            if miss not in like:
                like.append(miss)


def _spelling(text: Json) -> Json:
    """A text as it may be meant by somebody who writes it otherwise: `/Command` and `command` are one."""
    return text.strip("/ ").casefold() if isinstance(text, str) else text


def _leaves(pattern: Pattern) -> Iterator[tuple[Path, Pattern]]:
    """The fields of an object pattern and of the object patterns in it, outermost first, in order."""
    agenda: list[tuple[Path, Pattern]] = [((), pattern)]
    while agenda:
        path, part = agenda.pop()
        if isinstance(part, ObjectPattern) and part.fields:
            agenda.extend(((*path, name), inner) for name, inner in reversed(part.fields))
        else:
            yield path, part


def _only_miss(
    leaves: Iterable[tuple[Path, Pattern]], event: Json, telling: Sequence[str]
) -> tuple[Path, Pattern, str | None] | None:
    """The one field that the event misses, what is expected there and what it has; None if it misses more.

    An event that misses but a field `telling` event types apart is of another type, unless it looks
    like the same one misspelt.
    """
    binding: dict[str, Json] = {}
    miss: tuple[Path, Pattern, str | None] | None = None
    for path, expected in leaves:
        found = at(event, path, UNSEEN)
        extended = None if found is UNSEEN else match(expected, found, binding)
        if extended is not None:
            binding = extended
            continue
        if miss is not None:
            return None
        misspelt = isinstance(expected, Literal) and _spelling(expected.value) == _spelling(found)
        if len(path) == 1 and path[0] in telling and not misspelt:
            return None
        miss = path, expected, None if found is UNSEEN else cut(json.dumps(found, ensure_ascii=False))
    return miss
