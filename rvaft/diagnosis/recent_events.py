"""The recent events of a run, for near misses while it goes on and at its end."""

from collections import deque
from typing import NamedTuple

from rvaft.diagnosis.near_misses import EVENTS, SHOWN, NearMiss, NearMissSearch
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.stream.listeners import Listener
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.support.wording import listing


class Closest(NamedTuple):
    """Near misses, closest first, each with its trace or key and a line, and notes on what was not looked for."""

    found: tuple[tuple[MonitoredTrace, NearMiss, str], ...]
    notes: tuple[str, ...]


class RecentEvents(Listener):
    """The last relevant events of a run, of all traces and keys, for near misses."""

    concerned = True

    def __init__(self) -> None:
        self._events: deque[tuple[MonitoredTrace, int, Json]] = deque(maxlen=EVENTS)

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """Keep a relevant event."""
        self._events.append((watch, number, event))

    def change(self, change: VerdictChange) -> None:
        """Keep an event that changed a verdict."""
        if not change.passed:
            self.event(change.watch, change.number, change.event)

    def closest(self) -> Closest:
        """Return the near misses of traces and keys without a detection."""
        logs: dict[int, list[tuple[int, Json]]] = {}
        watches: dict[int, MonitoredTrace] = {}
        for watch, number, event in self._events:
            if not watch.monitors.found[0].notified and watch.monitors.verdicts[0] is not Verdict.TRUE:
                watches[id(watch)] = watch
                logs.setdefault(id(watch), []).append((number, event))
        if not watches:
            return Closest((), ())
        known, monitors = list(watches.values()), next(iter(watches.values())).monitors
        tree, numbered = monitors.columns[0].part, list(logs.values())
        found = NearMissSearch(tree, monitors.semantics, numbered).result(SHOWN)
        lines = tuple((known[one.log], one, one.line(tree, dict(numbered[one.log]))) for one in found.found)
        few = len(self._events) == EVENTS
        notes = [f"near misses are looked for among the last {EVENTS:,} relevant events"] if few else []
        if found.skipped:
            notes.append(f"not all near misses were looked for, which takes too long: {listing(found.skipped)}")
        return Closest(lines, tuple(notes))
