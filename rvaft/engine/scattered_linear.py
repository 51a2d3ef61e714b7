"""`scattered` in linear time: every node starts once and is complete once, as early as can be.

Where no variable ties events together and no event can serve two occurrences that stand side by side, nothing is gained by passing
over an event, and what a node can do depends on nothing but when it starts. So each node is told to start when what precedes it is
complete, listens for its event, and tells its parents when it is complete; an ordered gate starts its children in turn. Each
node starts and completes at most once, so the total work is linear in the tree, beside the look-up per event.
`suits` says where this holds.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from itertools import combinations, product
from typing import Any, NamedTuple, Self

from rvaft.engine.compiled_tree import Plan
from rvaft.engine.event_index import Hit, Letters, Reading, Sketch, overlapping
from rvaft.errors import TooLarge
from rvaft.model.nodes import Gate
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict

# When a node may start under `scattered`, and where each node has but one start.
#
# A node starts with its parent, except a later child of an ordered gate (when those before it are complete) and a child of a
# gate whose own event comes first (when that has come). Whatever precedes a node's event is found along its starts.


class Start(NamedTuple):
    """After the children of an ordered gate that stand before a slot, or (slot 0) after the gate's own event."""

    gate: int
    slot: int


class Starts(NamedTuple):
    """The parents of every node, and its start: None stands for the beginning of the trace."""

    parents: tuple[tuple[int, ...], ...]
    start: tuple[Start | None, ...]

    def chain(self, node: int) -> Iterator[Start]:
        """The starts of a node, the last first."""
        start = self.start[node]
        while start is not None:
            yield start
            start = self.start[start.gate]


def starts_of(plan: Plan) -> Starts | None:
    """The one start of every node; None where a shared node has several."""
    parents: list[list[int]] = [[] for _ in plan.names]
    found: list[Start | None] = [None] * len(plan.names)
    known = {plan.root}
    for node, children in enumerate(plan.children):
        gate = plan.gates[node]
        for slot, child in enumerate(children):
            parents[child].append(node)
            start = found[node]
            if gate in (Gate.SAND, Gate.SAND_RL) and slot > 0:
                start = Start(node, slot)
            elif plan.own[node] and plan.top_down:
                start = Start(node, 0)
            if child in known and found[child] != start:
                return None
            known.add(child)
            found[child] = start
    return Starts(tuple(map(tuple, parents)), tuple(found))


# Whether the linear way to monitor `scattered` means the same as the general one (see `earliest`).

EFFORT = 1_000_000
"""How many steps to spend on the question; beyond, the answer is no."""


def linear_starts(plan: Plan, letters: Letters) -> Starts | None:
    """The starts of the nodes where no variable ties events together and nothing competes for an event, else None."""
    if any(plan.exported):
        return None
    starts = starts_of(plan)
    if starts is None or _Contest(plan, letters).found():
        return None
    return starts


class _Contest:
    """Two occurrences of one scenario, neither before the other, that one event can serve."""

    def __init__(self, plan: Plan, letters: Letters) -> None:
        self.plan = plan
        self.serves = [nodes for nodes in letters.serves if nodes]
        self.patterns = [letter.pattern for letter, nodes in zip(letters.letters, letters.serves, strict=True) if nodes]
        self.core = frozenset(plan.core)
        self.effort = 0

    def found(self) -> bool:
        """Whether there are two, or the search for them takes too long."""
        if any(self._among(combinations(nodes, 2)) for nodes in self.serves):
            return True
        for left, right in overlapping(self.patterns):
            self.effort += 1
            if self._among(product(self.serves[left], self.serves[right])):
                return True
        return False

    def _among(self, pairs: Iterable[tuple[int, int]]) -> bool:
        return any(self.effort > EFFORT or self._compete(a, b) for a, b in pairs)

    def _compete(self, a: int, b: int) -> bool:
        """Whether two nodes may compete: not if one is above the other, or their lowest common gate orders or separates them.

        Between nodes that sharing relates, the answer is always yes.
        """
        plan = self.plan
        if a in self.core or b in self.core or plan.part_of[a] != plan.part_of[b]:
            return True
        above = {a}
        node = a
        while plan.parent[node] >= 0:
            node = plan.parent[node]
            above.add(node)
            self.effort += 1
        node = b
        while node not in above:
            node = plan.parent[node]
            self.effort += 1
        if node in (a, b) or plan.gates[node] in (Gate.SAND, Gate.SAND_RL, Gate.OR):
            return False
        return not (plan.gates[node] is Gate.VOT and plan.thresholds[node] == 1)


