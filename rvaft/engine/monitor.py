"""The engine as a monitor."""

from collections.abc import Callable, Hashable, Mapping
from math import inf
from typing import Any, Final, Self

from rvaft.core.passes import property_of
from rvaft.engine.compiled_tree import NOTHING, EventClass, Inert, Reading, TreeLetters
from rvaft.engine.explanation import together
from rvaft.engine.selection import strategy_of
from rvaft.engine.strategy import Strategy
from rvaft.model.event_time import Jump
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DEFAULT_BRANCHES, DEFAULT_LIMIT, Ended, Explanation, Monitor, Pending

_UNKNOWN: Final = Verdict.UNKNOWN


class Engine(Monitor):
    """The default monitor of a tree; for one branch or kind, pass the restricted tree.

    Raises `TooLarge` beyond `limit` partial matches, kept events, or steps through shared choices.
    `strategy` replaces that of the tree.

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
    ) -> None:
        super().__init__()
        self.tree = tree
        self.semantics = Semantics(semantics or tree.semantics or Semantics.PROJECTED)
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
            strategy = strategy_of(property_of(tree), self.semantics, limit=limit)
        self._strategy = strategy

    def snapshot(self) -> dict[str, object]:
        """Return the state for `restore`; it can be pickled."""
        return {**vars(self), "tree": None, "_read_time": None, "_strategy": self._strategy.snapshot()}

    def restore(self, snapshot: dict[str, object]) -> None:
        """Continue from a snapshot of the same tree; this monitor must be new."""
        own = {"tree": self.tree, "_read_time": self._read_time, "_strategy": self._strategy}
        vars(self).update({**snapshot, **own})
        self._strategy.restore(snapshot["_strategy"])
        self.pass_time(self._latest)

    def __getstate__(self) -> dict[str, object]:
        """Return the tree and the state, without the compiled tree."""
        return {**self.snapshot(), "tree": self.tree}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Engine.__init__(self, state["tree"], state["semantics"], limit=state["_limit"])
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
            return super().step(event)
        self._read += 1  # the fast path for most events
        self._position += 1
        strategy = self._strategy
        reading = strategy.read(event, strategy.letters.classify(event))
        verdict = self._verdict = strategy.advance(reading, self._position)
        return verdict

    def go_on_after(self, earlier: Self) -> None:
        """Continue after another engine of the same tree; this engine must be new."""
        super().go_on_after(earlier)
        self._position, self.jumps = earlier._position, earlier.jumps
        self.pass_time(earlier._latest)

    def is_late(self, event: Json, number: int = 0) -> bool:
        """Whether an event is late (semantics, section 1.1); call it once per event, in order.

        A caller of `take` passes late events to `skip` instead. `jumps` have the numbers of events.
        """
        own = self.tree.time
        if own is None or own.late is None or self._read_time is None:
            return False
        late, latest = own.is_late_at(self._read_time(event), self._latest)
        if latest != self._latest:
            self.jumps = own.jumped(self.jumps, number, self._latest, latest)
            self.pass_time(latest)
        return late

    @property
    def until(self) -> float:
        """The greatest time of an event that can detect together with those so far (see `Strategy.until`)."""
        return inf if self.verdict.final else self._strategy.until

    @property
    def latest(self) -> int | None:
        """The maximum event time so far in nanoseconds, if the tree has `late`."""
        return self._latest

    def pass_time(self, latest: int | None) -> None:
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
        twin = object.__new__(type(self))  # without compiling the tree again
        vars(twin).update({**vars(self), "_strategy": self._strategy.fork()})
        return twin

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
