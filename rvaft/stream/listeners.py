"""Listeners, which are notified of the events and verdicts of a run."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange


class Listener:
    """A listener that ignores all notifications.

    With `every` it receives every event, with `concerned` relevant events while a verdict may
    change, after those with `every`; else only events that change a verdict. With `whole` these
    events have all fields. Without `whole`, and with a single trace, `events` reports a range of
    events instead of `event` each.
    """

    every = False
    concerned = False
    whole = False
    each_key = True
    """Whether it needs all keys at the end, also those that have detected nothing."""
    reported_before = 0
    """The last event whose detections an earlier run reported."""

    def begin(self, watch: MonitoredTrace) -> None:
        """Called when a trace begins, or at the first event of a key."""

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """Called with an event that changed no verdict, if `every` or `concerned`."""

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:
        """Called with a range of events that did not change these verdicts, if `every`."""

    def change(self, change: VerdictChange) -> None:
        """Called when an event changed verdicts."""

    def end(self, watch: MonitoredTrace) -> None:
        """Called at the regular end of a trace."""

    def stop(self, watch: MonitoredTrace) -> None:
        """Called when a trace cannot be read further."""


class Audience(NamedTuple):
    """The listeners for events without a change: for each, for ranges, for relevant events."""

    each: Sequence[Listener]
    in_rows: Sequence[Listener]
    of_concern: Sequence[Listener]

    @classmethod
    def of(cls, listeners: Iterable[Listener], *, one_by_one: bool) -> "Audience":
        """Sort listeners; `one_by_one` excludes ranges."""
        found = list(listeners)
        every = [listener for listener in found if listener.every]
        each = [listener for listener in every if listener.whole or one_by_one]
        in_rows = [listener for listener in every if listener not in each]
        return cls(each, in_rows, [one for one in found if one.concerned and not one.every])
