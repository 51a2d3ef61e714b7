"""Statistics of traces: which event types occur, and near misses."""

import json
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Final, cast

from rvaft.core.fields_to_read import TreeReads
from rvaft.core.guard_table import GuardTable, guard_table, joined_tables
from rvaft.core.letters import Letter, reader
from rvaft.core.pattern_index import Decided, Discriminators, PatternIndex, brief, literals_of
from rvaft.core.restriction import whole
from rvaft.engine.compiled_tree import EventClass, TreeLetters
from rvaft.model.expressions import on_text, pattern_text
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, match
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, at
from rvaft.support.terminal import cut

LOOKED_AT: Final = 20
"""Maximum number of examined events with the same discriminating values."""
OTHERS: Final = 20
"""Maximum number of noted values per discriminating field."""
MOST: Final = 10_000
"""Maximum number of combinations of these values."""
UNSEEN: Final[tuple[int, ...]] = (-1,)
"""Marks missing fields, and checks not computed yet."""

Path = tuple[str, ...]


@dataclass(slots=True, eq=False)
class WarningChecks:
    """The data warnings' checks for events that match the same patterns."""

    looked_at: tuple[int, ...] = UNSEEN
    good: tuple[object, int, Sequence[str] | None, set[tuple[type, ...]]] | None = None
    """Passed checks: owner, version, fields, value types."""


@dataclass(slots=True, eq=False)
class EventKind:
    """Events with the same shape and true guards; by default, without a match."""

    fits: tuple[int, ...] = ()
    """The letters whose patterns match."""
    admitted: tuple[int, ...] = ()
    """The letters that match with their guards."""
    classes: tuple[EventClass, ...] = ()
    types: frozenset[str] = field(default=frozenset(), init=False)
    entries: bool = field(default=False, init=False)
    relevant: tuple[str, ...] | None = field(default=(), init=False)
    """The relevant types; None for an ignored event."""
    serves: bool = field(default=False, init=False)
    """Whether the event may be that of a node, or an absent one."""
    noted: object = field(default=None, init=False)
    checks: WarningChecks = field(default_factory=WarningChecks)


