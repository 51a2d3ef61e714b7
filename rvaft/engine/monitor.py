"""The engine as a monitor."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from datetime import date, datetime, timedelta
from math import inf
from typing import Any, Final, Self

from rvaft.core.restriction import property_of
from rvaft.engine.compiled_tree import NOTHING, EventClass, Inert, Reading, TreeLetters
from rvaft.engine.explanation import together
from rvaft.engine.selection import strategy_of
from rvaft.engine.strategy import BatchEvent, Noted, Strategy
from rvaft.errors import OptionError, WrongType
from rvaft.model.event_time import JUMPS, Jump, TimeFormat
from rvaft.model.tree import RVAFT, resolve_repetition
from rvaft.model.values import SCALARS, Json, as_json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DEFAULT_BRANCHES, DEFAULT_LIMIT, Ended, Explanation, Monitor, Pending, twin

_UNKNOWN: Final = Verdict.UNKNOWN
_new: Final = tuple.__new__  # twice as fast as the constructor


class Engine(Monitor):
    """The default monitor of a tree; for one branch or kind, pass the restricted tree.

    Raises `TooLarge` beyond `limit` partial matches, kept events, or steps through shared choices.
    `strategy` replaces that of the tree. With `repeat_by`, a `Repetition` restarts only the matches with the
    detected value of this variable; raises `OptionError` if some event does not bind it.

    >>> import rvaft
    >>> monitor = Engine(rvaft.loads("top sand a b;"))
    >>> [monitor.step({"event": name}).symbol for name in "ab"], monitor.explanation.events
    (['?', '⊤'], {'a': [1], 'b': [2]})
    """

    def __init__(
        self,
        tree: RVAFT,
        semantics: Semantics | str | None = None,
        *,
        limit: int = DEFAULT_LIMIT,
        strategy: Strategy | None = None,
        repeat_by: str | None = None,
    ) -> None:
        super().__init__()
        self.tree = tree
        self.semantics = Semantics(semantics or tree.semantics or Semantics.PROJECTED)
        self._projects = self.semantics.projects
        self._position = 0
        self._latest: int | None = None
        self.jumps: tuple[Jump, ...] = ()
        """The last jumps of the maximum event time."""
        self._explanation: Explanation | None = None
        self._ended: Ended | None = None
        self._limit = limit
        self._read_time = None if tree.time is None else tree.time.reader()
        self._may_be_late = tree.time is not None and tree.time.late is not None
        if strategy is None:
            prop = property_of(tree)
            if repeat_by is not None:
                prop.require_shared(repeat_by, self.semantics)
            strategy = strategy_of(prop, self.semantics, limit=limit, repeat_by=repeat_by)
        self._strategy = strategy
        self._repeat_by = repeat_by

    def snapshot(self) -> dict[str, object]:
        """Return the state for `restore`; it can be pickled."""
        return {**vars(self), "tree": None, "_read_time": None, "_strategy": self._strategy.snapshot()}

    def restore(self, snapshot: dict[str, object]) -> None:
        """Continue from a snapshot of the same tree; this monitor must be new."""
        own = {"tree": self.tree, "_read_time": self._read_time, "_strategy": self._strategy}
        vars(self).update({**snapshot, **own})
        self._strategy.restore(snapshot["_strategy"])
        self.reach(self._latest)

    def __getstate__(self) -> dict[str, object]:
        """Return the tree and the state, without the compiled tree."""
        return {**self.snapshot(), "tree": self.tree}

    def __setstate__(self, state: dict[str, Any]) -> None:
        by = state["_repeat_by"]
        Engine.__init__(self, state["tree"], state["semantics"], limit=state["_limit"], repeat_by=by)
        self.restore(state)

    @property
    def letters(self) -> TreeLetters:
        """The letters of the tree."""
        return self._strategy.letters

    @property
    def read(self) -> Callable[[Mapping[str, Json], EventClass], Reading]:
        """The function from an event and its class to a reading."""
        return self._strategy.read

    def inert(self, event_class: EventClass) -> Inert | None:
        """Return which events of a class change nothing until another event is read, for bulk
        reading.

        None means that each event must be read.
        """
        return self._strategy.inert(event_class)

    @property
    def sees_irrelevant(self) -> bool:
        """Whether an irrelevant event may change the verdict if it matches a pattern."""
        return self._strategy.sees_irrelevant

    @property
    def sees_times(self) -> bool:
        """Whether the time of any event may change the verdict."""
        return self._strategy.sees_times

    @property
    def deadline(self) -> float:
        """The least time after which a later time changes the verdict; infinite if there is none."""
        return inf if self.verdict.final else self._strategy.deadline

    @property
    def joins(self) -> bool:
        """Whether events are joined with many partial matches."""
        return self._strategy.joins

    @property
    def noted(self) -> bool:
        """Whether the last event may be in a match; False is certain."""
        return self._strategy.noted

    def take(self, reading: Reading, position: int | None = None) -> Verdict:
        """As `step`, for an event already read; `position` is its number if events were skipped."""
        self._read += 1
        if self._verdict is _UNKNOWN:
            self._position = self._position + 1 if position is None else position
            self._verdict = self._strategy.advance(reading, self._position)
        return self._verdict

    def take_all(self, events: Iterator[BatchEvent], noted: Noted) -> BatchEvent | None:
        """Read events, none late, up to the first that changes the verdict, and return it; None at the end."""
        found = self._strategy.advance_all(events, noted, projects=self._projects)
        if found is None:
            return None
        self._verdict, one = found
        self._position = one[0]
        return one

    def take_one(self, one: BatchEvent, noted: Noted) -> Verdict:
        """As `take_all`, for one event; return the verdict after it."""
        verdict = self._strategy.advance_to(one, noted, self._projects)
        if verdict is not _UNKNOWN:
            self._verdict, self._position = verdict, one[0]
        return verdict

    def skip(self, count: int) -> Verdict:
        """As `step`, for `count` events without a match."""
        if count > 0 and self._verdict is _UNKNOWN:
            # Under `strict` the first event ends a match; otherwise no such event changes anything.
            self._verdict = self._strategy.advance(NOTHING, self._position + 1)
            self._position += 1 if self._verdict.final else count
        self._read += count
        return self._verdict

    def step(self, event: Json) -> Verdict:
        """Read an event and return the verdict; raises `TraceError` for other JSON."""
        if type(event) is not dict or self._verdict is not _UNKNOWN or self._may_be_late:
            return super().step(self._as_json(event) if isinstance(event, Mapping) else event)
        if not SCALARS.issuperset(map(type, event.values())):
            event = self._as_json(event)
        self._read += 1  # the fast path for most events
        self._position += 1
        strategy = self._strategy
        reading = strategy.read(event, strategy.letters.classify(event))
        verdict = self._verdict = strategy.advance(reading, self._position)
        return verdict

    def _as_json(self, event: Mapping[str, Json]) -> Mapping[str, Json]:
        """Return an event with JSON values; raises `WrongType` for an instant or a length of time in another format."""
        made = as_json(event)
        if made is not event and self.tree.time is not None and self._read_time is not None:
            given = self.tree.time.written(event)
            kind, form = type(given).__name__, self.tree.time.format
            instant = isinstance(given, date) or kind == "datetime64"
            length = isinstance(given, timedelta) or kind == "timedelta64"  # converted to nanoseconds
            if (instant and self._read_time(made) is None) or (length and form is not TimeFormat.NANOSECONDS):
                field = ".".join(self.tree.time.field)
                raise WrongType(f"the time {field} of an event", given, f"a value that the tree reads `as {form}`")
        return made

    def go_on_after(self, earlier: Self) -> None:
        """Continue after another engine of the same tree; this engine must be new."""
        super().go_on_after(earlier)
        self._position, self.jumps = earlier._position, earlier.jumps
        self._strategy.go_on_after(earlier._strategy)
        self.reach(earlier._latest)

    def restarted(self, fresh: Self) -> Self:
        """Return the engine that goes on after this one has detected."""
        if self._repeat_by is None:
            return super().restarted(fresh)
        made = self.fork()
        made.restart()
        return made

    def restart(self) -> None:
        """Go on after a detection, without the matches that have the detected value."""
        assert self._repeat_by is not None, "made to repeat by a variable"
        self._verdict, self._explanation = _UNKNOWN, None
        self._strategy.restart(self._repeat_by)

    def is_late(self, event: Json, number: int = 0, line: int | None = None) -> bool:
        """Whether an event is late (semantics, section 1.1); call it once per event, in order.

        A caller of `take` passes late events to `skip` instead. `jumps` have the numbers and lines of events.
        """
        return self.pass_event(None if self._read_time is None else self._read_time(event), number, line)

    def pass_event(self, time: int | None, number: int = 0, line: int | None = None) -> bool:
        """As `is_late`, for an event with this time."""
        own, latest = self.tree.time, self._latest
        if own is None or own.late is None or time is None:
            return False
        if latest is not None and time <= latest:
            return latest - time > own.late
        self.jumps = own.jumped(self.jumps, number, latest, time, line)
        self.reach(time)
        return False

    def pass_events(
        self,
        latest: Sequence[int | None],
        numbers: Sequence[int],
        places: Sequence[int],
        line: Callable[[int], int | None],
    ) -> None:
        """As `pass_event`, for the events at these places of columns with the maximum times up to them.

        `line` returns the line of the event with a number, or None if it is that number.
        """
        allowed = 0 if self.tree.time is None else self.tree.time.late or 0
        before, new, found = self._latest, latest[places[-1]], list[Jump]()
        last, at = new, len(places)
        if last is None:
            return
        if before is not None and last - before <= allowed:
            at = 0
        while at and new is not None and len(found) < JUMPS:  # from the last, since few are remembered
            at -= 1
            old = latest[places[at - 1]] if at else before
            if old is None or new - old > allowed:
                number = numbers[places[at]]
                found.append(_new(Jump, (number, old, new, line(number))))
            new = old
        self.jumps = (*self.jumps, *reversed(found))[-JUMPS:]
        self.reach(last)

    @property
    def until(self) -> float:
        """The greatest time of an event that can detect together with those so far (see `Strategy.until`)."""
        return inf if self.verdict.final else self._strategy.until

    @property
    def latest(self) -> int | None:
        """The maximum event time so far in nanoseconds, if the tree has `late`."""
        return self._latest

    def pass_time(self, time: Json | datetime) -> Verdict:
        """Return the verdict after a time has come, without an event; raises `OptionError` for no time."""
        if self.tree.time is None:
            raise OptionError("the tree has no time of events: add `time FIELD as FORMAT;`")
        now = self.tree.time.now(time)
        if self._verdict is _UNKNOWN and self._may_be_late and (self._latest is None or self._latest < now):
            self.reach(now)
        return self.decide(now)

    def decide(self, time: int) -> Verdict:
        """Return the verdict after a time in nanoseconds, which makes no event late."""
        if self._verdict is _UNKNOWN:
            self._verdict = self._strategy.pass_time(time)
        return self._verdict

    def finish(self) -> Verdict:
        """Return the verdict after the end of the trace, which decides every `for D after`."""
        if self._verdict is _UNKNOWN:
            self._verdict = self._strategy.finish()
        return self._verdict

    def forget(self, watermark: int) -> None:
        """Set the watermark and drop the partial matches that it rules out, before the maximum event time is set."""
        self._strategy.forget(watermark)

    def reach(self, latest: int | None) -> None:
        """Set the maximum event time and drop the partial matches that it rules out."""
        self._latest = latest
        if latest is not None and self.tree.time is not None and self.tree.time.late is not None:
            self._strategy.forget(latest - self.tree.time.late)

    def _advance(self, event: Json) -> Verdict:
        self._position += 1
        if self._may_be_late and self.is_late(event, self._position):
            return self._strategy.advance(NOTHING, self._position)
        return self._strategy.advance(self._strategy.read(event, self.letters.classify(event)), self._position)

    def fork(self) -> Self:
        """Return an independent monitor in the same state."""
        made = twin(self)  # without compiling the tree again
        made._strategy = self._strategy.fork()  # noqa: SLF001 (its own)
        return made

    @property
    def state(self) -> Hashable:
        """Equal states of one tree have equal futures."""
        return self.verdict if self.verdict.final else (self.verdict, self._strategy.state, self._latest)

    @property
    def explanation(self) -> Explanation | None:
        """One match of the lowest-numbered branch that has a match, after ⊤."""
        if self._explanation is None and self.verdict is Verdict.TRUE:
            self._explanation = self._strategy.explain()
        return self._explanation

    def pending(self, *, limit: int = DEFAULT_BRANCHES) -> tuple[Pending, ...]:
        """Return the awaited events of each live branch; raises `TooLarge`."""
        return () if self.verdict.final else self._pending(limit)

    def _pending(self, limit: int, before: int | None = None) -> tuple[Pending, ...]:
        found = self._strategy.pending(limit, before=before)
        of_branch = self.tree.part_of is not None and self.tree.part_of.branch is not None
        if of_branch or len({one.branch for one in found} - {None}) <= limit:
            return found
        return together(found, numbered=False)

    @property
    def ended(self) -> Ended | None:
        """After ⊥, the event that ended the last partial match, and the events awaited before
        it.
        """
        if self._ended is None and self.verdict is Verdict.FALSE:
            waiting = self._pending(DEFAULT_BRANCHES, self._position)
            self._ended = Ended(self._position, waiting)
        return self._ended


def repeating_engine(
    tree: RVAFT, semantics: Semantics, *, limit: int = DEFAULT_LIMIT, repeat: bool = False, by: str | None = None
) -> Engine:
    """Return the engine of a valid tree or part that may be repeated, each value of a variable for itself if
    `by` or the tree names one.
    """
    return Engine(tree, semantics, limit=limit, repeat_by=resolve_repetition(tree, by, repeat=repeat))
