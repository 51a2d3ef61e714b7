"""`scattered` in linear time: every node starts once and is complete once, as early as can be.

Where no variable ties events together and no event can serve two occurrences that stand side by
side, nothing is gained by passing over an event, and what a node can do depends on nothing but when
it starts. So each node is told to start when what precedes it is complete, listens for its event,
and tells its parents when it is complete; a sequence starts its children in turn. Each node starts
and completes at most once, so the total work is linear in the tree, beside the look-up per event.

A shared node starts when all is complete that precedes it through any of its parents, and the first
of its choices that is complete is the choice for all of them: nothing of the choices is followed
but which nodes are complete. `linear_starts` says where this holds.
"""

from collections import Counter
from collections.abc import Callable, Container, Hashable, Iterator, Mapping, Sequence
from copy import copy
from itertools import chain, combinations, product
from typing import Final, NamedTuple, Self, TypeAlias

from rvaft.core.part_numbers import PartKind
from rvaft.core.patterns import Overlaps
from rvaft.engine.compiled_tree import (
    NOTHING,
    QUIET,
    Admission,
    CompiledTree,
    EventClass,
    Hit,
    Inert,
    Reading,
    TreeLetters,
)
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.support.bits import union

MEMORY: Final = 4096
"""Of how many kinds of events it is remembered what they may change."""
EFFORT: Final = 1_000_000
"""How many steps to spend on the question whether two occurrences compete for an event; beyond, the answer is yes."""

Served: TypeAlias = Sequence[tuple[int, Mapping[str, Json]]]
"""The occurrences that an event can serve, and the values each sees."""


Before: TypeAlias = tuple[int, int]
"""What a start waits for: a node and -1, that it is complete; a gate and a number, that so many of
its children are (0: that its own event has come).
"""


class StartConditions(NamedTuple):
    """When each node may start.

    A node starts with its parents, except a later child of a sequence (when those before it are
    complete) and a child of a gate whose own event comes first (when that has come). Whatever
    precedes a node's event is found along its starts.
    """

    parents: list[list[int]]
    before: list[frozenset[Before]]
    """All that has to have come before a node starts, but for what precedes that."""


def linear_starts(compiled: CompiledTree, letters: TreeLetters) -> StartConditions | None:
    """The one start of each node where no variable ties events together and nothing competes for an event, else None.

    What a shared node waits for through one parent it must wait for in every scenario, which it
    does where that parent is in all scenarios that have the node. A part that may be without events
    orders nothing, so it must wait for the same through all parents.
    """
    if any(compiled.exported):
        return None
    found = StartConditions([[] for _ in compiled.names], [frozenset()] * len(compiled.names))
    silent, implied = _may_be_silent(compiled), list[int]()
    ways: list[list[frozenset[Before]]] = [[] for _ in compiled.names]
    for node, children in enumerate(compiled.children):  # parents come first
        parents = found.parents[node]
        before = found.before[node] = frozenset(chain(*ways[node]))
        if any(way != before for way in ways[node]):
            implied = implied or _implied(compiled)
            always = [implied[node] >> one & ~compiled.chooses >> one & 1 for one in parents]
            sure = {one for way, certain in zip(ways[node], always, strict=True) if certain for one in way}
            if silent[node] or any(one not in sure and any(one not in way for way in ways[node]) for one in before):
                return None
        own = frozenset([(node, 0)]) if compiled.own[node] and compiled.top_down else before
        for slot, child in enumerate(children):
            way = own
            if slot > 0 and compiled.ops[node] is PartKind.SEQUENCE:
                elder = children[slot - 1]
                way = frozenset([(node, slot) if silent[elder] else (elder, -1)])
            found.parents[child].append(node)
            ways[child].append(way)
    serving = [(letter.pattern, nodes) for letter, nodes in zip(letters.letters, letters.serves, strict=True) if nodes]
    overlaps = Overlaps([pattern for pattern, _ in serving]).pairs()
    alike = (pair for _, nodes in serving for pair in combinations(nodes, 2))
    overlapping = (pair for one, other in overlaps for pair in product(serving[one][1], serving[other][1]))
    effort = 0
    for pair in chain(alike, overlapping):
        beside, steps = _beside(compiled, *pair)
        effort += steps
        if beside or effort > EFFORT:
            return None
    return found


def _may_be_silent(compiled: CompiledTree) -> list[bool]:
    """For each node whether some scenario has no event in its part."""
    found = [False] * len(compiled.names)
    for node in range(len(found) - 1, -1, -1):
        found[node] = (
            not compiled.own[node] and sum(found[one] for one in compiled.children[node]) >= compiled.need[node]
        )
    return found


