r"""Determinisation: every partial match at once, followed by sets of letters.

A configuration is a set of matched occurrences, the register of each variable that has to be remembered, and the scenarios it is a
partial match of; a state is a set of configurations. One event may be several letters. Each state lists its alternatives, larger sets
of letters first: `\/` takes the first that fits, so none needs a negation, and an alternative that detects comes before all others.
Where no alternative fits the monitor reports ⊥ at that very event; under `scattered` the state stays.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from typing import Final, Protocol

from backends.rml.writer.conditions import NEVER, Inexpressible, when_true
from backends.rml.writer.event_types import RmlTypes
from backends.rml.writer.observations import Call, Observations, Registers
from backends.rml.writer.scenarios import BitScenario
from backends.rml.writer.terms import ALL, AND, ANY, MAX_DEPTH, NONE, OR, Written, join, named, then
from rvaft.analysis.unification import Overlaps, implies
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, conjuncts
from rvaft.model.guards import variables as guard_variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits

# Letters: what one event has to be for a partial match to go on, and how that is written.


@dataclass(frozen=True, slots=True)
class Letter:
    """An event that matches the call and fulfils the guards."""

    call: Call
    guards: frozenset[Guard] = frozenset()


class GuardRefused(Exception):
    """The guard of a node cannot be written."""

    def __init__(self, node: str, reason: str) -> None:
        self.node = node
        self.reason = reason
        super().__init__(reason)


class Letters:
    """The letters of one translation; each is called after the node that it was first needed for."""

    def __init__(self, observations: Observations, types: RmlTypes) -> None:
        self.observations = observations
        self.types = types
        self._rank = {name: position for position, name in enumerate(observations.tree.order)}
        self._nodes: dict[Call, str] = {}
        self._guards: dict[Guard, tuple[str, tuple[Guard, ...]]] = {}
        self._texts: dict[Letter, tuple[str, ...]] = {}

    def letter(self, index: int, registers: dict[str, str], guards: Iterable[str]) -> Letter | None:
        """The letter of an occurrence with the guards of some nodes, or None where no event can fulfil it."""
        tree = self.observations.tree
        call = self.observations.call(index, registers)
        self._nodes.setdefault(call, tree.occurrences[index])
        instances: set[Guard] = set()
        for node in guards:
            when = tree.nodes[node].when
            assert when is not None
            instance = self.observations.instance(when, index, registers)
            conditions = self._conditions(instance, node)
            if NEVER in conditions:
                return None
            if conditions:
                instances.add(instance)
        return Letter(call, frozenset(instances))

    def _conditions(self, guard: Guard, node: str) -> tuple[Guard, ...]:
        if guard not in self._guards:
            try:
                self._guards[guard] = (node, conjuncts(when_true(guard)))
            except Inexpressible as error:
                raise GuardRefused(node, str(error)) from None
        return self._guards[guard][1]

    def texts(self, letter: Letter) -> tuple[str, ...]:
        """The event types, applied, that an event has to match all at once; the first one binds."""
        if letter not in self._texts:
            node = self._nodes[letter.call]
            guards = sorted((self._guards[guard] for guard in letter.guards), key=self._place)
            conditions = [(condition, name) for name, found in guards for condition in found]
            self._texts[letter] = tuple(self.types.observed(letter.call, conditions, node))
        return self._texts[letter]

    def _place(self, guard: tuple[str, tuple[Guard, ...]]) -> tuple[int, str]:
        return self._rank[guard[0]], repr(guard[1])


# Which sets of letters one event can be at once, the largest first. A set is an integer, bit i standing for the i-th letter.


class Move(Protocol):
    """Where a letter leads; all that matters here is whether it detects."""

    detects: bool


@dataclass(frozen=True, slots=True)
class Combination:
    """All the letters that an event is (`fits`), and those that have to be written to say so."""

    letters: tuple[Letter, ...]
    fits: int


class Combinations:
    """The combinations of some letters; `count` is called for each before it is looked at, and may raise."""

    def __init__(
        self, tree: RVAFT, moves: Mapping[Letter, Move], bound: frozenset[str], count: Callable[[], None]
    ) -> None:
        self.letters = list(moves)
        self._count = count
        calls = list(dict.fromkeys(letter.call for letter in self.letters))
        number = {call: position for position, call in enumerate(calls)}
        self._call = [number[letter.call] for letter in self.letters]
        patterns = [call.pattern(tree) for call in calls]
        overlaps = Overlaps(patterns)
        self._overlap = [overlaps.compatible(i) for i in range(len(patterns))]
        self._implies = [
            sum(1 << j for j in bits(near) if i == j or implies(patterns[i], patterns[j], bound))
            for i, near in enumerate(self._overlap)
        ]
        self._registers = [frozenset(call.registers) for call in calls]
        self._calls: Sequence[Call] = calls
        facts = dict.fromkeys(guard for letter in self.letters for guard in letter.guards)
        bit = {guard: 1 << position for position, guard in enumerate(facts)}
        self._facts: Sequence[Guard] = list(facts)
        self._guards = [sum(bit[guard] for guard in letter.guards) for letter in self.letters]
        everywhere = range(len(self.letters))
        self.detecting = self._weakest([i for i, letter in enumerate(self.letters) if moves[letter].detects])
        self.others = [
            i
            for i in everywhere
            if not moves[self.letters[i]].detects
            and not (self._says_more(i) and any(self._entails(i, other) for other in self.detecting))
        ]

    def all(self) -> Iterator[Combination]:
        """Each letter that detects, alone; then all closed sets of the others, larger ones before those they contain."""
        for i in self.detecting:
            self._count()
            yield Combination((self.letters[i],), 1 << i)
        called = [self._call[i] for i in self.others]
        known = sum(1 << call for call in set(called))
        if len(set(called)) == len(called) and all(self._overlap[call] & known == 1 << call for call in called):
            for i in self.others:
                self._count()
                yield Combination((self.letters[i],), 1 << i)
            return
        yield from sorted(self._closed(), key=lambda combination: -combination.fits.bit_count())

    def _closed(self) -> Iterator[Combination]:
        """An event that is some letters is also those that their calls imply and their guards allow."""
        single = list(dict.fromkeys(self._closure(1 << i) for i in self.others))
        seen = dict.fromkeys(single)
        agenda = list(single)
        for fits in agenda:
            self._count()
            if any(self._covers(fits, i) for i in self.detecting):
                continue  # the alternative that detects comes first
            yield Combination(self._written(fits), fits)
            excluded = 0
            for i in bits(fits):
                excluded |= self._excluded[i]
            for other in single:
                if other & ~fits and not other & excluded:
                    union = self._closure(fits | other)
                    if union not in seen:
                        seen[union] = None
                        agenda.append(union)

    def _closure(self, fits: int) -> int:
        allowed, possible = self._given(fits)
        return sum(1 << i for i in bits(possible) if not self._guards[i] & ~allowed)

    def _covers(self, fits: int, letter: int) -> bool:
        allowed, _ = self._given(fits)
        return not self._guards[letter] & ~allowed and any(
            self._implies[self._call[i]] >> self._call[letter] & 1 for i in bits(fits)
        )

    def _given(self, fits: int) -> tuple[int, int]:
        """The guards that hold, and the letters whose calls match."""
        allowed = possible = 0
        for i in bits(fits):
            allowed |= self._guards[i]
            possible |= self._implied[i]
        return allowed, possible

    @cached_property
    def _implied(self) -> list[int]:
        return self._related(lambda i, j: self._implies[self._call[i]] >> self._call[j] & 1)

    @cached_property
    def _excluded(self) -> list[int]:
        return self._related(lambda i, j: not self._overlap[self._call[i]] >> self._call[j] & 1)

    def _related(self, test: Callable[[int, int], int]) -> list[int]:
        return [sum(1 << j for j in self.others if test(i, j)) for i in range(len(self.letters))]

    def _written(self, fits: int) -> tuple[Letter, ...]:
        """One letter per call, with all its guards, without calls that another one implies and that bind nothing more."""
        guards: dict[int, int] = {}
        for i in bits(fits):
            guards[self._call[i]] = guards.get(self._call[i], 0) | self._guards[i]

        def spares(one: int, other: int) -> bool:
            return (
                bool(self._implies[one] >> other & 1)
                and not guards[other] & ~guards[one]
                and self._registers[other] <= self._registers[one]
            )

        needed = [
            call
            for call in guards
            if not any(spares(one, call) and (one < call or not spares(call, one)) for one in guards if one != call)
        ]
        return tuple(Letter(self._calls[c], frozenset(self._facts[g] for g in bits(guards[c]))) for c in needed)

    def _weakest(self, letters: list[int]) -> list[int]:
        return [
            i
            for i in letters
            if not self._says_more(i)
            or not any(self._entails(i, j) and (j < i or not self._entails(j, i)) for j in letters if j != i)
        ]

    def _says_more(self, letter: int) -> bool:
        """Whether the letter may entail another one at all."""
        return bool(self._guards[letter]) or self._implies[self._call[letter]].bit_count() > 1

    def _entails(self, letter: int, other: int) -> bool:
        called = self._implies[self._call[letter]] >> self._call[other] & 1
        return bool(called) and not self._guards[other] & ~self._guards[letter]


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


class Determinised:
    """The alternatives of each state; state 0 is the first. Raises `TooLarge` beyond `limit` alternatives, rejected ones included."""

    def __init__(
        self, scenarios: list[BitScenario], letters: Letters, registers: Registers, semantics: Semantics, *, limit: int
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

    def _prepare(self, scenarios: list[BitScenario]) -> None:
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


# States with the same future made one, and alternatives dropped that a later one does as well.


@dataclass(frozen=True, slots=True)
class Choice:
    """On an event that is all the letters, go on to the target, a class (or ACCEPT or STAY)."""

    letters: tuple[Letter, ...]
    target: int


Class = tuple[Choice, ...]


def minimised(states: list[list[Alternative]]) -> list[Class]:
    """The classes, every one before those that lead to it; the last is that of the first state."""
    number: dict[Class, int] = {}
    of_state: dict[int, int] = {}
    for state in _later_first(states):
        choices = _needed(
            [(Choice(a.letters, of_state.get(a.target, a.target)), a.fits) for a in states[state]],
        )
        of_state[state] = number.setdefault(choices, len(number))
    classes = list(number)
    first = of_state[0]
    assert first == len(classes) - 1, "the first state lies before all others"
    return classes


def _needed(choices: list[tuple[Choice, int]]) -> Class:
    """Without a choice where the next one that would fit leads to the same."""
    kept: list[tuple[Choice, int]] = []
    for choice, fits in reversed(choices):
        following = next((other for other, less in kept if not less & ~fits), None)
        if following is None or following.target != choice.target:
            kept.insert(0, (choice, fits))
    return tuple(choice for choice, _ in kept)


def _later_first(states: list[list[Alternative]]) -> Iterator[int]:
    """The states, each after all that it leads to; the only loops are STAY, so there is such an order."""
    done: set[int] = set()
    agenda = [(0, False)]
    while agenda:
        state, visited = agenda.pop()
        if visited:
            yield state
        elif state not in done:
            done.add(state)
            agenda.append((state, True))
            agenda.extend((a.target, False) for a in states[state] if a.target not in (ACCEPT, STAY))


# Equations for an automaton: one per class that several others lead to, the others written where they are needed.


def equations(classes: list[Class], letters: Letters) -> tuple[Written, list[tuple[str, Written]]]:
    """The expression for the first state, and the equations it needs."""
    return _Writer(classes, letters).result()


class _Writer:
    def __init__(self, classes: list[Class], letters: Letters) -> None:
        self.classes = classes
        self.letters = letters
        self.first = len(classes) - 1
        self.uses = Counter(target for made in classes for target in {choice.target for choice in made})
        self.names = self._names()

    def result(self) -> tuple[Written, list[tuple[str, Written]]]:
        terms: dict[int, Written] = {}
        for number, choices in enumerate(self.classes):
            body = self._body(number, choices, terms)
            name = self.names.get(number)
            terms[number] = body if name is None else named(name)
            self.bodies[number] = body
        made = [(name, self.bodies[number]) for number, name in self.names.items()]
        return terms[self.first], made

    def _names(self) -> dict[int, str]:
        """Names for the classes that get an equation, in the order in which a reader meets them."""
        self.bodies: dict[int, Written] = {}
        deep = self._deep()
        order, seen = [self.first], {self.first}
        for number in order:
            for choice in self.classes[number]:
                if choice.target >= 0 and choice.target not in seen:
                    seen.add(choice.target)
                    order.append(choice.target)
        named = [number for number in order if number in deep or self._shared(number)]
        return {number: f"S{position}" for position, number in enumerate(named, 1)}

    def _shared(self, number: int) -> bool:
        return self.uses[number] > 1 or any(choice.target == STAY for choice in self.classes[number])

    def _deep(self) -> set[int]:
        """Classes that would be written too deep inside others."""
        height: dict[int, int] = {}
        deep: set[int] = set()
        for number, choices in enumerate(self.classes):
            below = [height[c.target] for c in choices if c.target >= 0 and not self._shared(c.target)]
            height[number] = 1 + max(below, default=0)
            if height[number] >= MAX_DEPTH:
                deep.add(number)
                height[number] = 0
        return deep

    def _body(self, number: int, choices: Class, terms: dict[int, Written]) -> Written:
        parts: list[Written] = []
        for (target, joint), group in groupby(choices, key=self._alike):
            run = list(group)
            if joint:
                parts += [join(AND, (then(event, ALL) for event in self._events(choice))) for choice in run]
                continue
            heads = [join(AND, self._events(choice)) if choice.letters else ANY for choice in run]
            after = {ACCEPT: ALL, STAY: named(self.names.get(number, ""))}.get(target) or terms[target]
            parts.append(then(join(OR, heads), after))
        return join(OR, parts) if parts else NONE  # guards that no event can fulfil

    def _alike(self, choice: Choice) -> tuple[int, bool]:
        """Neighbours that lead to the same are written as one; detecting by several types at once has a form of its own."""
        return choice.target, choice.target == ACCEPT and len(self._events(choice)) > 1

    def _events(self, choice: Choice) -> list[Written]:
        found = dict.fromkeys(text for letter in choice.letters for text in self.letters.texts(letter))
        return [named(text) for text in found]