# The events worth keeping under `scattered`, so that the match of every branch can still be found at detection.
#
# What one branch can match depends on when each of its nodes starts, and that differs between branches. An event is worth keeping for
# an occurrence only if, since the last one kept for it, something was kept that may precede it: the earliest match of
# any branch takes, for each occurrence, the first event after those of its predecessors. So the number of events kept depends on
# the tree, not on the length of the trace.


class Entry(NamedTuple):
    """An event: its position, the occurrences it can serve, and the values each saw."""

    position: int
    served: tuple[tuple[int, Mapping[str, Json]], ...]


class Log:
    """The events kept so far."""

    def __init__(self, plan: Plan, starts: Starts) -> None:
        self.plan = plan
        self.starts = starts
        self.entries: list[Entry] = []
        self._own: dict[int, int] = {}
        """The position of the last event kept for a node's own occurrence."""
        self._latest: dict[int, int] = {}
        """The same for a node and everything below it."""

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        vars(twin).update(entries=list(self.entries), _own=dict(self._own), _latest=dict(self._latest))
        return twin

    def note(self, position: int, served: Sequence[tuple[int, Mapping[str, Json]]]) -> None:
        """Keep an event for the occurrences it may be needed for."""
        kept = tuple((node, values) for node, values in served if self._useful(node))
        if kept:
            self.entries.append(Entry(position, kept))
            for node, _ in kept:
                self._own[node] = position
                self._raise(node, position)

    def has(self, node: int) -> bool:
        """Whether an event was ever kept for a node's own occurrence."""
        return node in self._own

    def _useful(self, node: int) -> bool:
        last = self._own.get(node)
        if last is None:
            return True
        if not self.plan.top_down and any(self._latest.get(child, 0) >= last for child in self.plan.children[node]):
            return True
        for gate, slot in self.starts.chain(node):
            # a later child of an ordered gate comes after the gate's own event too, whatever stands between: it may be silent
            if self.plan.top_down and self._own.get(gate, 0) >= last:
                return True
            if any(self._latest.get(elder, 0) >= last for elder in self.plan.children[gate][:slot]):
                return True
        return False

    def _raise(self, node: int, position: int) -> None:
        agenda = [node]
        while agenda:
            above = agenda.pop()
            if self._latest.get(above) != position:
                self._latest[above] = position
                agenda.extend(self.starts.parents[above])