class EventTypeIndex:
    """Classifies events for a tree and its engines with one look-up.

    An event type is a type in an `on`, or a leaf with its default event. `compound` types have
    several fields, and so near misses.
    """

    def __init__(self, tree: RVAFT, engines: Sequence[TreeLetters] = ()) -> None:
        self.tree = tree = whole(tree)
        self._engines = engines
        self._calls: dict[Pattern, str] = {}
        types: dict[str, Pattern] = {}
        entries: dict[tuple[str, Letter], None] = {}
        for relevant in tree.alphabet:
            on = tree.nodes[relevant.node].on
            name = relevant.node if on is None else on.event
            types.setdefault(name, relevant.pattern if on is None else tree.events[on.event].pattern)
            entries[name, Letter(relevant.pattern, relevant.when)] = None
            if on is not None and any(isinstance(argument, Literal) for argument in on.arguments):
                arguments = tuple(one if isinstance(one, Literal) else Anything() for one in on.arguments)
                self._calls[relevant.pattern] = on_text(replace(on, arguments=arguments))
        self.names = tuple(types)
        calls = ((letter.pattern, name) for name, letter in entries if letter.pattern in self._calls)
        self.calls = {self._calls[pattern]: name for pattern, name in calls}
        """The calls with literals, and their event types."""
        letters = [("type", name, Letter(pattern)) for name, pattern in types.items()]
        letters += [("entry", name, letter) for name, letter in entries]
        letters += [("ignored", "", Letter(tree.instantiate(one.on), one.when)) for one in tree.ignores]
        self.letters = letters
        """The numbered letters: types, alphabet entries, and ignored events."""
        self._tests = [
            (reader(number, Letter(one.pattern)).test, reader(number, one).test)
            for number, (_, _, one) in enumerate(letters)
        ]
        """By letter: tests without and with the guard."""
        also = dict.fromkeys(pattern for one in engines for pattern in one.patterns)
        self.patterns = (*(one.pattern for _, _, one in letters), *also)
        self.shapes = PatternIndex(self.patterns, self._table)
        self.late = EventKind(classes=(EventClass(),) * len(engines))
        self.late.entries, self.late.relevant = True, None  # counted only
        reads = TreeReads(tree)
        self.discriminators: Discriminators = reads.discriminators
        self.read = reads.patterns
        """The patterns that a reader of logs selects events by."""
        self.others: dict[str, dict[str, None]] = {}
        """By discriminating field: texts of irrelevant events, at most `OTHERS`."""
        self.impossible: set[tuple[Hashable, ...]] = set()
        """Discriminating values of irrelevant events that are noted; such events have no near misses."""
        self._texts: dict[str, frozenset[Json] | None] = {}
        """The literals of a field if every pattern has a text in it."""
        self._meant: dict[str, dict[Json, Json]] = {field: {} for field in self.discriminators.fields}
        for pattern in reads.patterns:
            for name, value in pattern.fields if isinstance(pattern, ObjectPattern) else ():
                if name in self._meant and isinstance(value, Literal) and isinstance(value.value, str):
                    self._meant[name][spelling(value.value)] = value.value
        fields = ((name, tuple(_leaves(letter.pattern))) for name, letter in entries)
        self.compound = tuple(dict.fromkeys(one for one in fields if len(one[1]) > 1))

    def of(self, event: Mapping[str, Json]) -> EventKind:
        """Return the kind of an event."""
        return self.shapes.of(event).of(event)

    def _table(self, decided: Decided) -> GuardTable[EventKind]:
        numbers = [number for number in sorted(chain(*decided)) if number < len(self.letters)]
        tests = [test for number in numbers for test in self._tests[number]]

        def derive(holds: Sequence[bool]) -> EventKind:
            fits = tuple([number for number, found in zip(numbers, holds[::2], strict=True) if found])
            admitted = tuple([number for number, found in zip(numbers, holds[1::2], strict=True) if found])
            return EventKind(fits, admitted, checks=checks.setdefault(fits, WarningChecks()))

        checks: dict[tuple[int, ...], WarningChecks] = {}
        table: GuardTable[EventKind | EventClass] = guard_table(tests, derive)
        possible = {self.patterns[number] for number in chain(*decided)}
        tables = cast("list[GuardTable[EventKind | EventClass]]", [one.table(possible) for one in self._engines])
        return joined_tables([table, *tables], self._joined)

    def _joined(self, found: tuple[EventKind | EventClass, ...]) -> EventKind:
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
        fits = [self.letters[number] for number in made.fits]
        calls = [
            self._calls[letter.pattern] for what, _, letter in fits if what == "entry" and letter.pattern in self._calls
        ]
        made.types = frozenset([*(name for what, name, _ in fits if what == "type"), *calls])
        made.entries = any(self.letters[number][0] == "entry" for number in made.fits)
        made.serves = any(one.serving or one.breaking for one in made.classes)
        return made

    @cached_property
    def nothing(self) -> EventKind:
        """The kind of an event that matches no pattern."""
        return self.shapes.result(Decided((), ())).of({})

    def possible(self, values: Iterable[Hashable]) -> bool:
        """Whether such events may match, up to spelling."""
        values = tuple(values)
        meant = {
            field: self._meant[field].get(spelling(value), value) if isinstance(value, str) else None
            for field, value in zip(self.discriminators.fields, values, strict=True)
        }
        possible = bool(self.discriminators.candidates(self.discriminators.values(meant)))
        if not possible or meant != dict(zip(self.discriminators.fields, values, strict=True)):
            self.note(values)
        return possible

    def note(self, values: Iterable[Hashable]) -> None:
        """Note the discriminating values of an irrelevant event."""
        for name, value in zip(self.discriminators.fields, values, strict=True):
            self._note(name, value)

    def _note(self, name: str, value: Hashable) -> None:
        known = self.others.setdefault(name, {})
        meant = self._meant.get(name, {}).values()
        if isinstance(value, str) and brief([value]) and len(known) < OTHERS and value not in meant:
            known[cut(value)] = None

    def may_be(self, field: str, text: str) -> bool:
        """Whether this text may match, up to spelling."""
        if field not in self._texts:
            literals = [literals_of(pattern).get(field) for pattern in self.read]
            texts = frozenset(spelling(one) for one in literals if isinstance(one, str))
            self._texts[field] = texts if all(isinstance(one, str) for one in literals) else None
        known = self._texts[field]
        if known is None or spelling(text) in known:
            return True
        self._note(field, text)
        return False


@dataclass(slots=True)
class NearMissCount:
    """Events that match an event type in all fields but one.

    `expected` is the pattern of that field, `found` its value in the `first` event (None if
    missing). With `more` similar events were not examined.
    """

    type: str
    field: Path
    expected: str
    found: str | None
    first: str
    count: int = 0
    more: bool = False


