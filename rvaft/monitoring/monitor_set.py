"""The monitors of all columns, reading the same events."""

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import islice
from typing import ClassVar, Final, Self

from rvaft.analysis.branches import branches
from rvaft.api import narrowed
from rvaft.engine.monitor import Engine
from rvaft.errors import TooLarge, TreeError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, key
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.event_buffer import Recall
from rvaft.monitoring.near_misses import NearMiss, Path, Statistics
from rvaft.monitoring.stream import Field
from rvaft.monitors import Ended, Explanation, Monitor

# What has a verdict of its own: the tree, and beside it each of its branches or each of its kinds.
#
# These are the options (a), (b) and (c) of the paper, section 4.3, with the names that its Tables 2 and 3 give to the monitors.

MOST: Final = 1_000
"""How many branches are monitored one by one."""


class Per(StrEnum):
    """What has a verdict of its own."""

    TREE = "tree"
    BRANCH = "branch"
    KIND = "kind"


@dataclass(frozen=True, slots=True)
class Column:
    """One monitor: `label` for programs (`tree`, the number of a branch, a kind), `title` for people, and what it monitors."""

    label: str
    title: str
    part: RVAFT


WHOLE: Final = "tree"
"""The label of the first column, which is always there."""


def columns(tree: RVAFT, per: Per = Per.TREE) -> tuple[Column, ...]:
    """The monitor of a tree (or of the part of one), and those of its parts; raises what `parts` raises."""
    return (Column(WHOLE, "φ", narrowed(tree)), *parts(tree, per))


def parts(tree: RVAFT, per: Per) -> Iterator[Column]:
    """The monitors of the branches of a tree, from 1, or of the kinds that it has.

    A part without a feasible scenario, where nothing can ever be detected, has none. Raises `TreeError` for a tree that breaks a rule,
    and `TooLarge` beyond `MOST` branches.
    """
    match per:
        case Per.TREE:
            return
        case Per.BRANCH:
            numbers = [branch.number for branch in islice(branches(tree), MOST + 1)]
            if len(numbers) > MOST:
                error = TooLarge(f"a monitor for each branch of {tree.root}", limit=MOST)
                error.add_note("take one for each kind with --per kind, or one branch with --branch N")
                raise error
            for number in numbers:
                yield from _feasible(tree, str(number), f"φ{number}", branch=number)
        case Per.KIND:
            present = {node.kind for node in tree.top_down()}
            for kind in Kind:
                if kind in present:
                    yield from _feasible(tree, kind.value, kind.value, kind=kind)


def _feasible(
    tree: RVAFT, label: str, title: str, *, branch: int | None = None, kind: Kind | None = None
) -> Iterator[Column]:
    """The monitor of a part; none of one without a feasible scenario, which nothing detects."""
    try:
        yield Column(label, title, narrowed(tree, branch, kind))
    except TreeError as error:
        if error.rule != "no-scenario":
            raise


_UNKNOWN: Final = Verdict.UNKNOWN  # looked up for every event


