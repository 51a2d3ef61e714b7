"""Proof of agreement: the product of the participants' states, explored breadth-first over all letters.

Every monitor has a `state` whose equality means equal futures, and two events that are the same letter are the same to all. So
if no reachable combination of states holds two different verdicts, no trace does; and where one does, the first that
is met gives a shortest trace on which they differ.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import partial

from cross_check.participants import Participant
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

GONE = -1
"""Stands for the state of a participant that is compared no more."""


@dataclass(frozen=True, slots=True)
class Exploration:
    """What the product has shown, each participant against the first one; `verdicts` counts the prefixes compared for each.

    `differ` gives a shortest distinguishing trace by the place of the participant; `failed` what a monitor raised. `complete` says that
    no combination of states was left out; then the others agree on all traces over the letters.
    """

    combinations: int
    verdicts: int
    longest: int
    complete: bool
    differ: dict[int, tuple[Json, ...]] = field(default_factory=dict)
    failed: dict[int, Exception] = field(default_factory=dict)


class _Machine:
    """The reachable states of one participant, numbered as they are met; every step is taken once."""

    def __init__(self, participant: Participant, letters: Sequence[Json]) -> None:
        self._letters = letters
        self._numbers: dict[Hashable, int] = {}
        self._monitors: list[Monitor] = []
        self.verdicts: list[Verdict] = []
        self._steps: list[list[int | None]] = []
        self._start = participant.start

    def start(self) -> int:
        """The number of the state before any event."""
        return self._number(self._start())

    def step(self, state: int, letter: int) -> int:
        """The number of the state after one more event."""
        after = self._steps[state][letter]
        if after is None:
            monitor = self._monitors[state].fork()
            monitor.step(self._letters[letter])
            after = self._steps[state][letter] = self._number(monitor)
        return after

    def _number(self, monitor: Monitor) -> int:
        state = (monitor.verdict, monitor.state)
        number = self._numbers.setdefault(state, len(self._monitors))
        if number == len(self._monitors):
            self._monitors.append(monitor)
            self.verdicts.append(monitor.verdict)
            self._steps.append([None] * len(self._letters))
        return number


class _Explorer:
    """The breadth-first search; `traces` are kept as back pointers."""

    def __init__(self, participants: Sequence[Participant], letters: Sequence[Json]) -> None:
        self.machines = [_Machine(participant, letters) for participant in participants]
        self.letters = letters
        self.differ: dict[int, tuple[Json, ...]] = {}
        self.failed: dict[int, Exception] = {}
        self.verdicts = 0
        self._came: list[tuple[int, int]] = []

    def run(self, limit: int) -> Exploration:
        """Explore until everything is seen, or `limit` combinations."""
        start = self._start()
        agenda = [start]
        known = {start}
        self._came = [(GONE, GONE)]
        depth = [0]
        complete = start[0] != GONE
        for position, states in enumerate(agenda):
            if len(agenda) > limit:
                complete = False
                break
            if self._lonely(states):
                continue
            for letter in range(len(self.letters)):
                after = self._after(position, states, letter)
                if after not in known:
                    known.add(after)
                    agenda.append(after)
                    self._came.append((position, letter))
                    depth.append(depth[position] + 1)
        complete = complete and 0 not in self.failed
        return Exploration(len(known), self.verdicts, max(depth), complete, self.differ, self.failed)

    def _start(self) -> tuple[int, ...]:
        states = tuple(self._tried(number, machine.start) for number, machine in enumerate(self.machines))
        return self._compared(states, ())

    def _after(self, position: int, states: tuple[int, ...], letter: int) -> tuple[int, ...]:
        found: list[int] = []
        for number, (machine, state) in enumerate(zip(self.machines, states, strict=True)):
            gone = state == GONE or number in self.differ or number in self.failed
            found.append(GONE if gone else self._tried(number, partial(machine.step, state, letter)))
        verdicts = {m.verdicts[s] for m, s in zip(self.machines, found, strict=True) if s != GONE}
        self.verdicts += 1
        if len(verdicts) <= 1:
            return tuple(found)
        return self._compared(tuple(found), (*self._trace(position), self.letters[letter]))

    def _tried(self, number: int, step: Callable[[], int]) -> int:
        """The state after a step; whoever fails is compared no more."""
        try:
            return step()
        except Exception as error:  # noqa: BLE001 (a monitor of somebody else may fail in any way; that is no agreement)
            self.failed[number] = error
            return GONE

    def _compared(self, states: tuple[int, ...], trace: tuple[Json, ...]) -> tuple[int, ...]:
        """The states, without those participants whose verdict is not that of the first."""
        if states[0] == GONE:
            return states
        expected = self.machines[0].verdicts[states[0]]
        kept: list[int] = []
        for number, (machine, state) in enumerate(zip(self.machines, states, strict=True)):
            differs = state != GONE and machine.verdicts[state] is not expected
            if differs:
                self.differ.setdefault(number, trace)
            kept.append(GONE if differs else state)
        return tuple(kept)

    def _lonely(self, states: tuple[int, ...]) -> bool:
        """Whether nobody is left to compare."""
        return states[0] == GONE or all(state == GONE for state in states[1:])

    def _trace(self, position: int) -> tuple[Json, ...]:
        letters: list[Json] = []
        while position:
            position, letter = self._came[position]
            letters.append(self.letters[letter])
        return tuple(reversed(letters))


def explore(participants: Sequence[Participant], letters: Sequence[Json], *, limit: int) -> Exploration:
    """Compare everybody with the first participant on all traces over the letters; see the module."""
    return _Explorer(participants, letters).run(limit)
