"""Which parts of an event a tree reads.

The fields that tell event types apart are read in every event; what their values leave possible decides what else is read.
"""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from rvaft.discriminators import Discriminators
from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.tree import RVAFT
from rvaft.values import Json


@dataclass(slots=True)
class Reads:
    """Which parts of a value are read: all of it, or these fields and the items of a list."""

    whole: bool = False
    fields: dict[str, "Reads"] = field(default_factory=dict)
    items: "Reads | None" = None

    def add(self, pattern: Pattern) -> None:
        """Read also what this pattern looks at. A variable looks at a whole value: values are compared deeply."""
        agenda: list[tuple[Reads, Pattern]] = [(self, pattern)]
        while agenda:
            reads, part = agenda.pop()
            match part:
                case ObjectPattern(fields):
                    agenda.extend((reads.fields.setdefault(name, Reads()), inner) for name, inner in fields)
                case ListPattern(items):
                    reads.items = reads.items or Reads()
                    agenda.extend((reads.items, inner) for inner in items)
                case Variable():
                    reads.whole = True
                case Literal() | Anything():
                    pass

    def of(self, event: Mapping[str, Json]) -> "Reads":  # noqa: ARG002 (the same in every event)
        """What is read of an event."""
        return self


class Scope(Protocol):
    """Says of an event what is read of it."""

    def of(self, event: Mapping[str, Json]) -> Reads:
        """What is read of an event."""


class TreeReads:
    """What a monitor of the tree reads: what its runtime events and `ignore` declarations mention; and these paths of fields."""

    def __init__(self, tree: RVAFT, also: Iterable[tuple[str, ...]] = ()) -> None:
        self.patterns = (
            *(relevant.pattern for relevant in tree.alphabet),
            *(tree.instantiate(ignore.on) for ignore in tree.ignores),
        )
        self.discriminators = Discriminators(self.patterns)
        self._always = (
            *(ObjectPattern(((name, Anything()),)) for name in self.discriminators.fields),
            *(_at(path) for path in also),
        )
        self._known: dict[tuple[Hashable, ...], Reads] = {}

    def of(self, event: Mapping[str, Json]) -> Reads:
        """What is read of an event."""
        return self.where(self.discriminators.values(event))

    def where(self, values: tuple[Hashable, ...]) -> Reads:
        """What is read of events that have these values in the discriminating fields."""
        known = self._known.get(values)
        if known is None:
            known = self._known[values] = Reads()
            for pattern in self._always:
                known.add(pattern)
            for number in self.discriminators.candidates(values):
                known.add(self.patterns[number])
        return known


def _at(path: tuple[str, ...]) -> Pattern:
    """Looks at the whole value at a path of fields."""
    pattern: Pattern = Variable("_")
    for name in reversed(path):
        pattern = ObjectPattern(((name, pattern),))
    return pattern


def reads_of(tree: RVAFT) -> TreeReads:
    """What a monitor of the tree reads."""
    return TreeReads(tree)
