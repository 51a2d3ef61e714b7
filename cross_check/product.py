"""Proof of agreement: the product of the participants' states, explored breadth-first over all letters.

Every monitor has a `state` whose equality means equal futures, and two events that are the same letter are the same to all. So
if no reachable combination of states holds two different verdicts, no trace does; and where one does, the first that
is met gives a shortest trace on which they differ.

Where a participant may tie values of several events together, a letter is two events, with different values: a participant that is in the same
state after either, wherever it is, has forgotten which value it was, and whatever other value it had been would be forgotten as well.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import partial

from cross_check.letters import Letters
from cross_check.participants import Participant
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

GONE = -1
"""Stands for the state of a participant that is compared no more."""


@dataclass(slots=True)
class Exploration:
    """What the product has shown, each participant against the first one; `verdicts` counts the prefixes compared for each.

    `differ` gives a shortest distinguishing trace by the place of the participant, `failed` what a monitor raised, `tied` who remembers
    values. `complete` says that no combination of states was left out; then the others agree on all traces over the letters.
    """

    combinations: int = 0
    verdicts: int = 0
    longest: int = 0
    complete: bool = False
    differ: dict[int, tuple[Json, ...]] = field(default_factory=dict)
    failed: dict[int, Exception] = field(default_factory=dict)
    tied: set[int] = field(default_factory=set)


class _Machine:
    """The reachable states of one participant, numbered as they are met; every step is taken once."""

    def __init__(self, participant: Participant, letters: Sequence[Json]) -> None:
        self._letters = letters
        self._numbers: dict[Hashable, int] = {}
        self._monitors: list[Monitor] = []
        self.verdicts: list[Verdict] = []
        self._steps: list[list[int | None]] = []
        self._participant = participant
        self.ties = participant.ties

    def start(self) -> int:
        """The number of the state before any event."""
        return self._number(self._participant.start())

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
    """The breadth-first search; traces are kept as back pointers."""

    def __init__(self, participants: Sequence[Participant], letters: Letters) -> None:
        self.letters = letters.events
        self.twins = letters.twins
        self.machines = [_Machine(participant, self.letters) for participant in participants]
        self.found = Exploration()
        self._came: list[tuple[int, int]] = [(GONE, GONE)]

    def run(self, limit: int) -> Exploration:
        """Explore until everything is seen, or `limit` combinations."""
        start = self._compared(tuple(self._tried(n, machine.start) for n, machine in enumerate(self.machines)), ())
        agenda, known, depth = [start], {start}, [0]
        complete = start[0] != GONE
        for position, states in enumerate(agenda):
            if len(agenda) > limit:
                complete = False
                break
            if states[0] == GONE or all(state == GONE for state in states[1:]):
                continue  # nobody is left to compare
            for letter in range(len(self.letters)):
                after = self._after(position, states, letter)
                if after not in known:
                    known.add(after)
                    agenda.append(after)
                    self._came.append((position, letter))
                    depth.append(depth[position] + 1)
        self.found.combinations, self.found.longest = len(known), max(depth)
        self.found.complete = complete and 0 not in self.found.failed and 0 not in self.found.tied
        return self.found

    def _after(self, position: int, states: tuple[int, ...], letter: int) -> tuple[int, ...]:
        found: list[int] = []
        for number, (machine, state) in enumerate(zip(self.machines, states, strict=True)):
            after = GONE
            if state != GONE and not self._is_out(number):
                after = self._tried(number, partial(machine.step, state, letter))
                twin = self.twins[letter] if self.twins else letter
                if machine.ties and twin < letter and after != GONE and machine.step(state, twin) != after:
                    self.found.tied.add(number)
                    after = GONE
            found.append(after)
        verdicts = {m.verdicts[s] for m, s in zip(self.machines, found, strict=True) if s != GONE}
        self.found.verdicts += 1
        if len(verdicts) <= 1:
            return tuple(found)
        return self._compared(tuple(found), (*self._trace(position), self.letters[letter]))

    def _is_out(self, number: int) -> bool:
        return number in self.found.differ or number in self.found.failed or number in self.found.tied

    def _tried(self, number: int, step: Callable[[], int]) -> int:
        """The state after a step; whoever fails is compared no more."""
        try:
            return step()
        except Exception as error:  # noqa: BLE001 (a monitor of somebody else may fail in any way; that is no agreement)
            self.found.failed[number] = error
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
                self.found.differ.setdefault(number, trace)
            kept.append(GONE if differs else state)
        return tuple(kept)

    def _trace(self, position: int) -> tuple[Json, ...]:
        letters: list[Json] = []
        while position:
            position, letter = self._came[position]
            letters.append(self.letters[letter])
        return tuple(reversed(letters))


def explore(participants: Sequence[Participant], letters: Letters, *, limit: int) -> Exploration:
    """Compare everybody with the first participant on all traces over the letters; see the module."""
    return _Explorer(participants, letters).run(limit)
