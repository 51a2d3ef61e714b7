"""The strategy for `scattered` in linear time: every node starts and completes once, as early as
possible.

It applies if no variable relates events and no event matches two concurrent occurrences; then
skipping an event has no advantage. A node starts when its predecessors, through all parents, are
complete. It listens for its event, and notifies its parents when complete. The first complete child
decides a choice. The total work is linear in the tree, plus a look-up per event.
"""

from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from functools import cached_property
from itertools import chain, combinations, product
from math import inf
from typing import Any, Final, NamedTuple, Self, TypeAlias

from rvaft.core.overlaps import Overlaps
from rvaft.core.property import PartKind
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
from rvaft.engine.explanation import (
    Choices,
    CompiledSearch,
    FoundMatch,
    Step,
    Waiting,
    explained_match,
    explanation_of,
    found_match,
    pending,
    possible_nodes,
)
from rvaft.engine.strategy import Measured, Progress
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation, Pending
from rvaft.support.bits import union

MEMORY: Final = 4096
"""The maximum number of cached event classes."""
EFFORT: Final = 1_000_000
"""The maximum number of steps to find concurrent occurrences."""

Served: TypeAlias = Sequence[tuple[int, Mapping[str, Json]]]
"""Occurrences that an event can serve, with values."""


Before: TypeAlias = tuple[int, int]
"""A start condition: a node and -1 (the node is complete), or a gate and the number of its complete
children.

The number 0 stands for the gate's own event.
"""


class StartConditions(NamedTuple):
    """The start conditions of each node.

    A node starts with its parents, with two exceptions: a later child of a sequence starts after
    the earlier children, and a child of a gate whose own event comes first after that event.
    """

    parents: list[list[int]]
    before: list[frozenset[Before]]
    """The start conditions of each node, without transitive ones."""


def linear_starts(compiled: CompiledTree, letters: TreeLetters) -> StartConditions | None:
    """Return the start conditions, or None if the strategy does not apply.

    A condition of a shared node through one parent must apply in every scenario with the node. A
    part that may have no events needs equal conditions through all parents.
    """
    if any(compiled.exported) or compiled.windows or compiled.ends:
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
    found = [False] * len(compiled.names)
    for node in range(len(found) - 1, -1, -1):
        found[node] = (
            not compiled.own[node] and sum(found[one] for one in compiled.children[node]) >= compiled.need[node]
        )
    return found


