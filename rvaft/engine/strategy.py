"""The interface of a strategy: how the engine follows the matches of a tree."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from math import inf
from typing import Any, ClassVar, Final, NamedTuple, Self, TypeAlias

from rvaft.engine.compiled_tree import QUIET, CompiledTree, EventClass, Inert, Reading, TreeLetters
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation, Pending


class Progress(NamedTuple):
    """The progress of some partial matches, for coverage.

    - `taken`: the positions of the events of the nodes taken.
    - `dead`: the nodes whose guards failed.
    - `unfit`: the nodes that need an event beside those taken, or that no scenario has.
    - `ended`: the nodes whose part can have no more events.
    - `broken`: windows over shared nodes that need one if two elements are below them.
    - `exact`: whether all nodes taken belong to one scenario.
    - `awaited`: the names of the awaited nodes of the partial match with only the given nodes.
    """

    taken: Mapping[int, int]
    dead: Collection[int] = ()
    unfit: Collection[int] = ()
    ended: Collection[int] = ()
    broken: Collection[tuple[int, int, int]] = ()
    exact: bool = True
    awaited: Callable[[Collection[int]], Collection[str]] = lambda _: ()


BatchEvent: TypeAlias = tuple[int, Mapping[str, Json], Sequence[EventClass], int | None, int | None]
"""An event of a batch: its number, the event, its class in each column (the first for this strategy), its time,
and the minimum time of later events. The times are None if not known. Tuples without names are made faster.
"""


class Noted(NamedTuple):
    """The events of a batch that a reading did not skip, and those that may be in a match."""

    concerned: list[BatchEvent]
    served: list[BatchEvent]


_UNKNOWN: Final = Verdict.UNKNOWN


class Strategy(ABC):
    """The state of a monitor: all that it remembers of the events so far.

    The engine classifies an event by `letters`, reads it, and advances. After a final verdict it
    does not advance again.
    """

    letters: TreeLetters
    """The letters of the tree."""
    noted: bool
    """Whether the last event may be in a match; False is certain."""
    joins: ClassVar[bool] = False
    """Whether events are joined with many partial matches."""
    sees_irrelevant: ClassVar[bool] = False
    """Whether an irrelevant event may change a verdict if it matches a pattern."""
    sees_times: bool = False
    """Whether the time of any event may change a verdict."""

    @abstractmethod
    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the reading of an event in the current state."""

    @abstractmethod
    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""

    def advance_all(
        self, events: Iterator[BatchEvent], noted: Noted, *, projects: bool
    ) -> tuple[Verdict, BatchEvent] | None:
        """Read events up to the first that changes the verdict, and return both; None at the end.

        If the semantics `projects`, irrelevant events are skipped. Raises what `advance` raises; then `events`
        stands after the event.
        """
        take = self.advance_to
        for one in events:
            verdict = take(one, noted, projects)
            if verdict is not _UNKNOWN:
                return verdict, one
        return None

    def advance_to(self, one: BatchEvent, noted: Noted, projects: bool) -> Verdict:
        """As `advance_all`, for one event."""
        number, event, classes, _, watermark = one
        if watermark is not None:
            self.forget(watermark)
        verdict, reading = _UNKNOWN, self.read(event, classes[0])
        if reading is not QUIET:
            if not (reading.relevant if projects else reading.hits):
                return _UNKNOWN
            verdict = self.advance(reading, number)
            if self.noted and reading.hits:
                noted.served.append(one)
        noted.concerned.append(one)
        return verdict

    def inert(self, event_class: EventClass) -> Inert | None:  # noqa: ARG002
        """Return which events of a class change nothing until another event is read.

        None means that each event must be read.
        """
        return None

    def forget(self, watermark: int) -> None:  # noqa: B027 (most need not)
        """Set the watermark, the minimum time of later events, and drop what it rules out."""

    def pass_time(self, time: int) -> Verdict:  # noqa: ARG002 (most look at events only)
        """Return the verdict after the time has come, without an event."""
        return Verdict.UNKNOWN

    @property
    def deadline(self) -> float:
        """The least time after which `pass_time` changes the state; infinite if there is none."""
        return inf

    def finish(self) -> Verdict:
        """Return the verdict after the end of the trace."""
        return Verdict.UNKNOWN

    def restart(self, name: str) -> None:
        """Go on after a detection: forget the partial matches with the values of a variable in the matches.

        The strategy was made to repeat by this variable.
        """
        raise NotImplementedError(f"made to repeat by {name}")

    def go_on_after(self, earlier: Self) -> None:  # noqa: B027 (most look at no earlier event)
        """Remember what earlier events of the trace may rule out; this strategy must be new."""

    @property
    def until(self) -> float:
        """The greatest time of an event with which those so far can be in a match.

        It is infinite if not known, and -infinite if no event so far can be in a match.
        """
        return inf

    @abstractmethod
    def fork(self) -> Self:
        """Return an independent copy."""

    @property
    @abstractmethod
    def state(self) -> Hashable:
        """Equal states of one tree have equal futures."""

    @abstractmethod
    def snapshot(self) -> object:
        """Return the state for `restore` as plain data, which a checkpoint pickles.

        That is values, tuples, lists, dicts, sets and frozensets, and `Verdict`.
        """

    @abstractmethod
    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same tree."""

    @abstractmethod
    def explain(self) -> Explanation:
        """Return one match of the lowest-numbered branch that has a match, after ⊤.

        Its branch is None if the search takes too long.
        """

    @abstractmethod
    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:
        """Return the awaited events of each live branch.

        `before` selects the state before the event at this position, which ended the last partial
        match. Beyond `limit` branches, all branches are joined.
        """


class Measured(Strategy):
    """A strategy whose partial matches coverage can compare."""

    compiled: CompiledTree

    @abstractmethod
    def progress(self) -> Iterable[Progress]:
        """Return the progress of the partial matches, without those with equal futures."""