def _implied(compiled: CompiledTree) -> list[int]:
    """For each node the nodes that all scenarios with it have."""
    below = [1 << node for node in range(len(compiled.names))]
    for node in range(len(below) - 1, -1, -1):
        if not compiled.chooses >> node & 1:
            below[node] |= union(below[child] for child in compiled.children[node])
    above = [-1] * len(below)
    for node, children in enumerate(compiled.children):
        below[node] |= above[node] if node != compiled.root else 0
        for child in children:
            above[child] &= below[node]
    return below


def _beside(compiled: CompiledTree, one: int, other: int) -> tuple[bool, int]:
    """Whether two nodes may stand side by side in a scenario, and the steps it took to say so.

    They do not if one is above the other, or their lowest common gate orders or separates them.
    Between nodes that sharing relates, the answer is always yes.
    """
    if not compiled.members.isdisjoint((one, other)) or compiled.part_of[one] != compiled.part_of[other]:
        return True, 1
    above = [one]
    while compiled.parent[above[-1]] >= 0:
        above.append(compiled.parent[above[-1]])
    node, steps, known = other, len(above), set(above)
    while node not in known:
        node = compiled.parent[node]
        steps += 1
    if node in (one, other) or compiled.ops[node] in (PartKind.SEQUENCE, PartKind.ONE):
        return False, steps
    return not (compiled.ops[node] is PartKind.AT_LEAST and compiled.need[node] == 1), steps


class UsefulEvents:
    """The events worth keeping, so that the match of every branch can still be found at detection.

    What one branch can match depends on when each of its nodes starts, and that differs between
    branches. An event is worth keeping for an occurrence only if, since the last one kept for it,
    something was kept that may precede it: the earliest match of any branch takes, for each
    occurrence, the first event after those of its predecessors. So the number of events kept
    depends on the tree, not on the length of the trace.
    """

    def __init__(self, compiled: CompiledTree, starts: StartConditions) -> None:
        self.compiled = compiled
        self.starts = starts
        self.entries: list[tuple[int, Served]] = []
        """The positions of the events, with what each can serve."""
        self.own: dict[int, int] = {}
        """The position of the last event kept for a node's own occurrence."""
        self._latest: dict[int, int] = {}
        """The same for a node and everything below it."""
        self.useless: set[int] = set()
        """Nodes for which no event is worth keeping before another one is kept."""

    @property
    def state(self) -> dict[str, object]:
        """What changes, in copies."""
        return {"entries": list(self.entries), "own": dict(self.own), "_latest": dict(self._latest)}

    def note(self, position: int, served: Served) -> None:
        """Keep an event for the occurrences it may be needed for."""
        kept = [one for one in served if one[0] not in self.useless and self._is_useful(one[0])]
        if not kept:
            self.useless.update(node for node, _ in served)
            return
        self.entries.append((position, kept))
        self.useless.clear()
        agenda = [node for node, _ in kept]
        self.own.update(dict.fromkeys(agenda, position))
        while agenda:
            above = agenda.pop()
            if self._latest.get(above) != position:
                self._latest[above] = position
                agenda.extend(self.starts.parents[above])

    def _is_useful(self, node: int) -> bool:
        last = self.own.get(node)
        if last is None:
            return True
        compiled, latest = self.compiled, self._latest
        if not compiled.top_down and any(latest.get(child, 0) >= last for child in compiled.children[node]):
            return True
        agenda, seen = [node], {node}
        while agenda:
            for one, count in self.starts.before[agenda.pop()]:
                elders = (one,) if count < 0 else compiled.children[one][:count]
                # a later child of a sequence comes after the gate's own event too, whatever stands
                # between: it may be silent
                if any(latest.get(elder, 0) >= last for elder in elders) or (
                    compiled.top_down and self.own.get(one, 0) >= last
                ):
                    return True
                agenda.extend(new := {one, *elders} - seen)
                seen |= new
        return False


