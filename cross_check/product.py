"""Proof of agreement: breadth-first exploration of the product of the participants' states.

Equal monitor states imply equal futures, and events of one letter are indistinguishable. If no
reachable combination of states has two different verdicts, no trace distinguishes the participants;
otherwise the first one found gives a shortest distinguishing trace.

If a participant may join values of several events, a letter is a pair of events with different
values. A participant that always reaches the same state after both has forgotten the value, and
would forget any other.
"""

from collections.abc import Hashable, Sequence

from cross_check.letters import Letters
from cross_check.participants import Participant
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.support.budget import Undecided

GONE = -1
"""The state of an excluded participant."""


class _Machine:
    """The reachable states of one participant, by discovery; each step is computed once."""

    def __init__(self, participant: Participant, letters: Sequence[Json]) -> None:
        self.ties = participant.ties
        self.receives = [not participant.json_alone or is_finite(letter) for letter in letters]
        self.verdicts: list[Verdict] = []
        self._letters = letters
        self._numbers: dict[Hashable, int] = {}
        self._monitors: list[Monitor] = []
        self._steps: list[list[int | None]] = []

    def step(self, state: int, letter: int) -> int:
        after = self._steps[state][letter]
        if after is None:
            monitor = self._monitors[state].fork()
            monitor.step(self._letters[letter])
            after = self._steps[state][letter] = self.number(monitor)
        return after

    def number(self, monitor: Monitor) -> int:
        state = (monitor.verdict, monitor.state)
        number = self._numbers.setdefault(state, len(self._monitors))
        if number == len(self._monitors):
            self._monitors.append(monitor)
            self.verdicts.append(monitor.verdict)
            self._steps.append([None] * len(self._letters))
        return number


class Exploration:
    """The result of the product, for each participant against the first one.

    - `verdicts`: the number of compared prefixes.
    - `differ`: a shortest distinguishing trace by participant.
    - `failed`: errors of monitors.
    - `tied`: participants that remember values.
    - `detected`: participants that detected something.
    - `complete`: no combination of states was skipped, so the others agree on all traces.
    """

    def __init__(self, participants: Sequence[Participant], letters: Letters, *, limit: int) -> None:
        """Explore all combinations, or `limit` of them."""
        self.verdicts = 0
        self.differ: dict[int, tuple[Json, ...]] = {}
        self.failed: dict[int, Exception] = {}
        self.tied: set[int] = set()
        self._letters = letters
        self._machines = [_Machine(participant, letters.events) for participant in participants]
        self._came = [(GONE, GONE)]  # for each combination, its predecessor and the letter
        start = self._start(participants)
        agenda, known = [start], {start}
        self.complete = start[0] != GONE
        for position, states in enumerate(agenda):
            if len(agenda) > limit:
                self.complete = False
                break
            if states[0] == GONE or all(state == GONE for state in states[1:]):
                continue  # no participants are left to compare
            for letter in range(len(letters.events)):
                after = self._after(position, states, letter)
                if after not in known:
                    known.add(after)
                    agenda.append(after)
                    self._came.append((position, letter))
        self.detected = {number for number, machine in enumerate(self._machines) if Verdict.TRUE in machine.verdicts}
        self.complete = self.complete and 0 not in self.failed and 0 not in self.tied

    def _start(self, participants: Sequence[Participant]) -> tuple[int, ...]:
        found = [GONE] * len(participants)
        for number, (participant, machine) in enumerate(zip(participants, self._machines, strict=True)):
            try:
                found[number] = machine.number(participant.start())
            except Exception as error:  # noqa: BLE001
                self.failed[number] = error
        return self._agreeing(found, GONE, GONE)

    def _after(self, position: int, states: tuple[int, ...], letter: int) -> tuple[int, ...]:
        found: list[int] = []
        twin = self._letters.twins[letter] if self._letters.twins else letter
        for number, (machine, state) in enumerate(zip(self._machines, states, strict=True)):
            after = GONE
            if (
                state != GONE
                and machine.receives[letter]
                and not (number in self.differ or number in self.failed or number in self.tied)
            ):
                try:
                    after = machine.step(state, letter)
                    if twin < letter and machine.ties and machine.step(state, twin) != after:
                        self.tied.add(number)
                        after = GONE
                except Undecided:  # a reference without steps
                    raise
                except Exception as error:  # noqa: BLE001 (see above)
                    self.failed[number] = error
            found.append(after)
        self.verdicts += 1
        return self._agreeing(found, position, letter)

    def _agreeing(self, states: list[int], position: int, letter: int) -> tuple[int, ...]:
        if states[0] != GONE:
            expected = self._machines[0].verdicts[states[0]]
            for number, state in enumerate(states):
                if state != GONE and self._machines[number].verdicts[state] is not expected:
                    states[number] = GONE
                    self.differ.setdefault(number, self._trace(position, letter))
        return tuple(states)

    def _trace(self, position: int, letter: int) -> tuple[Json, ...]:
        events: list[Json] = []
        while letter != GONE:
            events.append(self._letters.events[letter])
            position, letter = self._came[position]
        return tuple(reversed(events))
