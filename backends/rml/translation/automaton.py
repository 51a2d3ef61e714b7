r"""Determinisation: every partial match at once, followed by sets of letters.

A configuration is a set of matched occurrences, the register of each variable that has to be remembered, and the scenarios it is a
partial match of; a state is a set of configurations. One event may be several letters. Each state lists its alternatives, larger sets
of letters first: `\/` takes the first that fits, so none needs a negation, and an alternative that detects comes before all others.
Where no alternative fits the monitor reports ⊥ at that very event; under `scattered` the state stays.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from backends.rml.translation.combining import Combinations
from backends.rml.translation.letters import Letter, Letters
from backends.rml.translation.registers import Registers
from backends.rml.translation.scenarios import Scenario, bits
from rvaft.errors import TooLarge
from rvaft.guards import variables as guard_variables
from rvaft.verdict import Semantics

ACCEPT: Final = -1
STAY: Final = -2

Environment = tuple[tuple[str, str], ...]
"""The register of each remembered variable, by name."""

Partial = tuple[int, Environment]


@dataclass(frozen=True, slots=True)
class State:
    """Partial matches, each with the scenarios it belongs to, and the registers bound by now."""

    partials: frozenset[tuple[Partial, int]]
    bound: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Alternative:
    """On an event that is all the letters, go on to the target; `fits` is the set of all letters it then is, as bits."""

    letters: tuple[Letter, ...]
    fits: int
    target: int


@dataclass(slots=True)
class _Move:
    """Where one letter leads."""

    partials: dict[Partial, int] = field(default_factory=dict)
    detects: bool = False


class Automaton:
    """The alternatives of each state; state 0 is the first. Raises `TooLarge` beyond `limit` alternatives, rejected ones included."""

    def __init__(
        self, scenarios: list[Scenario], letters: Letters, registers: Registers, semantics: Semantics, *, limit: int
    ) -> None:
        self._letters = letters
        self._registers = registers
        self._scattered = semantics is Semantics.SCATTERED
        self._limit = limit
        self._size = 0
        self._known: dict[int, frozenset[str]] = {}
        self._prepare(scenarios)
        start = State(frozenset({((0, ()), (1 << len(scenarios)) - 1)}))
        self._number = {start: 0}
        self._waiting = [start]
        self.alternatives: list[list[Alternative]] = []
        for state in self._waiting:
            self.alternatives.append(list(self._alternatives(state)))

    def _prepare(self, scenarios: list[Scenario]) -> None:
        """Turn the scenarios round: for each occurrence and guard, the scenarios that have it."""
        ready: dict[int, dict[int, int]] = {}
        self._complete: dict[int, int] = {}
        self._guarded: dict[str, int] = {}
        for number, scenario in enumerate(scenarios):
            bit = 1 << number
            self._complete[scenario.occurrences] = self._complete.get(scenario.occurrences, 0) | bit
            for index, before in scenario.before.items():
                ways = ready.setdefault(index, {})
                ways[before] = ways.get(before, 0) | bit
            for name in scenario.guards:
                self._guarded[name] = self._guarded.get(name, 0) | bit
        self._ready = {index: tuple(ways.items()) for index, ways in sorted(ready.items())}
        nodes = self._letters.observations.tree.nodes
        order = [name for name in self._letters.observations.tree.order if name in self._guarded]
        self._speaks = {
            name: frozenset(guard_variables(when)) for name in order if (when := nodes[name].when) is not None
        }

    # -- one state ----------------------------------------------------------------------------------------------------

    def _alternatives(self, state: State) -> Iterator[Alternative]:
        moves = self._moves(state)
        if self._scattered:
            moves = {letter: move for letter, move in moves.items() if move.detects or self._helps(state, move)}
        tree = self._letters.observations.tree
        made = list(moves.values())
        for combination in Combinations(tree, moves, state.bound, self._count).all():
            fitting = [made[i] for i in bits(combination.fits)]
            target = ACCEPT
            if not any(move.detects for move in fitting):
                target = self._target(state, fitting, combination.letters)
            if target != STAY:
                yield Alternative(combination.letters, combination.fits, target)
        if self._scattered:
            yield Alternative((), 0, STAY)

    def _count(self) -> None:
        """One more alternative, in whatever state."""
        self._size += 1
        if self._size > self._limit:
            raise TooLarge("alternatives of the RML equations", limit=self._limit)

    def _target(self, state: State, moves: list[_Move], written: tuple[Letter, ...]) -> int:
        merged: dict[Partial, int] = dict(state.partials) if self._scattered else {}
        for move in moves:
            for partial, mask in move.partials.items():
                merged[partial] = merged.get(partial, 0) | mask
        if self._scattered:
            merged = _undominated(merged)
        bound = state.bound.union(*(letter.call.registers for letter in written))
        after = State(frozenset(merged.items()), bound)
        if self._scattered and after == state:
            return STAY
        if after not in self._number:
            self._number[after] = len(self._number)
            self._waiting.append(after)
        return self._number[after]

    def _helps(self, state: State, move: _Move) -> bool:
        merged = dict(state.partials)
        for partial, mask in move.partials.items():
            merged[partial] = merged.get(partial, 0) | mask
        return frozenset(_undominated(merged).items()) != state.partials

    def _moves(self, state: State) -> dict[Letter, _Move]:
        """The letters that advance some partial match, and where each leads."""
        partials = sorted(state.partials)
        candidates = [
            (done, environment, index, mask & ways)
            for (done, environment), mask in partials
            for index, before in self._ready.items()
            if not done >> index & 1
            if mask & (ways := _ways(before, done))
        ]
        chosen = self._registers.choose(((i, dict(env).keys()) for _, env, i, _ in candidates), state.bound)
        moves: dict[Letter, _Move] = {}
        for done, environment, index, mask in candidates:
            registers = self._registers.assign(index, dict(environment), chosen)
            after = done | 1 << index
            partial = (after, self._remembered(after, registers))
            for part, guards in self._split(done, after, mask):
                letter = self._letters.letter(index, registers, guards)
                if letter is None:
                    continue
                move = moves.setdefault(letter, _Move())
                move.detects = move.detects or bool(self._complete.get(after, 0) & part)
                move.partials[partial] = move.partials.get(partial, 0) | part
        return moves

    def _split(self, done: int, after: int, mask: int) -> list[tuple[int, tuple[str, ...]]]:
        """The scenarios, parted by which guards get their last variable now."""
        if not self._speaks:
            return [(mask, ())]
        parts: list[tuple[int, tuple[str, ...]]] = [(mask, ())]
        before, now = self._bound(done), self._bound(after)
        for name, variables in self._speaks.items():
            if variables <= now and not variables <= before:
                having = self._guarded[name]
                parts = [
                    (scenarios, names)
                    for part, guards in parts
                    for scenarios, names in ((part & having, (*guards, name)), (part & ~having, guards))
                    if scenarios
                ]
        return parts

    def _bound(self, done: int) -> frozenset[str]:
        if done not in self._known:
            variables = self._letters.observations.variables
            self._known[done] = frozenset().union(*(variables[index] for index in bits(done)))
        return self._known[done]

    def _remembered(self, done: int, registers: Mapping[str, str]) -> Environment:
        """The registers of the variables that something later speaks of."""
        if not registers:
            return ()
        bound = self._bound(done)
        later = {name for names in self._speaks.values() if not names <= bound for name in names}
        variables = self._letters.observations.variables
        later.update(name for index in self._ready if not done >> index & 1 for name in variables[index])
        return tuple(sorted((name, register) for name, register in registers.items() if name in later))


def _ways(before: tuple[tuple[int, int], ...], done: int) -> int:
    """The scenarios in which an occurrence may be next."""
    ways = 0
    for earlier, scenarios in before:
        if not earlier & ~done:
            ways |= scenarios
    return ways


def _undominated(partials: dict[Partial, int]) -> dict[Partial, int]:
    """Under `scattered` a partial match that another one of the same scenario contains has nothing to add."""
    found: dict[Partial, int] = {}
    ordered = sorted(partials.items(), key=lambda item: (-item[0][0].bit_count(), item[0]))
    for (done, environment), scenarios in ordered:
        left = scenarios
        for (larger, _), others in found.items():
            if not done & ~larger:
                left &= ~others
                if not left:
                    break
        if left:
            found[done, environment] = left
    return found
