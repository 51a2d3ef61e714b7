"""The settings of monitoring that all traces of a run share, and the sums over all traces."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

from rvaft.core.fields_to_read import TreeReads
from rvaft.model.assumptions import AssumptionCheck
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.keys import MAX_DISTINCT, MAX_KEYS, Field, Key
from rvaft.stream.monitor_set import MonitorSet
from rvaft.stream.order import DEFAULT_WINDOW
from rvaft.stream.semantics_hint import SemanticsHint
from rvaft.stream.statistics import Statistics

TIME: Final = "time"
"""The time field of a tree that declares none, for the warning about order."""


@dataclass(frozen=True)
class MonitoringPlan:
    """How each trace is monitored; `monitors` are fresh, `also` are fields for other readers.

    An event is skipped if its `distinct` fields have the values of an event before it.
    """

    monitors: MonitorSet
    key: Key | None = None
    max_keys: int = MAX_KEYS
    order_by: str | None = None
    window: int = DEFAULT_WINDOW
    strict_json: bool = False
    also: tuple[Field, ...] = ()
    distinct: Key | None = None
    max_distinct: int = MAX_DISTINCT

    @property
    def plain(self) -> bool:
        """Whether the same monitors read all events in reading order."""
        return self.key is None and self.order_by is None

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of the order, the key and the id, and those in `also`."""
        order = () if self.order_by is None else (Field.parse(self.order_by),)
        of_keys = (field for key in (self.key, self.distinct) if key is not None for field in key.fields)
        return (*order, *of_keys, *self.also)

    @cached_property
    def reads(self) -> TreeReads:
        """The parts of an event that are read."""
        return TreeReads(self.monitors.types.tree, [field.path for field in self.fields])

    def has_checked_events(self, check: AssumptionCheck) -> bool:
        """Whether a reader of possibly relevant events reads all events whose assumptions are checked."""
        found = self.reads.discriminators
        return check.is_flat and all(found.candidates(found.values(literals)) for literals in check.literals)


@dataclass(slots=True)
class Totals:
    """The sums over several traces."""

    statistics: Statistics | None
    data_warnings: DataWarnings
    semantics_hint: SemanticsHint | None = None

    def merge(self, other: Self) -> None:
        """Add the totals of later traces."""
        if self.statistics is not None and other.statistics is not None:
            self.statistics.merge(other.statistics)
        self.data_warnings.merge(other.data_warnings)
        if self.semantics_hint is not None and other.semantics_hint is not None:
            self.semantics_hint.merge(other.semantics_hint)