def _implied(compiled: CompiledTree) -> list[int]:
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
    """Return whether two nodes may be concurrent in a scenario, and the number of steps taken.

    They are not if one is above the other, or if their lowest common gate is a sequence or keeps
    one child.
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
    """The events to keep so that a detection can find the match of every branch.

    The earliest match takes the first event after its predecessors. So an event is kept for an
    occurrence only if a possible predecessor was kept since the last event kept for it. The number
    of kept events depends on the tree, not on the trace.
    """

    def __init__(self, compiled: CompiledTree, starts: StartConditions) -> None:
        self.compiled = compiled
        self.starts = starts
        self.entries: list[tuple[int, Served]] = []
        """The positions of the events, each with the occurrences that it can serve."""
        self.own: dict[int, int] = {}
        """The last event kept for a node."""
        self._latest: dict[int, int] = {}
        """The last event kept for a node or below it."""
        self.useless: set[int] = set()
        """The nodes for which no event is kept until an event for another node is."""

    @property
    def state(self) -> dict[str, object]:
        """A copy of the mutable state."""
        return {"entries": list(self.entries), "own": dict(self.own), "_latest": dict(self._latest)}

    def note(self, position: int, served: Served) -> None:
        """Keep an event if it may be needed."""
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
                # A later child of a sequence also follows the gate's own event, since the earlier
                # children may be silent.
                if any(latest.get(elder, 0) >= last for elder in elders) or (
                    compiled.top_down and self.own.get(one, 0) >= last
                ):
                    return True
                agenda.extend(new := {one, *elders} - seen)
                seen |= new
        return False


class LinearRun:
    """One evaluation under `choices` of `or` gates."""

    def __init__(
        self, compiled: CompiledTree, starts: StartConditions, choices: Mapping[int, int] | None = None
    ) -> None:
        self.compiled = compiled
        self.starts = starts
        self.choices = choices or {}
        self.fired: dict[int, tuple[int, Mapping[str, Json]]] = {}
        """The occurrences with their events: position and values."""
        self.listening: set[int] = set()
        """The nodes that wait for their event."""
        self._completed: dict[int, dict[int, None]] = {}
        # the started gates with their complete children in order
        self._started: set[int] = set()
        self._done: set[int] = set()
        self._agenda: list[tuple[Callable[[int], None], int]] = [(self._start, compiled.root)]
        self._settle()

    @property
    def state(self) -> dict[str, object]:
        """A copy of the mutable state."""
        completed = {gate: dict(children) for gate, children in self._completed.items()}
        sets = {"listening": set(self.listening), "_started": set(self._started), "_done": set(self._done)}
        return {"fired": dict(self.fired), "_completed": completed, **sets}

    @property
    def detected(self) -> bool:
        """Whether the root is complete."""
        return self.compiled.root in self._done

    def fire(self, served: Served, position: int) -> None:
        """Pass an event to listening nodes."""
        self._agenda = []
        for node, values in served:
            if node in self.listening:
                self.listening.discard(node)
                self.fired[node] = (position, values)
                self._agenda.append((self._start_inside if self.compiled.top_down else self._complete, node))
        self._settle()

    def awaited(self) -> list[int]:
        """Return the listening nodes whose event the root needs."""
        able = possible_nodes(self.compiled, self._kept)
        found: list[int] = []
        agenda, seen = [self.compiled.root], {self.compiled.root}
        while agenda:
            node = agenda.pop()
            if node not in able or node in self._done:
                continue
            if node in self.listening:
                found.append(node)
                continue
            new = [child for child in self._kept(node) if child not in seen]
            seen.update(new)
            agenda.extend(new)
        return found

    def _kept(self, node: int) -> tuple[int, ...]:
        children = self.compiled.children[node]
        return tuple(child for child in children if self.choices.get(node, child) == child)

    def scenario(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Iterate over the nodes of the match, with kept children."""
        agenda, seen = [self.compiled.root], {self.compiled.root}
        while agenda:
            node = agenda.pop()
            kept = tuple(self._completed.get(node, ()))
            yield node, kept
            agenda.extend(child for child in reversed(kept) if child not in seen)
            seen.update(kept)

    def _settle(self) -> None:
        while self._agenda:
            act, node = self._agenda.pop()
            act(node)

    def _start(self, node: int) -> None:
        compiled = self.compiled
        if node in self._started or not all(map(self._is_satisfied, self.starts.before[node])):
            return
        self._started.add(node)
        if compiled.own[node] and (compiled.top_down or not compiled.children[node]):
            self.listening.add(node)
        else:
            self._agenda.append((self._start_inside, node))

    def _is_satisfied(self, before: Before) -> bool:
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
            if child in self._done:  # a shared child that was already complete
                self._note_complete(node, child)

    def _complete(self, node: int) -> None:
        self._done.add(node)
        for parent in self.starts.parents[node]:
            if parent in self._completed:
                self._note_complete(parent, node)

    def _note_complete(self, gate: int, child: int) -> None:
        compiled, complete = self.compiled, self._completed[gate]
        needed = compiled.need[gate]
        if len(complete) == needed or self.choices.get(gate, child) != child:
            return  # the gate is complete, or does not keep the child
        in_order = compiled.ops[gate] is PartKind.SEQUENCE
        if in_order and child != compiled.children[gate][len(complete)]:
            return  # a shared child, handled in its turn
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


def _steps(compiled: CompiledTree, fired: Mapping[int, tuple[int, Mapping[str, Json]]]) -> list[Step]:
    steps = [(compiled.events[node], position, values) for node, (position, values) in fired.items()]
    return [Step(source, position, values) for source, position, values in steps if source is not None]


