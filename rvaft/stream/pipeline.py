"""The way of an event: from a source in batches, in time order, to the runs of the trees it concerns.

    source → batch → order → classification → step → listeners

Several trees share all of it up to the classification. Each has a run of its own, with its monitors,
counts and listeners. Listeners are notified in the order of events, and at one event in that of trees.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from heapq import merge
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Final, TypeVar, cast

import msgspec

from rvaft.core.fields_to_read import TreeReads
from rvaft.errors import RvaftError, TooLarge
from rvaft.model.values import Json, JsonObject
from rvaft.readers.json_lines import NonFiniteEvent, marked
from rvaft.readers.log import Batch
from rvaft.stream.bulk import Groups
from rvaft.stream.dispatch import Dispatch
from rvaft.stream.order import NUMBERS, Place
from rvaft.stream.run import TraceRun
from rvaft.stream.sources import LogReading, Source, reading_of
from rvaft.stream.statistics import EventKind
from rvaft.stream.trace_progress import KeyValues, Placed, Turn

WHOLE: Final = 1_000_000
"""Maximum number of events of a log that backends read as a whole."""
T = TypeVar("T")
Failed = Callable[[TraceRun, RvaftError], None]
"""Receives a run whose monitors have failed; it gets no further events."""


def read(
    runs: Sequence[TraceRun],
    source: Source,
    name: str,
    *,
    line: int = 1,
    by_blocks: bool = True,
    live: bool = False,
    jobs: int = 1,
    log: Path | None = None,
    failed: Failed | None = None,
) -> Iterator[bool]:
    """Pass all events of a source to the runs of one trace, and pause after each batch.

    Yields False once the trace has ended; held-back events follow. The options are those of
    `LogReading.batches`. Without `failed`, the error of a run is raised. Raises what the source raises,
    after the events before it.
    """
    reading = reading_of(tuple(run.plan for run in runs))
    batches = reading.batches(runs, source, name, line=line, by_blocks=by_blocks, live=live, jobs=jobs, log=log)
    whole = not live and not all(run.plan.monitors.engines for run in runs)
    return Pipeline(runs, reading, failed, single=live or not by_blocks).read(batches, whole=whole)


class Pipeline:
    """Passes batches to the runs of one trace; `single` events that were held back are batches of their own."""

    def __init__(
        self, runs: Sequence[TraceRun], reading: LogReading, failed: Failed | None = None, *, single: bool = False
    ) -> None:
        self._runs, self._single = runs, single
        self._failed = failed
        by_time: dict[object, list[TraceRun]] = {}
        for run in runs:
            by_time.setdefault(None if run.ordering is None else run.ordering.time, []).append(run)
        for run in runs[1:]:
            run.distinct, run.leads = runs[0].distinct, False
        self._lanes = [_Lane(own, reading, self._fail) for own in by_time.values()]

    def _fail(self, run: TraceRun, error: RvaftError) -> None:
        if self._failed is None:
            raise error
        self._failed(run, error)

    def read(self, batches: Iterable[Batch], *, whole: bool = False) -> Iterator[bool]:
        """Process batches, pausing after each; yield False once the trace has ended.

        If `whole`, all events are held in memory, and announced to the monitors.
        """
        for run in self._runs:
            run.prepare()
        turns = self._turns(batches)
        for due in self._announced(turns) if whole else turns:
            steps = [step for lane, block in due for step in lane.steps(block)]
            deque(steps[0] if len(steps) == 1 else merge(*steps), maxlen=0)
            if not any(lane.runs for lane in self._lanes):
                return
            yield bool(due)

    def _turns(self, batches: Iterable[Batch]) -> Iterator[list[tuple["_Lane", Batch]]]:
        """Yield the blocks that are due together, none at the end of the log; an error comes last."""
        failure = None
        try:
            for block in batches:
                new = self._distinct(block)
                yield [(lane, lane.due(new)) for lane in self._lanes if lane.runs]
        except (RvaftError, OSError) as error:
            failure = error
        else:
            yield []
        for run in self._runs:
            run.ended = True
        rests = [(lane, lane.rest(1 if self._single else None)) for lane in self._lanes]
        for number in range(max(len(blocks) for _, blocks in rests)):
            yield [(lane, blocks[number]) for lane, blocks in rests if number < len(blocks)]
        if failure is not None:
            raise failure

    def _distinct(self, block: Batch) -> Batch:
        """Return a block without the events whose ids came before."""
        distinct = self._runs[0].distinct
        if distinct is None:
            return block
        lines = block.lines or [None] * block.total
        new = [(lines[place], event) for place, event in block.events if distinct.is_new(event, lines[place])]
        numbered = [(place, event) for place, (_, event) in enumerate(new)]
        return Batch(len(new), numbered, lines=[line for line, _ in new] if block.lines else ())

    def _announced(self, turns: Iterator[list[tuple["_Lane", Batch]]]) -> Iterator[list[tuple["_Lane", Batch]]]:
        """Yield the same, after announcing all events to the monitors; an error comes last."""
        held: list[list[tuple[_Lane, Batch]]] = []
        failure: Exception | None = None
        count = 0
        try:
            for turn in turns:
                held.append(turn)
                count += sum(block.total for _, block in turn[:1])
                if count > WHOLE:
                    raise TooLarge("events for monitors of backends", limit=WHOLE, remedy="omit --backend")
        except (RvaftError, OSError) as error:
            failure = error
        for lane in self._lanes:
            events = [event for turn in held for one, block in turn if one is lane for _, event in block.events]
            for run in lane.runs:
                run.expect(events)
        yield from held
        if failure is not None:
            raise failure


class _Lane:
    """The runs that read the events in the same order."""

    def __init__(self, runs: Sequence[TraceRun], reading: LogReading, fail: Failed) -> None:
        self.runs = list(runs)
        self._fail = fail
        self._shared = len(reading.plans) > 1
        """Whether other trees read the same events."""
        self._dispatch: Dispatch | None = None
        if len(runs) == len(reading.plans):
            self._dispatch = reading.dispatch
        elif len(runs) > 1:
            self._dispatch = Dispatch([run.plan.monitors.types for run in runs])
        self._numbers = {id(run): number for number, run in enumerate(runs)}
        for run in runs[1:]:
            run.ordering = runs[0].ordering

    def due(self, block: Batch) -> Batch:
        """Return the events that are due after a block, with the values of keys as tuples."""
        plan, ordering = self.runs[0].plan, self.runs[0].ordering
        if plan.plain:
            return block
        places: Sequence[Json] = block.kept
        keys: Sequence[KeyValues] = [()] * len(places)
        if plan.key is not None:
            found = block.kept
            if ordering is not None:
                places, found = [values[0] for values in found], [values[1:] for values in found]
            elif len(plan.key.fields) == 1:
                found = [(value,) for value in found]
            keys = [() if msgspec.UNSET in values else values for values in found]
        return block._replace(kept=keys) if ordering is None else self._ordered(block, places, keys)

    def _ordered(self, block: Batch, values: Sequence[Json], others: Sequence[KeyValues]) -> Batch:
        """Add the events of a block to the order and return the events that are due.

        `values` and `others` are the order fields and the stand-ins of the irrelevant events.
        """
        ordering = self.runs[0].ordering
        assert ordering is not None
        own: list[JsonObject | KeyValues] = [event for _, event in block.events]
        lines = block.lines or [None] * block.total
        came = list(zip(lines, _in_places(block, others, own), strict=True))
        places: list[Place | None]
        if ordering.time is None and ordering.holds_times is False and NUMBERS.issuperset(map(type, values)):
            places = _in_places(block, values, [ordering.place(event) for _, event in block.events])
        else:  # the first value fixes the type of the field
            known, name = dict(zip(block.passed, values, strict=True)), ordering.field.text
            stand_ins = ({name: known[place]} if place in known else one for place, (_, one) in enumerate(came))
            places = list(map(ordering.place, stand_ins))
        return _block_of(ordering.put_all(places, came))

    def rest(self, most: int | None) -> list[Batch]:
        """Return the events that were held back, at the end of the trace, in batches of at most so many."""
        ordering = self.runs[0].ordering if self.runs else None
        turns = [] if ordering is None else list(ordering.rest())
        size = most or len(turns) or 1
        return [_block_of(turns[start : start + size]) for start in range(0, len(turns), size)]

    def steps(self, block: Batch) -> list[Iterator[int]]:
        """Return the steps of the runs over a block, each after the number of its event."""
        if self._dispatch is None:
            parts = [(run, _as_read(block, {}, run.plan.reads)[0] if self._shared else block) for run in self.runs]
            return [self._guarded(run, part, None, None) for run, part in parts]
        events = [event for _, event in block.events]
        found = self._dispatch.classified(events)
        kinds = self._asked(events) if found is None else {}
        pairs = {id(event): (place, event) for place, event in block.events}
        odd = [event for event in events if isinstance(event, NonFiniteEvent)]
        steps = list[Iterator[int]]()
        for run in list(self.runs):
            number = self._numbers[id(run)]
            groups: Groups = () if found is None else found.get(number, ())
            own = kinds.get(number, {}) if found is None else _kinds(groups)
            part = block
            late = run.plan.monitors.may_be_late
            each = run.needs_each or (late and block.times is None)
            if not each:
                chosen = own.keys() | {id(event) for event in odd}
                part = block._replace(events=sorted((pairs[one] for one in chosen), key=itemgetter(0)))
            if odd:
                part, own = _as_read(part, own, run.plan.reads, each=each)
            if each:
                steps.append(self._guarded(run, part, own, None))
            elif part.events or late:
                steps.append(self._guarded(run, part, own, groups if found is not None else None))
            else:
                run.pass_over(block.total, block.lines)
                run.notify_unchanged(run.number)
        return steps

    def _asked(self, events: Sequence[JsonObject]) -> dict[int, dict[int, EventKind]]:
        assert self._dispatch is not None
        kinds: dict[int, dict[int, EventKind]] = {}
        for event in events:
            for number, kind in self._dispatch.kinds(event):
                kinds.setdefault(number, {})[id(event)] = kind
        return kinds

    def _guarded(
        self, run: TraceRun, block: Batch, kinds: Mapping[int, EventKind] | None, groups: Groups | None
    ) -> Iterator[int]:
        """Yield the steps of a run; the others continue after its failure."""
        try:
            yield from run.process(block, kinds, groups, turns=self._shared)
        except RvaftError as error:
            self.runs.remove(run)
            self._fail(run, error)


def _as_read(
    block: Batch, kinds: Mapping[int, EventKind], reads: TreeReads, *, each: bool = True
) -> tuple[Batch, dict[int, EventKind]]:
    """Return a block and its kinds, in which only the numbers that a tree reads are not finite.

    Unless it reads `each` event, the block has only events with a kind or such a number.
    """
    events, found = list[Placed](), dict[int, EventKind]()
    for place, event in block.events:
        own = event
        if isinstance(event, NonFiniteEvent):
            own = marked(deepcopy(dict(event)), reads, kept=False)
            if not (each or isinstance(own, NonFiniteEvent) or id(event) in kinds):
                continue
        events.append((place, own))
        if id(event) in kinds:
            found[id(own)] = kinds[id(event)]
    return block._replace(events=events), found


def _kinds(groups: Groups) -> dict[int, EventKind]:
    return {id(event): kind for kind, group in groups for event in group.events}


def _block_of(turns: Sequence[Turn]) -> Batch:
    lines, events = [line for line, _ in turns], [event for _, event in turns]
    found = [(place, event) for place, event in enumerate(events) if type(event) is not tuple]
    passed = [place for place, event in enumerate(events) if type(event) is tuple]
    kept = [events[place] for place in passed]
    return Batch(len(turns), cast("list[Placed]", found), passed, kept, lines)


def _in_places(block: Batch, others: Sequence[T], own: Sequence[T]) -> list[T]:
    """Merge items of the events and of irrelevant events in order."""
    if len(own) < len(others):
        found = list(others)
        for (place, _), one in zip(block.events, own, strict=True):
            found.insert(place, one)
        return found
    places = chain(block.passed, (place for place, _ in block.events))
    return [one for _, one in sorted(zip(places, chain(others, own), strict=True), key=itemgetter(0))]