class LinearRun:
    """One evaluation; with `choices` a choice of one child is complete only when the child chosen for it is."""

    def __init__(
        self, compiled: CompiledTree, starts: StartConditions, choices: Mapping[int, int] | None = None
    ) -> None:
        self.compiled = compiled
        self.starts = starts
        self.choices = choices or {}
        self.fired: dict[int, tuple[int, Mapping[str, Json]]] = {}
        """The occurrences that have their event: its position and the values they saw."""
        self.listening: set[int] = set()
        """The nodes that wait for their event."""
        self._completed: dict[int, dict[int, None]] = {}
        # The gates whose children have started, each with the children that were complete when it was.
        self._started: set[int] = set()
        self._done: set[int] = set()
        self._agenda: list[tuple[Callable[[int], None], int]] = [(self._start, compiled.root)]
        self._settle()

    @property
    def state(self) -> dict[str, object]:
        """What changes, in copies."""
        completed = {gate: dict(children) for gate, children in self._completed.items()}
        sets = {"listening": set(self.listening), "_started": set(self._started), "_done": set(self._done)}
        return {"fired": dict(self.fired), "_completed": completed, **sets}

    @property
    def detected(self) -> bool:
        """Whether the root is complete."""
        return self.compiled.root in self._done

    def fire(self, served: Served, position: int) -> None:
        """Give an event to those of the nodes that listen."""
        self._agenda = []
        for node, values in served:
            if node in self.listening:
                self.listening.discard(node)
                self.fired[node] = (position, values)
                self._agenda.append((self._start_inside if self.compiled.top_down else self._complete, node))
        self._settle()

    def awaited(self) -> list[int]:
        """The listening nodes whose event brings something above them nearer to being complete;
        none if the root cannot be.
        """
        able = possible_nodes(self.compiled, self._kept)
        found: list[int] = []
        agenda, seen = [self.compiled.root], {self.compiled.root}
        while agenda:
            node = agenda.pop()
            if node not in able or node in self._done:
                continue
            if node in self.listening:
                found.append(node)
                continue  # below it nothing has begun, or nothing is left to do
            new = [child for child in self._kept(node) if child not in seen]
            seen.update(new)
            agenda.extend(new)
        return found

    def _kept(self, node: int) -> tuple[int, ...]:
        """The children of a node; where one was chosen, only that."""
        children = self.compiled.children[node]
        return tuple(child for child in children if self.choices.get(node, child) == child)

    def scenario(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """The nodes of the scenario that was matched, with the children they keep."""
        agenda, seen = [self.compiled.root], {self.compiled.root}
        while agenda:
            node = agenda.pop()
            kept = tuple(self._completed.get(node, ()))
            yield node, kept
            agenda.extend(child for child in reversed(kept) if child not in seen)
            seen.update(kept)

    def _settle(self) -> None:
        """What follows from what has happened."""
        while self._agenda:
            act, node = self._agenda.pop()
            act(node)

    def _start(self, node: int) -> None:
        compiled = self.compiled
        if node in self._started or compiled.dead >> node & 1 or not all(map(self._has_come, self.starts.before[node])):
            return
        self._started.add(node)
        if compiled.own[node] and (compiled.top_down or not compiled.children[node]):
            self.listening.add(node)
        else:
            self._agenda.append((self._start_inside, node))

    def _has_come(self, before: Before) -> bool:
        node, count = before
        return node in self._done if count < 0 else node in self._completed and len(self._completed[node]) >= count

    def _start_inside(self, node: int) -> None:
        children = self.compiled.children[node]
        if not children:
            self._agenda.append((self._complete, node))
            return
        self._completed[node] = {}
        first = children[:1] if self.compiled.ops[node] is PartKind.SEQUENCE else self._kept(node)
        self._agenda.extend((self._start, child) for child in reversed(first))
        for child in first:
            if child in self._done:  # a shared child that was complete before; it does not tell again
                self._hear(node, child)

    def _complete(self, node: int) -> None:
        self._done.add(node)
        for parent in self.starts.parents[node]:
            if parent in self._completed:
                self._hear(parent, node)

    def _hear(self, gate: int, child: int) -> None:
        """A child of a gate is complete."""
        compiled, complete = self.compiled, self._completed[gate]
        needed = compiled.need[gate]
        if len(complete) == needed or self.choices.get(gate, child) != child:
            return  # it has all it needs already, or the child is not what it keeps
        in_order = compiled.ops[gate] is PartKind.SEQUENCE
        if in_order and child != compiled.children[gate][len(complete)]:
            return  # it is shared, and heard in its turn
        complete[child] = None
        while in_order and len(complete) < needed:
            following = compiled.children[gate][len(complete)]
            self._agenda.append((self._start, following))
            if following not in self._done:
                break
            complete[following] = None
        if len(complete) < needed:
            return
        if compiled.own[gate] and not compiled.top_down:
            self.listening.add(gate)
        else:
            self._agenda.append((self._complete, gate))


def possible_nodes(
    compiled: CompiledTree, children: Callable[[int], Sequence[int]], among: Container[int] | None = None
) -> set[int]:
    """The nodes that can be complete with these children, in whatever time, where only those `among` these can."""
    able: set[int] = set()
    for node in range(len(compiled.names) - 1, -1, -1):
        fit = not compiled.dead >> node & 1 and (among is None or node in among)
        if fit and sum(child in able for child in children(node)) >= compiled.need[node]:
            able.add(node)
    return able


class LinearSnapshot(NamedTuple):
    """What changes of the run, and of the events that are kept, if any are."""

    run: dict[str, object]
    useful: dict[str, object]


class LinearMonitor:
    """The strategy: one run over everything, and the events from which the match of each branch can be found.

    Raises `TooLarge` where these are more than `limit`.
    """

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, starts: StartConditions, *, limit: int) -> None:
        self.compiled = compiled
        self.letters = letters
        self.limit = limit
        self.starts = starts
        self.run = LinearRun(compiled, starts)
        self.useful = UsefulEvents(compiled, starts) if PartKind.ONE in compiled.ops else None
        """Where no branch chooses, no event matters but to those that listen."""
        self.noted = True
        """Whether the last event may be part of a match."""
        self._matter: dict[EventClass, tuple[Admission, ...]] = {}
        """Of the letters that an event is those that may change something, as long as nothing has changed."""

    def forget(self, floor: int) -> None:
        """No event with an earlier time than this will count any more, which changes nothing here."""

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        twin.run, twin.useful = copy(self.run), copy(self.useful)
        twin._matter = {}  # noqa: SLF001 (its own)
        twin.restore(self.snapshot())
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures: what has started and is complete follows from what has fired."""
        return frozenset(self.run.fired)

    def snapshot(self) -> LinearSnapshot:
        """What `restore` needs to bring a fresh strategy of the same tree into this state."""
        return LinearSnapshot(self.run.state, {} if self.useful is None else self.useful.state)

    def restore(self, snapshot: object) -> None:
        """Take over a snapshot."""
        assert isinstance(snapshot, LinearSnapshot), "made by the same strategy"
        run, useful = snapshot
        self._matter.clear()
        vars(self.run).update(run)
        if self.useful is not None:
            vars(self.useful).update(useful, useless=set())

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """What an event of a class means, as far as that matters now."""
        if not event_class.serving:
            return NOTHING
        asked = self._matter.get(event_class)
        if asked is None:
            asked = self._mattering(event_class)
        if not asked:
            return NOTHING if self.useful is None else QUIET
        return Reading(False, [Hit(one.letter, one.nodes, one.reader.values(event)) for one in asked])

    def inert(self, event_class: EventClass) -> Inert:
        """What is known to change nothing among events of a class, as long as nothing else is read."""
        return Inert([(one.letter, ()) for one in self._mattering(event_class)], frozenset())

    def _mattering(self, event_class: EventClass) -> tuple[Admission, ...]:
        """Of the letters that an event is those that may change something."""
        deaf, useful = self.run.listening.isdisjoint, self.useful
        found = tuple(
            one
            for one in event_class.serving
            if not deaf(one.nodes) or (useful is not None and not useful.useless.issuperset(one.nodes))
        )
        if len(self._matter) >= MEMORY:
            self._matter.clear()
        self._matter[event_class] = found
        return found

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        self.noted = bool(reading.hits) and reading.hits is not QUIET.hits
        if self.noted:
            self._matter.clear()
            served = [(node, hit.values) for hit in reading.hits for node in hit.nodes]
            if self.useful is not None:
                self.useful.note(position, served)
                if len(self.useful.entries) > self.limit:
                    counts = Counter(node for _, kept in self.useful.entries for node, _ in kept)
                    names = [self.compiled.names[node] for node, _ in counts.most_common(10)]
                    most = f"most of them for {', '.join(names)}{', …' if len(counts) > 10 else ''}"
                    raise TooLarge(f"events to keep for the explanation; {most}", limit=self.limit)
            self.run.fire(served, position)
        return Verdict.TRUE if self.run.detected else Verdict.UNKNOWN

    def came(self, node: int) -> bool:
        """Whether a node's own event, where it has one, came at any time."""
        return self.useful is None or not self.compiled.own[node] or node in self.useful.own

    def run_under(self, choices: Mapping[int, int]) -> LinearRun:
        """The run in which each choice of one child keeps the child chosen for it."""
        if self.useful is None or not choices:
            return self.run
        run = LinearRun(self.compiled, self.starts, choices)
        for position, served in self.useful.entries:
            run.fire(served, position)
        return run
