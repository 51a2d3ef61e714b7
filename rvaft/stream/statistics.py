"""What a trace has to do with a tree: which event types it holds, and which events only just miss one."""

import json
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Final, cast

from rvaft.core.branches import whole
from rvaft.core.classifier import (
    Decided,
    Discriminators,
    GuardTable,
    Letter,
    PatternIndex,
    TreeReads,
    guard_table,
    joined_tables,
    literals_of,
    reader,
)
from rvaft.engine.compiled_tree import EngineLetters, EventClass
from rvaft.model.expressions import pattern_text
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, match
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, at
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


@dataclass(slots=True, eq=False)
class WarningChecks:
    """What data warnings ask of events that match the same patterns."""

    looked_at: tuple[int, ...] = UNSEEN
    """The letters of which they ask something."""
    good: tuple[object, int, Sequence[str] | None, set[tuple[type, ...]]] | None = None
    """What they know to be well: who knows it, since when, of which fields, and the types there."""


@dataclass(slots=True, eq=False)
class EventKind:
    """What events are that have one shape and of which the same guards hold; without arguments, nothing."""

    fits: tuple[int, ...] = ()
    """The numbers of the letters whose patterns they match."""
    admitted: tuple[int, ...] = ()
    """Those of the letters that they are, guards included."""
    classes: tuple[EventClass, ...] = ()
    """What they are to each engine."""
    types: frozenset[str] = field(default=frozenset(), init=False)
    """The event types that they fit."""
    entries: bool = field(default=False, init=False)
    """Whether they fit entries of the alphabet."""
    relevant: tuple[str, ...] | None = field(default=(), init=False)
    """The types of which they are relevant, None where they are ignored."""
    serves: bool = field(default=False, init=False)
    """Whether they may be the event of a node."""
    noted: object = field(default=None, init=False)
    """The statistics that know these types as seen."""
    checks: WarningChecks = field(default_factory=WarningChecks)
    """Shared by all kinds that match the same patterns."""


class EventTypeIndex:
    """What events can be to a tree, and to engines that monitor it: one look-up serves all of them.

    An event type is what an `on` names; the default event of a leaf is a type of the leaf's name.
    `compound` are the types with several fields, of which an event can miss one.
    """

    def __init__(self, tree: RVAFT, engines: Sequence[EngineLetters] = ()) -> None:
        self.tree = tree = whole(tree)
        self._engines = engines
        types: dict[str, Pattern] = {}
        entries: dict[tuple[str, Letter], None] = {}
        for relevant in tree.alphabet:
            on = tree.nodes[relevant.node].on
            name = relevant.node if on is None else on.event
            types.setdefault(name, relevant.pattern if on is None else tree.events[on.event].pattern)
            entries[name, Letter(relevant.pattern, relevant.when)] = None
        self.names = tuple(types)
        letters = [("type", name, Letter(pattern)) for name, pattern in types.items()]
        letters += [("entry", name, letter) for name, letter in entries]
        letters += [("ignored", "", Letter(tree.instantiate(one.on), one.when)) for one in tree.ignores]
        self.letters = letters
        """The letters, by their numbers: of types, of entries of the alphabet, and of what is ignored."""
        self._tests = [
            (reader(number, Letter(one.pattern)).test, reader(number, one).test)
            for number, (_, _, one) in enumerate(letters)
        ]
        """For each letter what is asked of an event for its pattern, and for its guard too."""
        also = dict.fromkeys(pattern for one in engines for pattern in one.patterns)
        self._patterns = (*(one.pattern for _, _, one in letters), *also)
        self.shapes = PatternIndex(self._patterns, self._table)
        self.late = EventKind(classes=(EventClass(),) * len(engines))
        """What a late event is: nothing that a match could use."""
        reads = TreeReads(tree)
        self.discriminators: Discriminators = reads.discriminators
        self._read = reads.patterns
        self._texts: dict[str, frozenset[Json] | None] = {}
        """What may stand in a field in which every pattern asks for a text."""
        self._meant: dict[str, dict[Json, Json]] = {field: {} for field in self.discriminators.fields}
        for pattern in reads.patterns:
            for name, value in pattern.fields if isinstance(pattern, ObjectPattern) else ():
                if name in self._meant and isinstance(value, Literal) and isinstance(value.value, str):
                    self._meant[name][_spelling(value.value)] = value.value
        fields = ((name, tuple(_leaves(letter.pattern))) for name, letter in entries)
        self.compound = tuple(dict.fromkeys(one for one in fields if len(one[1]) > 1))

    def of(self, event: Mapping[str, Json]) -> EventKind:
        """What an event is."""
        return self.shapes.of(event).of(event)

    def _table(self, decided: Decided) -> GuardTable[EventKind]:
        """From an event of a shape to its kind."""
        numbers = [number for number in sorted(chain(*decided)) if number < len(self.letters)]
        tests = [test for number in numbers for test in self._tests[number]]

        def derive(holds: Sequence[bool]) -> EventKind:
            fits = tuple([number for number, found in zip(numbers, holds[::2], strict=True) if found])
            admitted = tuple([number for number, found in zip(numbers, holds[1::2], strict=True) if found])
            return EventKind(fits, admitted, checks=checks.setdefault(fits, WarningChecks()))

        checks: dict[tuple[int, ...], WarningChecks] = {}
        table: GuardTable[EventKind | EventClass] = guard_table(tests, derive)
        possible = {self._patterns[number] for number in chain(*decided)}
        tables = cast("list[GuardTable[EventKind | EventClass]]", [one.table(possible) for one in self._engines])
        return joined_tables([table, *tables], self._joined)

    def _joined(self, found: tuple[EventKind | EventClass, ...]) -> EventKind:
        """The kind of events with these letters, and with these classes to the engines."""
        kind, *classes = found
        assert isinstance(kind, EventKind), "the first says which letters they are"
        made = EventKind(kind.fits, kind.admitted, tuple(cast("list[EventClass]", classes)), checks=kind.checks)
        relevant: dict[str, None] = {}
        ignored = False
        for number in made.admitted:
            what, name, _ = self.letters[number]
            if what == "entry":
                relevant[name] = None
            ignored = ignored or what == "ignored"
        made.relevant = None if ignored else tuple(relevant)
        made.types = frozenset([self.letters[number][1] for number in made.fits if self.letters[number][0] == "type"])
        made.entries = any(self.letters[number][0] == "entry" for number in made.fits)
        made.serves = any(one.serving for one in made.classes)
        return made

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
            asked = [literals_of(pattern).get(field) for pattern in self._read]
            texts = frozenset(_spelling(one) for one in asked if isinstance(one, str))
            self._texts[field] = texts if all(isinstance(one, str) for one in asked) else None
        known = self._texts[field]
        return known is None or _spelling(text) in known


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

    def __getstate__(self) -> dict[str, object]:
        """The counts, without what the tree says."""
        return {name: value for name, value in vars(self).items() if name != "types"}

    def add(
        self, event: Mapping[str, Json], number: int, prefix: str = "", event_kind: EventKind | None = None
    ) -> bool:
        """Count one event and say whether it is relevant to the tree; `number`, with a prefix, is its place."""
        self.events += 1
        event_kind = event_kind or self.types.of(event)
        if event_kind.noted is not self:
            self.seen |= event_kind.types
            if not event_kind.entries:
                self._look_at(event, f"{prefix}event {number}")
                return False
            event_kind.noted = self
        if event_kind.relevant is None:
            return False
        self.tally[event_kind.relevant] += 1
        return bool(event_kind.relevant)

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
