"""The run of one tree over one trace.

A batch in which nothing can change is only counted; otherwise the events are taken one by one.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Final

from rvaft.errors import TooLarge
from rvaft.model.values import JsonObject
from rvaft.readers.log import Batch
from rvaft.stream.batch_steps import BatchSteps
from rvaft.stream.bulk import Groups
from rvaft.stream.statistics import EventKind
from rvaft.stream.trace_progress import KeyValues, Placed, TraceProgress
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange

_NO_EVENT: Final[JsonObject] = {}
"""The stand-in for events that match no pattern."""


class TraceRun(TraceProgress):
    """The run over one trace; a `pipeline` passes it the batches of the trace."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._batches = BatchSteps(self)

    def pass_over(self, total: int, lines: Sequence[int | None] = ()) -> None:
        """Count events that do not concern the tree."""
        self.lines = self.number, lines
        self.number += total
        self.watch.events += total
        if self.totals.statistics is not None:
            self.totals.statistics.events += total

    def process(
        self,
        block: Batch,
        kinds: Mapping[int, EventKind] | None = None,
        found: Groups | None = None,
        *,
        turns: bool = False,
    ) -> Iterator[int]:
        """Process a block as a batch if only counts change, else event by event.

        `kinds` are the kinds of its events by their `id`, and `found` their groups, if they are known.
        With `turns`, the number of an event is yielded before its step, so that runs take turns.
        """
        before = self.number
        self.lines = before, block.lines
        events = block.events if self.keys is None or not block.passed else self._with_new_keys(block)
        monitors = self.plan.monitors
        self.times = self._lateness(block, events)
        together = self.assumes_in_bulk and not (self.audience.each or monitors.counts_all)
        try:
            steps = self._batches.steps(block, events, found, turns=turns) if together and events else None
            if steps is None:
                events = self._with_late(block, events)
                filled = self._filled(events, before) if monitors.counts_all else events
                yield from self._take(filled, before, kinds, turns=turns)
            else:
                yield from steps
                self.number = before + events[-1][0] + 1
            if self.times is not None:
                self._pass_times(self.times, before, block.total - 1)
        except TooLarge:
            if self.keys is None:
                self.watch.events = self.number
            else:
                self._count_passed(block, events, self.number - before - 1)
            raise
        if len(events) < block.total:
            self._pass_over(block, events, before + block.total)
        self.notify_unchanged(self.number)

    def _take(  # noqa: PLR0915
        self,
        events: Iterable[Placed],
        before: int,
        kinds: Mapping[int, EventKind] | None = None,
        *,
        turns: bool = False,
    ) -> Iterator[int]:
        """Step the monitors over events one by one; `before` is the event before place 0.

        `kinds` are known kinds by the `id` of an event. With `turns`, yield the number of an event before
        its step.
        """
        prefix, keys, fresh = self.prefix, self.keys, self.plan.monitors
        each, _, of_concern = self.audience
        skips = fresh.skips_irrelevant
        keyed_by = keys.names[0] if keys is not None and len(keys.names) == 1 else ""
        known = {} if keys is None else keys.known
        types, look_up = fresh.types, fresh.types.shapes.of
        may_be_late, counts_all = fresh.may_be_late, fresh.counts_all
        data_warnings, semantics_hint = self.totals.data_warnings, self.totals.semantics_hint
        statistics, clock, assumed = self.totals.statistics, self.clock, self.assumed
        sees_times = fresh.sees_times
        watch: MonitoredTrace | None = self.watch
        times, late = self.times, False
        served, concerned = list[Placed](), list[Placed]()
        try:
            for place, event in events:
                number = before + place + 1
                if turns:
                    yield number
                self.number = number
                if assumed is not None:
                    data_warnings.note_broken(assumed, event, f"{prefix}event {number}")
                if keys is not None:
                    if sees_times and self._deadlines:
                        self.remember(served)
                        served = []
                        self._pass_to_all(event)
                    value = event.get(keyed_by) if keyed_by else None
                    watch = known.get((value,)) if type(value) is str else None
                    watch = watch or keys.of(event, number)
                if may_be_late and watch is not None:
                    late = self._is_late(watch, place, event) if times is None else place in times.late
                event_kind = kinds.get(id(event), types.nothing) if kinds is not None else look_up(event).of(event)
                if late and watch is not None:
                    event_kind = types.late
                    self.note_late(watch, place, event)
                elif event_kind.checks.looked_at or type(event) is not dict:
                    data_warnings.see(event, number, prefix, event_kind)
                if statistics is not None:
                    if event_kind.noted is statistics and event_kind.relevant is not None:
                        statistics.events += 1
                        statistics.tally[event_kind.relevant] += 1
                    else:
                        statistics.add(event, number, prefix, event_kind)
                if watch is None:
                    continue
                watch.events += 1
                if semantics_hint is not None and event_kind.entries and not late:
                    semantics_hint.keep(id(watch), number, event)
                if event_kind.relevant or counts_all or (event_kind.serves and not skips):
                    monitors = watch.monitors
                    if times is not None:
                        monitors.reach(times.latest(place))
                    changed = monitors.step(event, number, event_kind.classes, late=late)
                    if sees_times and keys is not None:
                        self._note_deadline(watch)
                    if monitors.concerned:
                        concerned.append((number, event))
                    if monitors.serves:
                        served.append((number, event))
                    if changed:
                        self.remember(served)
                        served = []
                        self.notify(VerdictChange(watch, number, event, changed, self.line_of(number)))
                        continue
                    if of_concern and monitors.live and (monitors.concerned or (event_kind.relevant and not skips)):
                        for listener in (*each, *of_concern):
                            listener.event(watch, number, event)
                        continue
                for listener in each:
                    listener.event(watch, number, event)
        except TooLarge:
            self.notify_unchanged(self.number - 1)
            raise
        finally:
            self.remember(served)
            if clock is not None:
                clock.see_all(concerned)

    def _with_new_keys(self, block: Batch) -> Sequence[Placed]:
        """Return the events, with a stand-in for the first of each new key."""
        keys = self.keys
        assert keys is not None, "only events with keys are kept by them"
        new = [values for values in dict.fromkeys(block.kept) if not self._is_known(values)]
        if not new:
            return block.events
        names = [field.text for field in keys.key.fields]
        also = [(block.passed[block.kept.index(values)], dict(zip(names, values, strict=False))) for values in new]
        return sorted([*block.events, *also], key=itemgetter(0))

    def _is_known(self, values: KeyValues) -> bool:
        """Whether this key, or for () its absence, is known."""
        keys = self.keys
        assert keys is not None, "only events with keys are kept by them"
        if values not in keys.known:
            watch = keys.find(values)
            if watch is None and (values or not keys.lacking):
                return False
            keys.known[values] = watch
        return True

    def _count_passed(self, block: Batch, events: Sequence[Placed], end: int) -> None:
        """Count the skipped events before place `end` for their keys."""
        keys = self.keys
        assert keys is not None, "only events with keys are kept by them"
        looked_at = {place for place, _ in events}
        passed = zip(block.passed, block.kept, strict=True)
        for values, number in Counter(key for place, key in passed if place < end and place not in looked_at).items():
            if not self._is_known(values):
                continue
            watch = keys.known[values]
            if watch is None:
                keys.lacking += number
            else:
                watch.events += number

    def _pass_over(self, block: Batch, events: Sequence[Placed], last: int) -> None:
        """Count the skipped events of a block."""
        passed = block.total - len(events)
        if self.plan.monitors.counts_all:
            self._fill(last + 1)
        if self.totals.statistics is not None:
            self.totals.statistics.events += passed
        self.number = last
        if self.keys is None:
            self.watch.events += passed
        else:
            self._count_passed(block, events, block.total)

    def _filled(self, events: Iterable[Placed], before: int) -> Iterator[Placed]:
        """Yield events, after stepping over irrelevant ones."""
        for place, event in events:
            self._fill(before + place + 1)
            yield place, event

    def _fill(self, number: int) -> None:
        """Step monitors over irrelevant events, which `strict` and backends count."""
        monitors = self.watch.monitors
        kind = self.plan.monitors.types.of(_NO_EVENT)
        while monitors.live and self.number + 1 < number:
            self.number += 1
            if changed := monitors.step(_NO_EVENT, self.number, kind.classes):
                self.notify(VerdictChange(self.watch, self.number, _NO_EVENT, changed, self.line_of(self.number)))
