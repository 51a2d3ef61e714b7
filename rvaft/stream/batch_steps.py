"""Steps over many events at once, where only some of them can change a state."""

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain, repeat
from math import inf
from operator import length_hint
from typing import Final, cast

from rvaft.engine.compiled_tree import EventClass
from rvaft.engine.strategy import BatchEvent, Noted
from rvaft.errors import TooLarge
from rvaft.model.values import JsonObject
from rvaft.readers.log import Batch
from rvaft.stream.bulk import EventGroup, Groups, changes_nothing, groups, needs_no_warning
from rvaft.stream.keys import KeyedBatch, KeyedTraces
from rvaft.stream.trace_progress import KeyValues, Placed, TraceProgress
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange

FEW: Final = 32
"""Smaller blocks are not batches; also the maximum pause after failures."""


class BatchSteps:
    """Tries the batches of a run; after a failure, it does not try the next ones."""

    def __init__(self, run: TraceProgress) -> None:
        self.run = run
        self._tries = self._pause = 0

    def steps(
        self, block: Batch, events: Sequence[Placed], found: Groups | None, *, turns: bool
    ) -> Iterator[int] | None:
        """Return the steps over events as a batch: none if no event can change the state.

        Return None if an event may cause a warning, or if a listener needs each. After a failure the next
        blocks are not tried; the pause doubles up to `FEW` blocks.
        """
        self._tries -= 1
        keyed_by = "" if self.run.keys is None or len(self.run.keys.names) != 1 else self.run.keys.names[0]
        if len(events) < FEW or self._tries > 0 or (self.run.keys is not None and not keyed_by):
            return None
        self._pause = self._tries = min(2 * self._pause + 1, FEW)
        bodies = [event for _, event in events]
        monitors, time = self.run.watch.monitors, self.run.plan.monitors.time
        if set(map(type, bodies)) != {dict}:
            return None
        keys = list(zip([event.get(keyed_by) for event in bodies], strict=True)) if keyed_by else []
        if keyed_by and {str} != set(map(type, chain.from_iterable(keys))):
            return None
        late: Collection[int] = () if self.run.times is None else self.run.times.late
        of_keys = None
        if self.run.keys is not None:
            before = self.run.lines[0]
            contiguous = len(events) == block.total
            numbers = (
                range(before + 1, before + 1 + block.total) if contiguous else [before + 1 + at for at, _ in events]
            )
            of_keys = KeyedBatch(self.run.keys.known, keys, numbers)
        if of_keys is not None and monitors.may_be_late and time is not None:
            late = self._timed(of_keys, time.of_all(time.written_in(bodies)))
        if late:
            found, bodies = None, [event for place, event in events if place not in late]
        if found is None:
            found = groups(self.run.plan.monitors.types, bodies)
        if found is None or (late and self.run.assumed is not None):
            return None
        concerned, stepped = list[EventGroup](), False
        timed = of_keys is not None and bool(of_keys.times) and None not in of_keys.times
        for event_kind, group in found:
            if not needs_no_warning(self.run.totals.data_warnings, group, event_kind, timed=timed):
                return None
            if self.run.assumed is not None and not self.run.assumed.is_kept(group):
                return None
            fits = changes_nothing(monitors, group, event_kind, keyed=bool(keyed_by))
            if fits is not False and (monitors.live or self.run.clock is not None):
                stepped = stepped or fits is None
                concerned.append(group)
        # an event that can extend no partial match may be relevant all the same: the run reports it one by one
        relevant = not monitors.skips_irrelevant and any(kind.relevant for kind, _ in found)
        if (concerned or relevant) and self.run.audience.of_concern and monitors.live:
            return None
        self._pause = self._tries = 0
        batch = list[BatchEvent]()
        if stepped:
            projects = monitors.semantics.projects
            some = [(kind, group) for kind, group in found if kind.relevant or (kind.serves and not projects)]
            batch = self._batch(some, events, of_keys)
        elif self.run.clock is not None and concerned:
            self.run.clock.see_all(_numbered(concerned, events, self.run.lines[0]))
        if self.run.keys is None or of_keys is None:
            steps = self._steps_of_one(block, events, batch, turns=turns)
        else:
            steps = self._steps_of_keys(self.run.keys, events, of_keys, late, batch, turns=turns)
        return self._counted(steps, found, events, late)

    def _batch(self, some: Groups, events: Sequence[Placed], of_keys: KeyedBatch | None) -> list[BatchEvent]:
        """Return the events of some groups for the strategies, in order."""
        first, time, times = self.run.lines[0] + 1, self.run.plan.monitors.time, self.run.times
        if time is not None and of_keys is not None and of_keys.times:
            allowed, classes = time.late or 0, dict[int, Sequence[EventClass]]()
            for event_kind, group in some:
                classes.update(dict.fromkeys(map(id, group.events), event_kind.classes))
            of = classes.get
            return [
                (first + at, event, own, now, None if most is None else most - allowed)
                for (at, event), now, most in zip(events, of_keys.times, of_keys.latest, strict=True)
                if (own := of(id(event)))
            ]
        about = dict[int, tuple[Sequence[EventClass], int | None]]()
        for event_kind, group in some:
            known = repeat(None) if time is None else group.times(time)
            about.update(zip(map(id, group.events), zip(repeat(event_kind.classes), known, strict=False), strict=False))
        find = about.get
        if time is None or times is None:
            return [(first + at, event, *found, None) for at, event in events if (found := find(id(event)))]
        allowed, latest = time.late or 0, times.latest
        return [
            (first + at, event, *found, None if (most := latest(at, found[1])) is None else most - allowed)
            for at, event in events
            if (found := find(id(event)))
        ]

    def _steps_of_one(
        self, block: Batch, events: Sequence[Placed], batch: Sequence[BatchEvent], *, turns: bool
    ) -> Iterator[int]:
        """Step over a batch, which has no late events, and warn of those of the block."""
        before, monitors, end = self.run.lines[0], self.run.watch.monitors, -inf
        coming, noted, read = iter(batch), Noted([], []), 0
        changed: Sequence[int] = (0,) if batch else ()
        try:
            while changed:
                try:
                    changed = monitors.step_all(coming, noted)
                finally:
                    read = len(batch) - length_hint(coming)
                    self.run.number = batch[read - 1][0] if read else self.run.number
                if changed:
                    if turns:
                        yield self.run.number
                    self.run.remember(noted.served)
                    noted, one = Noted(noted.concerned, []), batch[read - 1]
                    if self.run.times is not None:
                        monitors.reach(self.run.times.latest(self.run.number - before - 1, one[3]))
                    self.run.notify(
                        VerdictChange(
                            self.run.watch, self.run.number, one[1], changed, self.run.line_of(self.run.number)
                        )
                    )
            end = inf
        except TooLarge:
            if turns:
                yield self.run.number
            self.run.notify_unchanged(self.run.number - 1)
            raise
        finally:
            self.run.remember(noted.served)
            if self.run.clock is not None:
                self.run.clock.see_all([one[:2] for one in noted.concerned])
            late = () if self.run.times is None else [*self.run.times.late]
            known = dict(events) if late else {}
            for place in late:
                if before + place < max(end, self.run.number):
                    event = known[place] if place in known or block.times is None else block.times.event(place)
                    self.run.note_late(self.run.watch, place, event)

    def _timed(self, batch: KeyedBatch, times: Sequence[int | None]) -> set[int]:
        """Add these times of its events to a batch, and return the places of those that are late."""
        batch.times = batch.latest = times
        if self.run.keyed_times.rises(times):
            self.run.keyed_times.greatest = cast("int", times[-1])
            return set()
        assert self.run.keys is not None, "only keys have times of their own"
        time, known, latest_at, late = (
            self.run.plan.monitors.time,
            dict[KeyValues, int | None](),
            list[int | None](),
            set[int](),
        )
        allowed = 0 if time is None else time.late or 0
        for place, (key, now) in enumerate(zip(batch.keys, times, strict=True)):
            if key not in known:
                watch = self.run.keys.known.get(key) or self.run.keys.find(key)
                known[key] = None if watch is None else self.run.keyed_times.latest(watch)
            latest = known[key]
            if now is not None:
                if latest is None or now > latest:
                    known[key] = latest = now
                elif latest - now > allowed:
                    late.add(place)
            latest_at.append(latest)
        batch.latest = latest_at
        self.run.keyed_times.greatest = max([self.run.keyed_times.greatest, *(one for one in times if one is not None)])
        return late

    def _pass(self, batch: KeyedBatch, end: int) -> None:
        """Count the events of a batch before an index for their keys, and note their times."""
        start, traces = batch.done, batch.pass_to(end)
        numbers = batch.numbers[start:end]
        if batch.latest and traces:
            self.run.keyed_times.add(traces, numbers, batch.latest[start:end], self.run.lines)
        else:
            for trace, number, time in zip(traces, numbers, batch.times[start:end], strict=False):
                trace.monitors.engines[0].pass_event(time, *self.run.numbered(number - self.run.lines[0] - 1))

    def _steps_of_keys(
        self,
        keys: KeyedTraces,
        events: Sequence[Placed],
        of_keys: KeyedBatch,
        late: Collection[int],
        batch: Sequence[BatchEvent],
        *,
        turns: bool,
    ) -> Iterator[int]:
        """Step over a batch, which has no late events, with the monitors of keys.

        Besides these events, only the late ones and the first of each key are looked at one by one.
        """
        (name,), known, numbers, noted = keys.names, keys.known, of_keys.numbers, Noted([], [])
        stops = of_keys.stops(late)
        try:
            for one in chain(batch, (None,)):
                while stops and (one is None or numbers[stops[0]] <= one[0]):
                    at = stops.popleft()
                    place, event = events[at]
                    self._pass(of_keys, at)
                    if of_keys.keys[at] not in known:
                        self.run.number, forgotten = numbers[at], keys.forgotten
                        if turns:
                            yield self.run.number
                        keys.of(event, self.run.number)
                        if keys.forgotten > forgotten:
                            of_keys.latest = ()
                            stops = of_keys.stops(late, at + 1)
                    if place in late:
                        self._pass(of_keys, at + 1)
                        watch = known[of_keys.keys[at]]
                        assert watch is not None, "each event has a key"
                        self.run.keyed_times.settle(watch)
                        self.run.note_late(watch, place, event)
                if one is None:
                    break
                self.run.number = number = one[0]
                watch = known[one[1][name],]
                assert watch is not None, "each event has a key"
                try:
                    changed = watch.monitors.step_one(one, noted)
                except TooLarge:
                    self._pass(of_keys, bisect_right(numbers, number))
                    raise
                if changed:
                    self._pass(of_keys, bisect_right(numbers, number))
                    if turns:
                        yield number
                    self.run.remember(noted.served)
                    noted = Noted(noted.concerned, [])
                    self.run.notify(VerdictChange(watch, number, one[1], changed, self.run.line_of(number)))
            self._pass(of_keys, len(events))
        except TooLarge:
            if turns:
                yield self.run.number
            self.run.notify_unchanged(self.run.number - 1)
            raise
        finally:
            self.run.remember(noted.served)
            if self.run.clock is not None:
                self.run.clock.see_all([one[:2] for one in noted.concerned])

    def _counted(
        self, steps: Iterator[int], found: Groups, events: Sequence[Placed], late: Collection[int]
    ) -> Iterator[int]:
        """Yield the steps over events, and count those that came; those at some places are late."""
        before, failed = self.run.lines[0], True
        try:
            yield from steps
            failed = False
        finally:
            if failed:
                events = [one for one in events if before + one[0] < self.run.number and self._watch_of(one[1])]
            if failed or late:
                types = self.run.plan.monitors.types
                behind = [event for place, event in events if place in late]
                events = [one for one in events if one[0] not in late]
                found = [*(groups(types, [event for _, event in events]) or ()), (types.late, EventGroup(behind))]
            self._count(found, events, before)

    def _count(self, found: Groups, events: Sequence[Placed], before: int) -> None:
        """Count events that cause no warning."""
        statistics, hint = self.run.totals.statistics, self.run.totals.semantics_hint
        if statistics is not None:
            others = list[EventGroup]()
            for event_kind, group in found:
                if not (event_kind.entries or statistics.are_impossible(group.events)):
                    others.append(group)
                    continue
                statistics.events += len(group.events)
                statistics.seen |= event_kind.types
                if event_kind.entries and event_kind.relevant is not None:
                    statistics.tally[event_kind.relevant] += len(group.events)
            for number, event in _numbered(others, events, before) if others else ():
                statistics.add(event, number, self.run.prefix)
        if self.run.keys is None:
            self.run.watch.events += sum(len(group.events) for _, group in found)
        if hint is None:
            return
        watches = {id(self.run.watch)} if self.run.keys is None else {id(self._watch_of(event)) for _, event in events}
        if not all(map(hint.is_full, watches)):
            read = [group for kind, group in found if kind.entries and kind is not self.run.plan.monitors.types.late]
            for number, event in _numbered(read, events, before):
                hint.keep(id(self._watch_of(event)), number, event)

    def _watch_of(self, event: JsonObject) -> MonitoredTrace | None:
        """Return the monitored trace of an event, or None for a new key."""
        keys = self.run.keys
        return self.run.watch if keys is None else keys.known.get((event[keys.names[0]],))


def _numbered(some: Iterable[EventGroup], events: Iterable[Placed], before: int) -> list[Placed]:
    wanted = {id(event) for one in some for event in one.events}
    return [(before + place + 1, event) for place, event in events if id(event) in wanted]