class Statistics:
    """Counts for the events of one tree.

    `tally` counts relevant events by their set of types; `seen` has the types that occurred.
    """

    def __init__(self, types: EventTypeIndex) -> None:
        self.types = types
        self.names = types.names
        self.events = 0
        self.tally: Counter[tuple[str, ...]] = Counter()
        self.near_misses: dict[tuple[str, Path], NearMissCount] = {}
        self.seen: set[str] = set()
        self.others = types.others
        self._looked_at: Counter[tuple[Hashable, ...]] = Counter()
        self._missed: dict[tuple[Hashable, ...], list[NearMissCount]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Return the counts without the tree."""
        return {name: value for name, value in vars(self).items() if name != "types"}

    def attach(self, types: EventTypeIndex) -> None:
        """Attach the tree, after unpickling."""
        self.types = types
        _join(types.others, self.others)
        self.others = types.others

    def add(
        self, event: Mapping[str, Json], number: int, prefix: str = "", event_kind: EventKind | None = None
    ) -> bool:
        """Count an event and return whether it is relevant."""
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

    def are_impossible(self, events: Sequence[Mapping[str, Json]]) -> bool:
        """Whether events that match no entry of the alphabet are known to be no near misses."""
        fields = self.types.discriminators.fields
        columns = [[event.get(field) for event in events] for field in fields]
        try:
            found = set(zip(*columns, strict=True)) if fields else {()}
        except TypeError:  # a list or an object
            return False
        return all(self.types.discriminators.apart(values) in self.types.impossible for values in found)

    @property
    def relevant(self) -> Counter[str]:
        """The number of relevant events by type."""
        found: Counter[str] = Counter()
        for names, count in self.tally.items():
            found.update(dict.fromkeys(names, count))
        return found

    @property
    def never_seen(self) -> tuple[str, ...]:
        """The missing event types in tree order."""
        return tuple(name for name in self.names if name not in self.seen)

    @property
    def never_called(self) -> tuple[str, ...]:
        """The calls with a literal that no event fits, of event types that occur."""
        never = self.never_seen
        return tuple(call for call, name in self.types.calls.items() if call not in self.seen and name not in never)

    def merge(self, other: "Statistics") -> None:
        """Add the counts of a later trace."""
        self.events += other.events
        self.tally.update(other.tally)
        self.seen |= other.seen
        _join(self.others, other.others)
        for name, miss in other.near_misses.items():
            known = self.near_misses.get(name, replace(miss, count=0))
            self.near_misses[name] = replace(known, count=known.count + miss.count, more=known.more or miss.more)

    def _look_at(self, event: Mapping[str, Json], place: str) -> None:
        discriminators = self.types.discriminators
        values = discriminators.apart(map(event.get, discriminators.fields))
        if values in self.types.impossible:
            return
        self.types.note(values)
        if not self.types.compound or not self.types.possible(values):
            if len(self.types.impossible) < MOST:
                self.types.impossible.add(values)
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


def _join(others: dict[str, dict[str, None]], more: Mapping[str, Mapping[str, None]]) -> None:
    for name, values in more.items():
        known = others.setdefault(name, {})
        known.update(dict.fromkeys([value for value in values if value not in known][: OTHERS - len(known)]))


def spelling(text: Json) -> Json:
    """Return a normalised text: `/Command` and `command` are equal."""
    return text.strip("/ ").casefold() if isinstance(text, str) else text


def _leaves(pattern: Pattern) -> Iterator[tuple[Path, Pattern]]:
    agenda: list[tuple[Path, Pattern]] = [((), pattern)]
    while agenda:
        path, part = agenda.pop()
        if isinstance(part, ObjectPattern) and part.fields:
            agenda.extend(((*path, name), inner) for name, inner in reversed(part.fields))
        else:
            yield path, part


def _only_miss(
    leaves: Iterable[tuple[Path, Pattern]], event: Json, discriminating: Sequence[str]
) -> tuple[Path, Pattern, str | None] | None:
    """Return the only differing field, its pattern and its value, if there is only one.

    An event that differs in a discriminating field is of another type, unless it is a misspelling.
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
        misspelt = isinstance(expected, Literal) and spelling(expected.value) == spelling(found)
        if len(path) == 1 and path[0] in discriminating and not misspelt:
            return None
        miss = path, expected, None if found is UNSEEN else cut(json.dumps(found, ensure_ascii=False))
    return miss