class LinearMonitor(Measured):
    """One run over all events, and events to keep for the explanation.

    Raises `TooLarge` if more than `limit` events are kept.
    """

    def __init__(self, compiled: CompiledTree, letters: TreeLetters, starts: StartConditions, *, limit: int) -> None:
        self.compiled = compiled
        self.letters = letters
        self.limit = limit
        self.starts = starts
        self.run = LinearRun(compiled, starts)
        self.useful = UsefulEvents(compiled, starts) if PartKind.ONE in compiled.ops else None
        """None for a tree without choices."""
        self.noted = True
        """Whether the last event may be part of a match."""
        self._matter: dict[EventClass, tuple[Admission, ...]] = {}
        """By event class, the letters that matter now."""

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = copy(self)
        twin.run, twin.useful = copy(self.run), copy(self.useful)
        twin._matter = {}  # noqa: SLF001 (its own)
        twin.restore(self.snapshot())
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures; the events taken determine them."""
        return frozenset(self.run.fired)

    def snapshot(self) -> object:
        """Return the state for `restore`."""
        return self.run.state, {} if self.useful is None else self.useful.state

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same tree."""
        run, useful = snapshot
        self._matter.clear()
        vars(self.run).update(run)
        if self.useful is not None:
            vars(self.useful).update(useful, useless=set())

    def read(self, event: Mapping[str, Json], event_class: EventClass) -> Reading:
        """Return the reading of an event in the current state."""
        if not event_class.serving:
            return NOTHING
        admissions = self._matter.get(event_class)
        if admissions is None:
            admissions = self._mattering(event_class)
        if not admissions:
            return NOTHING if self.useful is None else QUIET
        return Reading(False, [Hit(one.letter, one.nodes, one.reader.values(event)) for one in admissions])

    def inert(self, event_class: EventClass) -> Inert:
        """Return which events of a class change nothing until another event is read."""
        return Inert([(one.letter, ()) for one in self._mattering(event_class)], frozenset())

    def _mattering(self, event_class: EventClass) -> tuple[Admission, ...]:
        is_idle, useful = self.run.listening.isdisjoint, self.useful
        found = tuple(
            one
            for one in event_class.serving
            if not is_idle(one.nodes) or (useful is not None and not useful.useless.issuperset(one.nodes))
        )
        if len(self._matter) >= MEMORY:
            self._matter.clear()
        self._matter[event_class] = found
        return found

    def advance(self, reading: Reading, position: int) -> Verdict:
        """Return the verdict after one more event."""
        self.noted = bool(reading.hits) and reading.hits is not QUIET.hits
        if self.noted:
            self._matter.clear()
            served = [(node, hit.values) for hit in reading.hits for node in hit.nodes]
            if self.useful is not None:
                self.useful.note(position, served)
                if len(self.useful.entries) > self.limit:
                    counts = Counter(node for _, kept in self.useful.entries for node, _ in kept)
                    most = self.compiled.some(node for node, _ in counts.most_common(11))
                    raise TooLarge(f"events to keep for the explanation; most of them for {most}", limit=self.limit)
            self.run.fire(served, position)
        return Verdict.TRUE if self.run.detected else Verdict.UNKNOWN

    @property
    def until(self) -> float:
        """-infinite before the first event, then infinite: there are no windows."""
        return inf if self.run.fired or (self.useful is not None and self.useful.entries) else -inf

    def explain(self) -> Explanation:
        """Return a match of the lowest-numbered branch."""
        found, explained = explained_match(_LinearSearch(self))
        return explanation_of(self.compiled.prop.tree, found.steps, explained)

    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:  # noqa: ARG002 (never ⊥)
        """Return the awaited events of each live branch."""
        return pending(_LinearSearch(self), limit=limit)

    def progress(self) -> Iterable[Progress]:
        """Return the progress of the run; the best match may omit some events taken."""
        fired = {node: position for node, (position, _) in self.run.fired.items()}
        return (Progress(fired, exact=False, awaited=self._awaited),)

    def _awaited(self, kept: Collection[int]) -> list[str]:
        run = LinearRun(self.compiled, self.starts)
        for node, (position, values) in self.run.fired.items():
            if node in kept:
                run.fire([(node, values)], position)
        return [self.compiled.names[node] for node in run.awaited()]


class _LinearSearch(CompiledSearch):
    """Reruns the kept events under choices."""

    def __init__(self, strategy: LinearMonitor) -> None:
        super().__init__(strategy.compiled)
        self._strategy = strategy

    def find(self, choices: Choices) -> FoundMatch | None:
        """Return the match with these choices, or None."""
        run = self._run(choices)
        if not run.detected:
            return None
        kept = dict(run.scenario())
        steps = _steps(self.compiled, {node: run.fired[node] for node in kept if node in run.fired})
        return found_match(self.compiled, sorted(steps, key=lambda step: step.position), kept)

    def waiting(self, choices: Choices | None) -> Iterable[Waiting]:
        """Return the awaited nodes under these choices; no variable is bound."""
        return [Waiting([self.compiled.names[node] for node in self._run(choices or {}).awaited()], {})]

    @cached_property
    def came(self) -> frozenset[int]:
        """The nodes whose own event, if any, may have occurred."""
        own, useful = self.compiled.own, self._strategy.useful
        return frozenset(node for node in range(len(own)) if useful is None or not own[node] or node in useful.own)

    def _run(self, choices: Choices) -> LinearRun:
        compiled, strategy = self.compiled, self._strategy
        made = {gate: child for gate, child in choices.items() if gate in compiled.choices}
        if strategy.useful is None or not made:
            return strategy.run
        nodes = ((node, child) for gate, child in made.items() for node in compiled.choices[gate])
        numbers = {node: compiled.child(node, child) for node, child in nodes}
        run = LinearRun(compiled, strategy.starts, numbers)
        for position, served in strategy.useful.entries:
            run.fire(served, position)
        return run
