r"""Determinisation: every partial match at once, followed by sets of letters.

A configuration is a set of matched occurrences, the register of each variable that has to be remembered, and the scenarios it is a
partial match of; a state is a set of configurations. One event may be several letters. Each state lists its alternatives, larger sets
of letters first: `\/` takes the first that fits, so none needs a negation, and an alternative that detects comes before all others.
Where no alternative fits the monitor reports ⊥ at that very event; under `scattered` the state stays.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final, NamedTuple, TypeAlias

from backends.rml.writer.conditions import NEVER, Inexpressible, when_true
from backends.rml.writer.event_types import RmlTypes
from backends.rml.writer.observations import Call, Observations, Registers
from backends.rml.writer.scenarios import BitScenario
from backends.rml.writer.terms import ALL, AND, ANY, MAX_DEPTH, NONE, OR, Written, join, named, then
from rvaft.analysis.unification import Overlaps, implies
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, conjuncts, variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, mask_of, union

# -- letters: what one event has to be for a partial match to go on, and how that is written ---------------------------


class RmlLetter(NamedTuple):
    """An event that matches the call and fulfils the guards."""

    call: Call
    guards: frozenset[Guard] = frozenset()


class GuardRefused(Exception):
    """The guard of a node cannot be written; its arguments are the node and the reason."""


class RmlLetters:
    """The letters of one translation; each is called after the node that it was first needed for."""

    def __init__(self, observations: Observations, types: RmlTypes) -> None:
        self.observations = observations
        self.types = types
        self._rank = {name: position for position, name in enumerate(observations.tree.order)}
        self._nodes: dict[Call, str] = {}
        self._guards: dict[Guard, tuple[str, tuple[Guard, ...]]] = {}
        self._texts: dict[RmlLetter, tuple[str, ...]] = {}

    def letter(self, index: int, registers: Mapping[str, str], guards: Iterable[str]) -> RmlLetter | None:
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
            instances.update((instance,) if conditions else ())
        return RmlLetter(call, frozenset(instances))

    def _conditions(self, guard: Guard, node: str) -> tuple[Guard, ...]:
        if guard not in self._guards:
            try:
                self._guards[guard] = (node, conjuncts(when_true(guard)))
            except Inexpressible as error:
                raise GuardRefused(node, str(error)) from None
        return self._guards[guard][1]

    def texts(self, letter: RmlLetter) -> tuple[str, ...]:
        """The event types, applied, that an event has to match all at once; the first one binds."""
        if letter not in self._texts:
            guards = sorted((self._guards[g] for g in letter.guards), key=lambda g: (self._rank[g[0]], repr(g[1])))
            conditions = [(condition, name) for name, found in guards for condition in found]
            self._texts[letter] = tuple(self.types.observed(letter.call, conditions, self._nodes[letter.call]))
        return self._texts[letter]

    def all_texts(self, letters: Iterable[RmlLetter]) -> list[Written]:
        """Those of several letters, each once."""
        return [named(text) for text in dict.fromkeys(text for letter in letters for text in self.texts(letter))]


# -- which sets of letters one event can be at once, the largest first; bit i stands for the i-th letter ---------------

Combination: TypeAlias = tuple[tuple[RmlLetter, ...], int]
"""The letters that have to be written, and all the letters that the event then is."""


class Combinations:
    """The combinations of some letters, of which some detect; `count` is called for each before it is looked at, and may raise."""

    def __init__(
        self, tree: RVAFT, moves: Mapping[RmlLetter, bool], bound: frozenset[str], count: Callable[[], None]
    ) -> None:
        self._letters = list(moves)
        self._count = count
        self._calls = list(dict.fromkeys(letter.call for letter in moves))
        number = {call: position for position, call in enumerate(self._calls)}
        self._call = [number[letter.call] for letter in moves]
        patterns = [call.pattern(tree) for call in self._calls]
        overlaps = Overlaps(patterns)
        self._near = [overlaps.compatible(i) for i in range(len(patterns))]
        self._implies = [
            mask_of(j for j in bits(near) if i == j or implies(patterns[i], patterns[j], bound))
            for i, near in enumerate(self._near)
        ]
        self._facts = list(dict.fromkeys(guard for letter in moves for guard in letter.guards))
        place = {guard: position for position, guard in enumerate(self._facts)}
        self._guards = [mask_of(place[guard] for guard in letter.guards) for letter in moves]
        detecting = [i for i, detects in enumerate(moves.values()) if detects]
        self._detecting = [
            i
            for i in detecting
            if not any(j < i or not self._entails(j, i) for j in self._entailed(i, detecting) if j != i)
        ]
        self._others = [
            i for i, detects in enumerate(moves.values()) if not detects and not self._entailed(i, self._detecting)
        ]

    def _entails(self, letter: int, other: int) -> bool:
        called = self._implies[self._call[letter]] >> self._call[other] & 1
        return bool(called) and not self._guards[other] & ~self._guards[letter]

    def _entailed(self, letter: int, others: list[int]) -> list[int]:
        """The letters that every event is that is this one."""
        alone = not self._guards[letter] and self._implies[self._call[letter]].bit_count() == 1
        return [] if alone else [other for other in others if self._entails(letter, other)]

    def all(self) -> Iterator[Combination]:
        """Each letter that detects, alone; then all closed sets of the others, larger ones before those they contain."""
        called = [self._call[i] for i in self._others]
        known = mask_of(called)
        apart = known.bit_count() == len(called) and all(self._near[call] & known == 1 << call for call in called)
        for i in (*self._detecting, *(self._others if apart else ())):
            self._count()
            yield (self._letters[i],), 1 << i
        if not apart:
            yield from sorted(self._closed(), key=lambda combination: -combination[1].bit_count())

    def _closed(self) -> Iterator[Combination]:
        """An event that is some letters is also those that their calls imply and their guards allow."""
        every = range(len(self._letters))
        implied, near = (
            [mask_of(j for j in self._others if related[self._call[i]] >> self._call[j] & 1) for i in every]
            for related in (self._implies, self._near)
        )

        def closure(fits: int) -> int:
            allowed = union(self._guards[i] for i in bits(fits))
            return mask_of(i for i in bits(union(implied[i] for i in bits(fits))) if not self._guards[i] & ~allowed)

        single = list(dict.fromkeys(closure(1 << i) for i in self._others))
        agenda, seen = list(single), set(single)
        for fits in agenda:
            self._count()
            if any(self._covers(fits, i) for i in self._detecting):
                continue  # the alternative that detects comes first
            yield self._written(fits), fits
            for other in single:
                if other & ~fits and all(other & ~near[i] == 0 for i in bits(fits)):
                    more = closure(fits | other)
                    if more not in seen:
                        seen.add(more)
                        agenda.append(more)

    def _covers(self, fits: int, letter: int) -> bool:
        allowed = union(self._guards[i] for i in bits(fits))
        return not self._guards[letter] & ~allowed and any(
            self._implies[self._call[i]] >> self._call[letter] & 1 for i in bits(fits)
        )

    def _written(self, fits: int) -> tuple[RmlLetter, ...]:
        """One letter per call, with all its guards, without calls that another one implies and that bind nothing more."""
        guards: dict[int, int] = defaultdict(int)
        for i in bits(fits):
            guards[self._call[i]] |= self._guards[i]

        def spares(one: int, other: int) -> bool:
            implied = self._implies[one] >> other & 1 and not guards[other] & ~guards[one]
            return bool(implied) and {*self._calls[other].registers} <= {*self._calls[one].registers}

        needed = [
            call
            for call in guards
            if not any(spares(one, call) and (one < call or not spares(call, one)) for one in guards if one != call)
        ]
        return tuple(RmlLetter(self._calls[c], frozenset(self._facts[g] for g in bits(guards[c]))) for c in needed)


# -- states ------------------------------------------------------------------------------------------------------------

ACCEPT: Final = -1
STAY: Final = -2
Environment: TypeAlias = tuple[tuple[str, str], ...]
"""The register of each remembered variable, by name."""
Partial: TypeAlias = tuple[int, Environment]


class MatchState(NamedTuple):
    """Partial matches, each with the scenarios it belongs to, and the registers bound by now."""

    partials: frozenset[tuple[Partial, int]]
    bound: frozenset[str] = frozenset()


class RmlAlternative(NamedTuple):
    """On an event that is all the letters, go on to the target; `fits` is the set of all letters it then is."""

    letters: tuple[RmlLetter, ...]
    fits: int
    target: int


@dataclass(slots=True)
class Advance:
    """Where one letter leads."""

    partials: dict[Partial, int] = field(default_factory=lambda: defaultdict(int))
    detects: bool = False


class Determinised:
    """The alternatives of each state; state 0 is the first. Raises `TooLarge` beyond `limit` alternatives, rejected ones included."""

    def __init__(
        self,
        scenarios: list[BitScenario],
        letters: RmlLetters,
        registers: Registers,
        semantics: Semantics,
        *,
        limit: int,
    ) -> None:
        self._letters = letters
        self._tree = letters.observations.tree
        self._variables = letters.observations.variables
        self._registers = registers
        self._scattered = semantics is Semantics.SCATTERED
        self._limit = limit
        self._size = 0
        self._known: dict[int, frozenset[str]] = {}
        self._prepare(scenarios)
        start = MatchState(frozenset({((0, ()), (1 << len(scenarios)) - 1)}))
        self._number = {start: 0}
        self._waiting = [start]
        self.alternatives: list[list[RmlAlternative]] = []
        for state in self._waiting:
            self.alternatives.append(list(self._alternatives(state)))

    def _prepare(self, scenarios: list[BitScenario]) -> None:
        """Turn the scenarios round: for each occurrence and guard, the scenarios that have it."""
        ready: dict[int, dict[int, int]] = {}
        self._complete: dict[int, int] = defaultdict(int)
        self._guarded: dict[str, int] = defaultdict(int)
        for number, scenario in enumerate(scenarios):
            self._complete[scenario.occurrences] |= 1 << number
            for index, before in scenario.before.items():
                ready.setdefault(index, defaultdict(int))[before] |= 1 << number
            for name in scenario.guards:
                self._guarded[name] |= 1 << number
        self._ready = {index: tuple(ways.items()) for index, ways in sorted(ready.items())}
        guards = {name: self._tree.nodes[name].when for name in self._tree.order if name in self._guarded}
        self._speaks = {name: frozenset(variables(when)) for name, when in guards.items() if when is not None}

    def _alternatives(self, state: MatchState) -> Iterator[RmlAlternative]:
        moves = self._moves(state)
        if self._scattered:
            moves = {letter: move for letter, move in moves.items() if move.detects or self._helps(state, move)}
        made = list(moves.values())
        detecting = {letter: move.detects for letter, move in moves.items()}
        for letters, fits in Combinations(self._tree, detecting, state.bound, self._count).all():
            fitting = [made[i] for i in bits(fits)]
            detects = any(move.detects for move in fitting)
            target = ACCEPT if detects else self._target(state, fitting, letters)
            if target != STAY:
                yield RmlAlternative(letters, fits, target)
        if self._scattered:
            yield RmlAlternative((), 0, STAY)

    def _count(self) -> None:
        """One more alternative, in whatever state."""
        self._size += 1
        if self._size > self._limit:
            raise TooLarge("alternatives of the RML equations", limit=self._limit)

    def _merged(self, state: MatchState, moves: Iterable[Advance]) -> frozenset[tuple[Partial, int]]:
        merged: dict[Partial, int] = defaultdict(int, state.partials if self._scattered else ())
        for move in moves:
            for partial, mask in move.partials.items():
                merged[partial] |= mask
        return frozenset((_undominated(merged) if self._scattered else merged).items())

    def _helps(self, state: MatchState, move: Advance) -> bool:
        return self._merged(state, [move]) != state.partials

    def _target(self, state: MatchState, moves: list[Advance], written: tuple[RmlLetter, ...]) -> int:
        bound = state.bound.union(*(letter.call.registers for letter in written))
        after = MatchState(self._merged(state, moves), bound)
        if self._scattered and after == state:
            return STAY
        if after not in self._number:
            self._number[after] = len(self._number)
            self._waiting.append(after)
        return self._number[after]

    def _moves(self, state: MatchState) -> dict[RmlLetter, Advance]:
        """The letters that advance some partial match, and where each leads."""
        candidates = [
            (done, dict(environment), index, mask & ways)
            for (done, environment), mask in sorted(state.partials)
            for index, before in self._ready.items()
            if not done >> index & 1
            if mask & (ways := union(scenarios for earlier, scenarios in before if not earlier & ~done))
        ]
        chosen = self._registers.choose(((index, known.keys()) for _, known, index, _ in candidates), state.bound)
        moves: dict[RmlLetter, Advance] = {}
        for done, known, index, mask in candidates:
            registers = self._registers.assign(index, known, chosen)
            after = done | 1 << index
            partial = (after, self._remembered(after, registers))
            for part, guards in self._split(done, after, mask):
                letter = self._letters.letter(index, registers, guards)
                if letter is not None:
                    move = moves.setdefault(letter, Advance())
                    move.detects = move.detects or bool(self._complete.get(after, 0) & part)
                    move.partials[partial] |= part
        return moves

    def _split(self, done: int, after: int, mask: int) -> list[tuple[int, tuple[str, ...]]]:
        """The scenarios, parted by which guards get their last variable now."""
        parts: list[tuple[int, tuple[str, ...]]] = [(mask, ())]
        for name, spoken in self._speaks.items():
            if spoken <= self._bound(after) and not spoken <= self._bound(done):
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
            self._known[done] = frozenset().union(*(self._variables[index] for index in bits(done)))
        return self._known[done]

    def _remembered(self, done: int, registers: Mapping[str, str]) -> Environment:
        """The registers of the variables that something later speaks of."""
        if not registers:
            return ()
        later = {name for names in self._speaks.values() if not names <= self._bound(done) for name in names}
        later.update(name for index in self._ready if not done >> index & 1 for name in self._variables[index])
        return tuple(sorted((name, register) for name, register in registers.items() if name in later))


def _undominated(partials: Mapping[Partial, int]) -> dict[Partial, int]:
    """Under `scattered` a partial match that another one of the same scenario contains has nothing to add."""
    found: dict[Partial, int] = {}
    for partial, scenarios in sorted(partials.items(), key=lambda item: (-item[0][0].bit_count(), item[0])):
        left = scenarios
        for (larger, _), others in found.items():
            if not partial[0] & ~larger:
                left &= ~others
                if not left:
                    break
        if left:
            found[partial] = left
    return found


# -- states with the same future made one, and alternatives dropped that a later one does as well ----------------------

StateClass: TypeAlias = tuple[tuple[tuple[RmlLetter, ...], int], ...]
"""The alternatives: on an event that is all the letters, go on to the target, a class (or `ACCEPT` or `STAY`)."""


def minimised(states: list[list[RmlAlternative]]) -> list[StateClass]:
    """The classes, every one before those that lead to it; the last is that of the first state."""
    number: dict[StateClass, int] = {}
    of_state: dict[int, int] = {}
    for state in _later_first(states):
        kept: list[RmlAlternative] = []
        for one in reversed(states[state]):  # not where the next one that would fit leads to the same
            target = of_state.get(one.target, one.target)
            following = next((other for other in kept if not other.fits & ~one.fits), None)
            if following is None or following.target != target:
                kept.insert(0, one._replace(target=target))
        choices = tuple((one.letters, one.target) for one in kept)
        of_state[state] = number.setdefault(choices, len(number))
    assert of_state[0] == len(number) - 1, "the first state lies before all others"
    return list(number)


def _later_first(states: list[list[RmlAlternative]]) -> Iterator[int]:
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
            agenda.extend((one.target, False) for one in states[state] if one.target >= 0)


def equations(classes: list[StateClass], letters: RmlLetters) -> tuple[Written, list[tuple[str, Written]]]:
    """The expression for the first state, and the equations it needs: one for each class that several others lead to.

    The others are written where they are needed, unless that would be too deep inside others.
    """
    uses = Counter(target for choices in classes for target in {target for _, target in choices})
    apart = {number for number, choices in enumerate(classes) if uses[number] > 1 or any(t == STAY for _, t in choices)}
    height: dict[int, int] = {}
    for number, choices in enumerate(classes):
        height[number] = 1 + max((height[t] for _, t in choices if t >= 0 and t not in apart), default=0)
        if height[number] >= MAX_DEPTH:
            height[number] = 0
    order = dict.fromkeys([len(classes) - 1])
    for number in (agenda := list(order)):  # as a reader meets them
        fresh = [target for _, target in classes[number] if target >= 0 and target not in order]
        agenda += dict.fromkeys(fresh)
        order.update(dict.fromkeys(fresh))
    own = [number for number in order if number in apart or height[number] == 0]
    names = {number: named(f"S{position}") for position, number in enumerate(own, 1)}
    bodies: list[Written] = []

    def body(number: int) -> Written:
        parts: list[Written] = []
        after = {ACCEPT: ALL, STAY: names.get(number, NONE)}
        texts = [(letters.all_texts(found), target) for found, target in classes[number]]
        for (target, joint), run in groupby(texts, key=lambda one: (one[1], one[1] == ACCEPT and len(one[0]) > 1)):
            if joint:  # detecting by several types at once has a form of its own
                parts += [join(AND, (then(event, ALL) for event in events)) for events, _ in run]
            else:  # neighbours that lead to the same are written as one
                heads = [join(AND, events) if events else ANY for events, _ in run]
                parts.append(then(join(OR, heads), after.get(target) or names.get(target) or bodies[target]))
        return join(OR, parts) if parts else NONE  # guards that no event can fulfil

    for number in range(len(classes)):
        bodies += [body(number)]
    return names.get(len(classes) - 1) or bodies[-1], [(names[number].word, bodies[number]) for number in names]
