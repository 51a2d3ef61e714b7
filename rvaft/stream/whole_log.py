"""Whole logs through a query engine: a database selects the events that a match may have, and
counts the others by group. The monitors read the selected events.

An engine is registered in the group of entry points `rvaft.engines`. Where an engine cannot answer
exactly for a log, it raises `Declined`, and the log is read event by event.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Final, NamedTuple, TypeAlias

from rvaft.core.fields_to_read import Scope
from rvaft.errors import OptionError, RvaftError, ToolFailed
from rvaft.model.values import JsonObject
from rvaft.model.values import key as value_key
from rvaft.readers.log import LogReader
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from rvaft.stream.statistics import LOOKED_AT, Statistics
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.support.collector import no_collections
from rvaft.support.plugins import entry_points

GROUP: Final = "rvaft.engines"
FIRST: Final = LOOKED_AT + 1
"""Number of events of a group that statistics look at."""

Place: TypeAlias = tuple[int, int | None, JsonObject]
"""The number, the line and the fields of an event."""


class Declined(RvaftError, RuntimeError):
    """An engine cannot answer exactly for a log.

    >>> print(Declined("an integer of more than 64 bits"))
    an integer of more than 64 bits
    """


class EventCount(NamedTuple):
    """Events of a group: how many, and the numbers of the first ones."""

    total: int
    first: Sequence[int]


class LogAnswer(ABC):
    """What an engine found in a log.

    `groups` match the same patterns and guards, and have the numbers of the `FIRST` events. `keys` are
    the events of each key in order of first occurrence, and `keyless` those without a key, each with
    the first number. `forgotten` counts the keys that are left out (see `KeyedTraces.note_forgotten`).
    `selected` are the numbers of the events that a match may have, in order; the monitors need no
    other. `noted` are the first events with different values in discriminating fields.
    """

    total: int
    groups: Sequence[EventCount]
    keys: Sequence[EventCount]
    keyless: EventCount | None
    forgotten: tuple[int, int, int] = (0, 0, 0)
    first_of_keys: Mapping[int, JsonObject] = {}
    """The first events of the keys by number, once they were counted."""
    noted: Sequence[int]
    selected: Iterable[int]

    def begin(self, buffer: EventBuffer) -> None:
        """Begin to read events; `buffer` is for those of explanations."""
        self.buffer = buffer

    @abstractmethod
    def events(self, numbers: Iterable[int], reads: Scope) -> Iterator[Place]:
        """Yield the events with these increasing numbers; raises `RvaftError` and `OSError`."""

    @abstractmethod
    def of_keys(self) -> Iterator[tuple[int, int]]:
        """Yield the number of each event with a key, and that of the first event of its key."""

    @abstractmethod
    def close(self) -> None:
        """Free the memory of the answer."""


class QueryEngine(ABC):
    """An engine for one monitoring plan.

    `name` is for messages, and `formats` are the names of the readers that it replaces.

    Raises `NotExpressible`, `TooLarge`, `OptionError` and `ToolMissing` for a plan.
    """

    name: ClassVar[str]
    formats: ClassVar[frozenset[str]]
    says_so: ClassVar[bool] = True
    """Whether a run tells that a log is read without the engine."""

    @abstractmethod
    def __init__(self, plan: MonitoringPlan) -> None: ...

    @abstractmethod
    def ask(self, path: Path, reader: LogReader | None) -> LogAnswer:
        """Return what is in a log (JSON Lines without a reader); raises `Declined`."""


def engine_class(name: str) -> type[QueryEngine]:
    """Import the engine of that name; raises `OptionError` and `ToolFailed`."""
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in known:
        raise OptionError(f"unknown engine {name}; known: {', '.join(sorted(known)) or 'none'}")
    try:
        made: type[QueryEngine] = known[name].load()
    except Exception as error:
        reason = f"it cannot be loaded: {type(error).__name__}: {error}"
        raise ToolFailed(f"the engine {name}", reason=reason) from error
    return made


def count(run: TraceRun, answer: LogAnswer) -> None:
    """Add the counts of an answer to the totals of a run.

    Raises `Declined`, without an effect, if an event causes a data warning.
    """
    plan, types = run.plan, run.plan.monitors.types
    if len(answer.keys) > plan.max_keys:
        raise Declined(f"more than {plan.max_keys} keys")
    if answer.forgotten[0] and not run.may_forget_keys:
        raise Declined("keys were forgotten")
    firsts = [group.first[0] for group in answer.keys]
    wanted = sorted({number for group in answer.groups for number in group.first} | {*answer.noted, *firsts})
    events = {number: event for number, _, event in answer.events(wanted, plan.reads)}
    keys = () if plan.key is None else [plan.key.of(events[number]) for number in firsts]
    if len({tuple(map(value_key, key)) for key in keys if key is not None}) < len(keys):
        raise Declined("DuckDB reads a key in another way")
    answer.first_of_keys = {number: events[number] for number in firsts}
    for totals in (Totals(Statistics(types), DataWarnings(types)), run.totals):
        statistics, warnings = totals.statistics, totals.data_warnings
        looked_at = {number for group in answer.groups for number in group.first}
        for number, event in events.items():
            kind = types.of(event)
            if number not in looked_at:
                types.note(event.get(field) for field in types.discriminators.fields)
                continue
            warnings.see(event, number, run.prefix, kind)
            if statistics is not None:
                statistics.add(event, number, run.prefix, kind)
        if totals is not run.totals and warnings.found:
            first = next(iter(warnings.found.values()))
            raise Declined(f"{first.first} causes a warning ({first.reason})")
        for group in answer.groups:
            kinds = {types.of(events[number]).admitted for number in group.first}
            if len(kinds) > 1:
                raise Declined(f"{run.prefix}event {group.first[0]} is not counted with equal events")
            kind, others = types.of(events[group.first[0]]), group.total - len(group.first)
            if statistics is not None and others:
                statistics.events += others
                if kind.entries and kind.relevant is not None:
                    statistics.tally[kind.relevant] += others


def read(run: TraceRun, answer: LogAnswer) -> Iterator[bool]:
    """Step the monitors over the selected events, and pause after each; notify as `run.read` does."""
    run.prepare(one_by_one=run.keys is not None)  # of one trace, all verdicts change at selected events
    answer.begin(run.buffer)
    reads, types, keys = run.plan.reads, run.plan.monitors.types, run.keys
    watch: MonitoredTrace | None = run.watch
    unchanged = _Unchanged(run, answer)
    for number, line, event in answer.events(answer.selected, reads) if run.watch.monitors.live else ():
        run.number, run.lines = number, (number - 1, (line,))
        if keys is not None:
            watch = keys.of(event, number)
        if watch is None or not watch.monitors.live:
            continue
        unchanged.notify(number)
        changed = watch.monitors.step(event, number, types.of(event).classes)
        if watch.monitors.serves:
            watch.buffer.remember(number, event, line)
        if changed:
            unchanged.skip()
            run.notify(VerdictChange(watch, number, event, changed, line))
            if watch is run.watch and not watch.monitors.live:
                break
        yield True
    if keys is not None and answer.forgotten[0]:
        keys.note_forgotten(answer.forgotten)
    run.number = run.watch.events = answer.total
    unchanged.notify(answer.total + 1)
    run.notify_unchanged(answer.total)
    run.ended = True
    yield False


class _Unchanged:
    """The events with a key, for listeners of each event; it begins the monitors of all keys."""

    def __init__(self, run: TraceRun, answer: LogAnswer) -> None:
        keys = run.keys
        self._each, self._watches = run.audience.each, dict[int, MonitoredTrace]()
        self._places = iter(() if keys is None or not self._each else answer.of_keys())
        self._place = next(self._places, None)
        counts = {group.first[0]: group.total for group in answer.keys}
        with no_collections():
            for number, event in answer.first_of_keys.items():
                if keys is not None and (watch := keys.of(event, number)) is not None:
                    self._watches[number], watch.events = watch, counts[number]
        if keys is not None and answer.keyless is not None:
            keys.lacking, (keys.first_lacking, *_) = answer.keyless

    def notify(self, end: int) -> None:
        """Notify listeners of the events before the event `end`."""
        while self._place is not None and self._place[0] < end:
            number, key = self._place
            for listener in self._each:
                listener.event(self._watches[key], number, {})
            self.skip()

    def skip(self) -> None:
        """Go to the next event."""
        self._place = next(self._places, None)
