"""What is done with every trace of a run, and what of an event has to be read for it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

from rvaft.core.classifier import TreeReads
from rvaft.readers.json_blocks import JsonBlockReader, exact_time, plain_fields
from rvaft.readers.log import Interest
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.detection import told_fields
from rvaft.stream.keys import Field, Key
from rvaft.stream.monitor_set import MonitorSet
from rvaft.stream.order import DEFAULT_WINDOW
from rvaft.stream.semantics_hint import SemanticsHint
from rvaft.stream.statistics import Statistics

TIME: Final = "time"
"""The field that is watched for going back, in the events that concern the tree."""
MAX_KEYS: Final = 100_000
"""How many values of a key are told apart."""


@dataclass(frozen=True)
class MonitoringPlan:
    """What is done with every trace: `monitors` have read nothing; `also` are fields that somebody else looks at."""

    monitors: MonitorSet
    key: Key | None = None
    max_keys: int = MAX_KEYS
    order_by: str | None = None
    window: int = DEFAULT_WINDOW
    strict_json: bool = False
    also: tuple[Field, ...] = ()

    @property
    def plain(self) -> bool:
        """Whether every event goes to the same monitors, in the order in which it stands."""
        return self.key is None and self.order_by is None

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields of the order, of the key, and those that somebody else looks at."""
        order = () if self.order_by is None else (Field.parse(self.order_by),)
        return (*order, *(self.key.fields if self.key else ()), *self.also)

    @cached_property
    def reads(self) -> TreeReads:
        """What is read of an event."""
        return TreeReads(self.monitors.types.tree, [field.path for field in self.fields])

    @property
    def every(self) -> bool:
        """Whether the time of each event counts; a text of a backend does not say what it makes of times."""
        monitors = self.monitors
        return monitors.may_be_late if monitors.engines else monitors.time is not None

    @cached_property
    def interest(self) -> Interest:
        """What of an event is looked at, where nobody wants to see all of it."""
        also = (name for one in self.fields for name in (one.text, one.path[0]))
        found = Interest.of(self.reads, (TIME, *told_fields(self.monitors.types.tree), *also))
        # What concerns nothing is counted by the key that it has, has its place in the order, and is late or not.
        counted_only = self.plain and not self.every and found.fields is not None
        return replace(found, may_be=self.monitors.types.may_be) if counted_only else found

    @cached_property
    def block_reader(self) -> JsonBlockReader | None:
        """What reads files quickly, or None where every event has to be seen as it stands."""
        # Where every event counts, those that concern nothing would have to be given to the monitors of their keys.
        each = self.key is not None and self.monitors.counts_all
        if each or any(len(field.path) > 1 for field in self.fields):
            return None
        types, names = self.monitors.types, [field.text for field in self.fields]
        possible = (lambda _: True) if self.every else types.possible
        fields, time = plain_fields(self.reads, (TIME, *told_fields(types.tree), *names)), exact_time(types.tree)
        if not fields or time in names:
            return None
        return JsonBlockReader(self.reads, possible, fields, time=time, strict=self.strict_json, kept=names)


@dataclass(slots=True)
class Totals:
    """What several traces held, if that is wanted, what was doubtful about them, and what other semantics makes of those that ended in ⊥."""

    statistics: Statistics | None
    data_warnings: DataWarnings
    semantics_hint: SemanticsHint | None = None

    def merge(self, other: Self) -> None:
        """Add those of later traces."""
        if self.statistics is not None and other.statistics is not None:
            self.statistics.merge(other.statistics)
        self.data_warnings.merge(other.data_warnings)
        if self.semantics_hint is not None and other.semantics_hint is not None:
            self.semantics_hint.merge(other.semantics_hint)