class Run:
    """One evaluation; with `choices` an `or` is complete only when the child chosen for it is."""

    def __init__(self, plan: Plan, starts: Starts, choices: Mapping[int, int] | None = None) -> None:
        self.plan = plan
        self.starts = starts
        self.choices = choices or {}
        self.fired: dict[int, tuple[int, Mapping[str, Json]]] = {}
        """The occurrences that have their event: its position and the values they saw."""
        self.listening: dict[int, None] = {}
        """The nodes that wait for their event."""
        self.begun: list[int] = []
        """Those that began to wait since somebody emptied this list."""
        self._completed: dict[int, dict[int, None]] = {}
        # The gates whose children have started, each with the children that were complete when it was.
        self._started: set[int] = set()
        self._done: set[int] = set()
        self._settle([("start", plan.root)])

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        vars(twin).update(
            fired=dict(self.fired),
            listening=dict(self.listening),
            begun=list(self.begun),
            _completed={gate: dict(children) for gate, children in self._completed.items()},
            _started=set(self._started),
            _done=set(self._done),
        )
        return twin

    @property
    def detected(self) -> bool:
        """Whether the root is complete."""
        return self.plan.root in self._done

    def fire(self, served: Iterable[tuple[int, Mapping[str, Json]]], position: int) -> None:
        """Give an event to those of the nodes that listen."""
        agenda: list[tuple[str, int]] = []
        for node, values in served:
            if node in self.listening:
                del self.listening[node]
                self.fired[node] = (position, values)
                first = self.plan.top_down and self.plan.gates[node] is not None
                agenda.append(("inside" if first else "complete", node))
        self._settle(agenda)

    def awaited(self) -> list[int]:
        """The listening nodes whose event brings something above them nearer to being complete; none if the root cannot be."""
        able: set[int] = set()
        for node in range(len(self.plan.names) - 1, -1, -1):
            count = sum(child in able for child in self._kept(node))
            if count >= self.plan.least(node) and not self.plan.dead >> node & 1:
                able.add(node)
        found: list[int] = []
        agenda, seen = [self.plan.root], {self.plan.root}
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
        """The children of a node, of an `or` with a choice only that."""
        children = self.plan.children[node]
        return tuple(child for child in children if self.choices.get(node, child) == child)

    def scenario(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """The nodes of the scenario that was matched, with the children they keep."""
        agenda, seen = [self.plan.root], {self.plan.root}
        while agenda:
            node = agenda.pop()
            kept = tuple(self._completed.get(node, ()))
            yield node, kept
            agenda.extend(child for child in reversed(kept) if child not in seen)
            seen.update(kept)

    def _settle(self, agenda: list[tuple[str, int]]) -> None:
        """Follow up what has happened: nodes start, their insides start, are reached, they are complete."""
        while agenda:
            step, node = agenda.pop()
            match step:
                case "start":
                    self._start(node, agenda)
                case "inside":
                    self._start_inside(node, agenda)
                case "reached":
                    self._reach(node, agenda)
                case _:
                    self._done.add(node)
                    for parent in self.starts.parents[node]:
                        if parent in self._completed:
                            self._hear(parent, node, agenda)

    def _listen(self, node: int) -> None:
        self.listening[node] = None
        self.begun.append(node)

    def _start(self, node: int, agenda: list[tuple[str, int]]) -> None:
        if node in self._started or self.plan.dead >> node & 1:
            return
        self._started.add(node)
        if self.plan.own[node] and (self.plan.top_down or self.plan.gates[node] is None):
            self._listen(node)
        else:
            agenda.append(("inside", node))

    def _start_inside(self, node: int, agenda: list[tuple[str, int]]) -> None:
        gate, children = self.plan.gates[node], self.plan.children[node]
        if gate is None:
            agenda.append(("reached", node))
            return
        self._completed[node] = {}
        first = children[:1] if gate.ordered else children
        if node in self.choices:
            first = tuple(child for child in children if child == self.choices[node])
        agenda.extend(("start", child) for child in reversed(first))
        for child in first:
            if child in self._done:  # a shared child that was complete before; it does not tell again
                self._hear(node, child, agenda)

    def _reach(self, node: int, agenda: list[tuple[str, int]]) -> None:
        """All that a node needs below it is complete."""
        if self.plan.own[node] and not self.plan.top_down and self.plan.gates[node] is not None:
            self._listen(node)
        else:
            agenda.append(("complete", node))

    def _hear(self, gate: int, child: int, agenda: list[tuple[str, int]]) -> None:
        """A child of a gate is complete."""
        complete = self._completed[gate]
        needed = self.plan.least(gate)
        if len(complete) == needed or self.choices.get(gate, child) != child:
            return  # it has all it needs already, or the child is not what it keeps
        complete[child] = None
        if len(complete) == needed:
            agenda.append(("reached", gate))
        elif self.plan.gates[gate] in (Gate.SAND, Gate.SAND_RL):
            agenda.append(("start", self.plan.children[gate][len(complete)]))


class Earliest:
    """The strategy: one run over everything, and the events from which the match of each branch can be found.

    Raises `TooLarge` where these are more than `limit`.
    """

    def __init__(self, plan: Plan, letters: Letters, starts: Starts, *, limit: int) -> None:
        self.plan = plan
        self.letters = letters
        self.limit = limit
        self.noted = True
        self.starts = starts
        self.run = Run(plan, starts)
        self._empty_match = self.run.detected
        self._log = Log(plan, starts) if any(gate is Gate.OR for gate in plan.gates) else None
        self._letter = {node: number for number, nodes in enumerate(letters.serves) for node in nodes}
        self._waiting: dict[int, dict[int, None]] = {}
        """For each letter the nodes that listen for it."""
        self._note_listeners()

    def fork(self) -> Self:
        """An independent copy."""
        twin = copy(self)
        vars(twin).update(
            run=self.run.fork(),
            _log=None if self._log is None else self._log.fork(),
            _waiting={letter: dict(nodes) for letter, nodes in self._waiting.items()},
        )
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures: what has started and is complete follows from what has fired."""
        return frozenset(self.run.fired)

    def snapshot(self) -> object:
        """What `restore` needs to bring a fresh strategy of the same tree into this state."""
        log = None if self._log is None else _without_tree(self._log.fork())
        waiting = {letter: dict(nodes) for letter, nodes in self._waiting.items()}
        return _without_tree(self.run.fork()), log, waiting

    def restore(self, snapshot: Any) -> None:
        """Take over a snapshot."""
        run, log, self._waiting = snapshot
        vars(self.run).update(run)
        if self._log is not None:
            vars(self._log).update(log)

    def read(self, event: Json, sketch: Sketch | None = None) -> Reading:
        """What an event means, as far as that matters now: letters that nobody waits for are not tried."""
        served = self.letters.serves
        wanted: Callable[[int], bool] = self._waiting.__contains__ if self._log is None else self._serves
        hits = tuple(Hit(n, served[n], values) for n, values in self.letters.serving(event, wanted, sketch))
        return Reading(relevant=bool(hits), hits=hits)

    def _serves(self, letter: int) -> bool:
        return bool(self.letters.serves[letter])

    def advance(self, reading: Reading, position: int) -> Verdict:
        """The verdict after one more event."""
        if reading.hits and not self._empty_match:
            if self._log is None:
                self.run.fire(self._heard(reading), position)
            else:
                served = [(node, hit.values) for hit in reading.hits for node in hit.nodes]
                self._log.note(position, served)
                if len(self._log.entries) > self.limit:
                    raise TooLarge(f"events to keep for the explanation; {self._what_grows}", limit=self.limit)
                self.run.fire(served, position)
            self._note_listeners()
        return Verdict.TRUE if self.run.detected else Verdict.UNKNOWN

    def _heard(self, reading: Reading) -> list[tuple[int, Mapping[str, Json]]]:
        """The listening nodes that an event serves; they listen no more."""
        heard = [hit for hit in reading.hits if hit.letter in self._waiting]
        return [(node, hit.values) for hit in heard for node in self._waiting.pop(hit.letter)]

    @property
    def _what_grows(self) -> str:
        """The nodes that the log keeps most events for."""
        counts = Counter(node for entry in self._log.entries for node, _ in entry.served) if self._log else Counter()
        names = [self.plan.names[node] for node, _ in counts.most_common(10)]
        return f"most of them for {', '.join(names)}{', …' if len(counts) > 10 else ''}"

    def _note_listeners(self) -> None:
        if self._log is None:
            for node in self.run.begun:
                self._waiting.setdefault(self._letter[node], {})[node] = None
        self.run.begun.clear()

    def came(self, node: int) -> bool:
        """Whether a node's own event, where it has one, came at any time."""
        return self._log is None or not self.plan.own[node] or self._log.has(node)

    def match(self, choices: Mapping[int, int]) -> Run | None:
        """The run in which each `or` keeps the child chosen for it, if it detects too."""
        run = self.run_under(choices)
        return run if self._log is None or run.detected else None

    def run_under(self, choices: Mapping[int, int]) -> Run:
        """The run in which each `or` keeps the child chosen for it."""
        if self._log is None or not choices:
            return self.run
        run = Run(self.plan, self.starts, choices)
        for entry in self._log.entries:
            run.fire(entry.served, entry.position)
        return run


def _without_tree(part: Run | Log) -> dict[str, Any]:
    """What changes in a run or a log."""
    return {name: value for name, value in vars(part).items() if name not in {"plan", "starts"}}
