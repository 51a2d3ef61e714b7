"""The fields of events that a tree reads; others need not be decoded."""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from typing import TypeAlias

from rvaft.core.pattern_index import Discriminators
from rvaft.model.assumptions import fields_read
from rvaft.model.event_time import EventTime
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json


@dataclass(slots=True)
class Reads:
    """The parts of a value to read: the whole value, or some fields and list items."""

    whole: bool = False
    fields: dict[str, "Reads"] = dataclass_field(default_factory=dict)
    items: "Reads | None" = None

    def add(self, pattern: Pattern) -> None:
        """Add the parts that a pattern reads; a variable reads the whole value."""
        agenda: list[tuple[Reads, Pattern]] = [(self, pattern)]
        while agenda:
            reads, part = agenda.pop()
            match part:
                case ObjectPattern(fields):
                    agenda.extend((reads.fields.setdefault(name, Reads()), inner) for name, inner in fields)
                case ListPattern(items):
                    reads.items = reads.items or Reads()
                    agenda.extend((reads.items, inner) for inner in items)
                case SomeItem(item):
                    reads.items = reads.items or Reads()
                    agenda.append((reads.items, item))
                case Variable():
                    reads.whole = True
                case Literal() | Anything():
                    pass

    def of(self, event: Mapping[str, Json]) -> "Reads":  # noqa: ARG002 (the same in every event)
        """Return the parts of an event to read."""
        return self


class TreeReads:
    """The fields that a monitor reads: those of runtime events, `ignore`, `time`, assumptions and
    the paths `also`. `others` are further trees that are monitored on the same log.
    """

    def __init__(
        self, tree: RVAFT, also: Iterable[tuple[str, ...]] = (), *, others: Iterable["TreeReads"] = ()
    ) -> None:
        more = tuple(others)
        own = (
            *(relevant.pattern for relevant in tree.alphabet),
            *(tree.instantiate(ignore.on) for ignore in tree.ignores),
            *(pattern for _, _, pattern in tree.absences),
        )
        self.patterns: tuple[Pattern, ...] = (*own, *(pattern for one in more for pattern in one.patterns))
        each = [Discriminators(own), *(one.discriminators for one in more)]
        known = dict.fromkeys(name for one in each for name in one.fields) if more else ()
        self.discriminators: Discriminators = Discriminators(self.patterns, known)
        times = [*([tree.time] if tree.time else []), *(time for one in more for time in one.times)]
        self.times: tuple[EventTime, ...] = tuple(dict.fromkeys(times))
        self.always: list[Pattern] = [ObjectPattern(((name, Anything()),)) for name in self.discriminators.fields]
        self.always += [pattern for one in more for pattern in one.always]
        for path in dict.fromkeys((*also, *([tree.time.field] if tree.time else []), *fields_read(tree))):
            at: Pattern = Variable("_")
            for name in reversed(path):
                at = ObjectPattern(((name, at),))
            self.always.append(at)
        self._known: dict[tuple[Hashable, ...], Reads] = {}

    def of(self, event: Mapping[str, Json]) -> Reads:
        """Return the parts of an event to read."""
        return self.where(self.discriminators.values(event))

    def where(self, values: tuple[Hashable, ...]) -> Reads:
        """Return the parts to read of events with these discriminating values."""
        known = self._known.get(values)
        if known is None:
            known = self._known[values] = Reads()
            for pattern in self.always:
                known.add(pattern)
            for number in self.discriminators.candidates(values):
                known.add(self.patterns[number])
        return known


Scope: TypeAlias = Reads | TreeReads