class Bank:
    """One monitor for each column; the first is that of the whole.

    Events have the numbers that the caller gives them, which rise, and may leave some out: explanations name events by these numbers.
    Raises `TooLarge` as its monitors do.
    """

    def __init__(self, columns: Sequence[Column], make: Callable[[RVAFT], Monitor], semantics: Semantics) -> None:
        self.columns = tuple(columns)
        self.monitors: tuple[Monitor, ...] = tuple(make(column.part) for column in columns)
        self._engines = _engines(self.monitors)
        self.since: dict[int, int] = {}
        """For each column whose verdict is final the number of the event that made it so."""
        self.semantics = semantics
        self._projected = semantics is Semantics.PROJECTED
        self._strict = semantics is Semantics.STRICT
        self.serves = False
        """Whether an explanation may name the last event."""
        self.concerned = False
        """Whether the last event was relevant to the tree, or may be part of a match all the same."""
        self._live = tuple(range(len(self.monitors)))

    def fork(self) -> Self:
        """An independent bank that has read the same events."""
        twin = copy(self)
        twin.monitors = tuple(monitor.fork() for monitor in self.monitors)
        vars(twin)["_engines"] = _engines(twin.monitors)
        twin.since = dict(self.since)
        return twin

    def step(self, event: Json, number: int) -> Sequence[int]:
        """Read one event and return the columns whose verdict it changed."""
        self.serves = False
        engines = self._engines
        if not engines:
            self.concerned = True
            for column in self._live:
                self.monitors[column].step(event)
            return self.changes(number)
        reading = engines[0].read(event)
        concerned = self.concerned = reading.relevant if self._projected else bool(reading.hits)
        if not self._live or not (concerned or self._strict):
            return ()
        if len(engines) == 1:
            final = engines[0].take(reading, number) is not _UNKNOWN
            self.serves = concerned and engines[0].noted
            return self.changes(number) if final else ()
        final = serves = False
        for column in self._live:
            engine = engines[column]
            verdict = engine.take(engine.read(event) if column else reading, number)
            final = final or verdict is not _UNKNOWN
            serves = serves or engine.noted
        self.serves = serves and bool(reading.hits)
        return self.changes(number) if final else ()

    def changes(self, number: int) -> Sequence[int]:
        """The columns whose verdict the event of that number changed, for who has given it to the monitors himself."""
        changed = [column for column in self._live if self.monitors[column].verdict is not Verdict.UNKNOWN]
        if changed:
            self.since.update(dict.fromkeys(changed, number))
            self._live = tuple(column for column in self._live if column not in self.since)
        return changed

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The verdict of each column so far."""
        return tuple(monitor.verdict for monitor in self.monitors)

    @property
    def live(self) -> bool:
        """Whether some verdict may still change."""
        return bool(self._live)

    def explanation(self, column: int) -> Explanation | None:
        """After ⊤ in that column, how it was detected, where the monitor knows the tree."""
        return self.monitors[column].explanation

    def ended(self, column: int) -> Ended | None:
        """After ⊥ in that column, how its last hope ended, where the monitor knows the tree and what it waited for is not too much to say."""
        try:
            return self.monitors[column].ended
        except TooLarge:
            return None


def _engines(monitors: Sequence[Monitor]) -> tuple[Engine, ...]:
    found = tuple(monitor for monitor in monitors if isinstance(monitor, Engine))
    return found if len(found) == len(monitors) else ()


# What is watched, one trace or one key in it, and who is told of it.


@dataclass(slots=True)
class Watch:
    """The monitors of one trace, or of one value of a field in it; `key` is that value, in a tuple since it may be null."""

    trace: str
    bank: Bank
    key: tuple[Json] | None = None
    recall: Recall = field(default_factory=Recall)
    events: int = 0
    """How many events it was given."""


class Listener:
    """Told of what happens to watches; does nothing with it.

    With `every` it is told of every event, else only of those that change a verdict: what reads events quickly need not stop for the
    others.
    """

    every: ClassVar[bool] = False

    def begin(self, watch: Watch) -> None:
        """A trace begins, or the first event of a key came."""

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """The event of that number was read and changed the verdicts of these columns."""

    def end(self, watch: Watch) -> None:
        """The trace ends, and was not malformed."""

    def stop(self, watch: Watch) -> None:
        """The trace was malformed, or could not be read further: no event and no end comes any more."""


# One stream that holds the events of many: a bank of monitors for each value of a field.

MAX_KEYS: Final = 100_000
"""How many values of a field are told apart."""


class Keyed:
    """The watches of one trace by the values of a field; values are told apart as everywhere: 1 and 1.0 are one, true is another.

    `fresh` has read nothing; each value gets a copy. Raises `TooLarge` beyond `limit` values.
    """

    def __init__(self, field: Field, fresh: Watch, *, limit: int = MAX_KEYS) -> None:
        self.field = field
        self.limit = limit
        self.without = 0
        """How many events do not have the field."""
        self.first_without = 0
        """The number of the first of them."""
        self._fresh = fresh
        self._watches: dict[Hashable, Watch] = {}

    def __iter__(self) -> Iterator[Watch]:
        """The watches in the order in which their keys came."""
        return iter(self._watches.values())

    def of(self, event: Json, number: int) -> tuple[Watch | None, bool]:
        """The watch that an event is for, None for one without the field, and whether it is new."""
        found = self.field.of(event)
        if found is None:
            self.without += 1
            self.first_without = self.first_without or number
            return None, False
        name = key(found[0])
        watch = self._watches.get(name)
        if watch is not None:
            return watch, False
        if len(self._watches) >= self.limit:
            error = TooLarge(f"different values of {self.field.text}", limit=self.limit)
            error.add_note("raise it with --max-keys N, or name another field")
            raise error
        fresh = self._fresh
        watch = self._watches[name] = Watch(fresh.trace, fresh.bank.fork(), found, fresh.recall)
        return watch, True

    def add(self, watch: Watch) -> None:
        """A watch with a key that goes on from before."""
        assert watch.key is not None
        self._watches[key(watch.key[0])] = watch


# What traces hold in all, where they were read apart from each other.


@dataclass(slots=True)
class Totals:
    """The counts of `Statistics` without what it takes to count; can be sent to another process."""

    types: tuple[str, ...] = ()
    events: int = 0
    relevant: Counter[str] = field(default_factory=Counter)
    never_seen: Sequence[str] = ()
    near_misses: dict[tuple[str, Path], NearMiss] = field(default_factory=dict)

    @classmethod
    def of(cls, statistics: Statistics) -> Self:
        """The counts so far."""
        counted = statistics.relevant, statistics.never_seen, statistics.near_misses
        return cls(statistics.types, statistics.events, *counted)

    def add(self, other: "Totals") -> None:
        """Add the counts of a later trace of the same tree."""
        if not self.types:
            self.types, self.never_seen = other.types, other.types
        self.events += other.events
        self.relevant = self.relevant + other.relevant
        unseen = set(other.never_seen)
        self.never_seen = [name for name in self.never_seen if name in unseen]
        for name, miss in other.near_misses.items():
            known = self.near_misses.get(name, replace(miss, count=0))
            self.near_misses[name] = replace(known, count=known.count + miss.count, more=known.more or miss.more)
