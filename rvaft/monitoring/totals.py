"""What traces hold in all, where they were read apart from each other."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

from rvaft.statistics import NearMiss, Path, Statistics


@dataclass(slots=True)
class Totals:
    """The counts of `Statistics` without what it takes to count; can be sent to another process."""

    types: tuple[str, ...] = ()
    events: int = 0
    relevant: Counter[str] = field(default_factory=Counter)
    never_seen: Sequence[str] = ()
    near_misses: dict[tuple[str, Path], NearMiss] = field(default_factory=dict)

    @classmethod
    def of(cls, statistics: Statistics) -> Self:
        """The counts so far."""
        counted = statistics.relevant, statistics.never_seen, statistics.near_misses
        return cls(statistics.types, statistics.events, *counted)

    def add(self, other: "Totals") -> None:
        """Add the counts of a later trace of the same tree."""
        if not self.types:
            self.types, self.never_seen = other.types, other.types
        self.events += other.events
        self.relevant = self.relevant + other.relevant
        unseen = set(other.never_seen)
        self.never_seen = [name for name in self.never_seen if name in unseen]
        for name, miss in other.near_misses.items():
            known = self.near_misses.get(name, replace(miss, count=0))
            self.near_misses[name] = replace(known, count=known.count + miss.count, more=known.more or miss.more)
