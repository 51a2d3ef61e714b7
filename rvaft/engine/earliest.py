"""`scattered` in linear time: every node starts once and is complete once, as early as can be.

Where no variable ties events together and no event can serve two occurrences that stand side by side, nothing is gained by passing
over an event, and what a node can do depends on nothing but when it starts. So each node is told to start when what precedes it is
complete, listens for its event, and tells its parents when it is complete; an ordered gate starts its children in turn. Each
node starts and completes at most once, so the total work is linear in the tree, beside the look-up per event.
`suits` says where this holds.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from copy import copy
from typing import Any, Self

from rvaft.engine.letters import Hit, Letters, Reading
from rvaft.engine.log import Log
from rvaft.engine.plan import Plan
from rvaft.engine.starts import Starts
from rvaft.errors import TooLarge
from rvaft.model import Gate
from rvaft.values import Json
from rvaft.verdict import Verdict


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

    def read(self, event: Json) -> Reading:
        """What an event means, as far as that matters now: letters that nobody waits for are not tried."""
        served = self.letters.serves
        wanted: Callable[[int], bool] = self._waiting.__contains__ if self._log is None else self._serves
        hits = tuple(Hit(n, served[n], values) for n, values in self.letters.serving(event, wanted))
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
