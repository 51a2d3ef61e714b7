"""What changes of verdicts listeners receive, and the monitored trace that they concern."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import TypeAlias

from rvaft.model.nodes import Kind
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation
from rvaft.stream.detection import matched_events, unlike
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.monitor_set import DetectionCount, MonitorSet, Snapshots

TraceState: TypeAlias = tuple[tuple[Json, ...] | None, Snapshots, int]
"""The key, the state of the monitors, and the number of events."""


@dataclass(slots=True, eq=False)
class MonitoredTrace:
    """The monitors of a trace or key, with the number of their events."""

    trace: str
    monitors: MonitorSet
    key: tuple[Json, ...] | None = None
    buffer: EventBuffer = field(default_factory=EventBuffer)
    events: int = 0
    told: int = 0
    """How often the monitors were told something without an event."""

    @property
    def changes(self) -> int:
        """A number that grows with each change of the state, which only events and what is told make."""
        return self.events + self.told

    @property
    def state(self) -> TraceState:
        """The state for `TraceRun.restore`; it changes only together with `changes`."""
        return self.key, self.monitors.snapshot, self.events


def time_told(time: Json | datetime) -> str:
    """Return how a change names a time that monitors were told."""
    return f"time {time.isoformat() if isinstance(time, datetime) else time}"


class VerdictChange:
    """The verdicts changed by one event; or, after event `number`, by a time or the end, which `passed` names."""

    def __init__(
        self,
        watch: MonitoredTrace,
        number: int,
        event: Json,
        columns: Sequence[int],
        line: int | None = None,
        *,
        passed: str = "",
    ) -> None:
        self.passed = passed
        self.watch = watch
        self.number = number
        self.event = event
        self.line = line
        self.columns = columns
        self.verdicts = watch.monitors.verdicts
        self.detected = [column for column in columns if self.verdicts[column] is Verdict.TRUE]
        self.counts = {column: watch.monitors.found[column] for column in self.detected if watch.monitors.repeat}

    @cached_property
    def explanations(self) -> Mapping[int, Explanation]:
        """The explanations of detecting columns, except for backends."""
        found = {column: self.watch.monitors.explanation(column) for column in self.detected}
        return {column: explanation for column, explanation in found.items() if explanation is not None}

    @cached_property
    def events(self) -> Mapping[int, Json]:
        """The available events in the explanations."""
        own = {} if self.passed else {self.number: self.event}
        return {**self.watch.buffer.events(matched_events(self.explanations.values()) - own.keys()), **own}

    @cached_property
    def lines(self) -> Mapping[int, int | None]:
        """The lines, or rows of a table, of `events` in the input; None if it has no lines."""
        known = {number: self.watch.buffer.line_of(number) for number in self.events}
        return known if self.passed else {**known, self.number: self.line}

    @cached_property
    def detections(self) -> Sequence[tuple[Explanation | None, frozenset[Kind], DetectionCount | None]]:
        """The distinct detections: explanation, kinds of the monitors, and count (with repeat).

        Monitors of branches or kinds replace the monitor of the tree.
        """
        parts = [column for column in self.detected if column] or self.detected
        if parts and not self.explanations:
            return [(None, frozenset(), self.counts.get(parts[0]))]
        found: list[tuple[Explanation | None, frozenset[Kind], DetectionCount | None]] = []
        for columns, explanation in unlike({place: one for place, one in self.explanations.items() if place in parts}):
            wholes = [self.watch.monitors.columns[column].part.part_of for column in columns]
            kinds = frozenset(whole.kind for whole in wholes if whole is not None and whole.kind is not None)
            found.append((explanation, kinds, self.counts.get(columns[0])))
        return found
