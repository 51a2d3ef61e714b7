r"""Determinisation: subset construction over the partial matches of all feasible scenarios.

A partial match has matched occurrences, a register per remembered variable, and its scenarios. A
state is a set of partial matches. One event may satisfy several letters. Each state lists its
alternatives with larger letter sets first: `\/` takes the first that fits, so no negation is
needed. Detecting alternatives come first. If no alternative fits, the monitor reports ⊥; under
`scattered` the state stays. Under `consecutive`, every state includes the empty partial match, and
the first state follows. Bit i of a bit set is the i-th occurrence, scenario or letter.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from itertools import count, groupby
from typing import Final, NamedTuple, TypeAlias

from backends.rml.writer.event_types import Call
from backends.rml.writer.letters import RmlLetter, RmlLetters, Where
from backends.rml.writer.terms import ALL, AND, ANY, MAX_DEPTH, NONE, OR, RmlNames, Written, join, named, then
from rvaft.core.overlaps import Overlaps, compatible, implies
from rvaft.core.property import Condition
from rvaft.core.scenarios import scenarios
from rvaft.errors import TooLarge, TreeError
from rvaft.model import patterns
from rvaft.model.guards import variables
from rvaft.model.nodes import Side
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, mask_of, union

WORK: Final = 50
"""Scenario nodes per scenario of the limit, and steps of partial matches per alternative."""

# Scenarios. `scattered` skips events, so a VOT keeps exactly K children.


class BitScenario(NamedTuple):
    """Occurrences, the predecessors of each occurrence, conditions over variables, and absent events."""

    occurrences: int
    before: tuple[tuple[int, int], ...]
    guards: frozenset[Condition]
    absent: tuple["AbsentEvent", ...] = ()


class AbsentEvent(NamedTuple):
    """An event that must be absent between the first and the last of some occurrences, or `before` them."""

    letter: RmlLetter
    occurrences: int
    before: bool

    def breaks(self, done: int) -> bool:
        """Return whether it breaks a partial match with these occurrences."""
        begun = bool(self.occurrences & done)
        return not begun if self.before else begun and bool(self.occurrences & ~done)


def feasible_scenarios(letters: RmlLetters, semantics: Semantics, *, limit: int) -> list[BitScenario]:
    """Return the distinct feasible scenarios.

    Raises `TooLarge` beyond `limit`, and `TreeError` if there is none, one has no occurrence, or
    one has an unbound guard.
    """
    prop = letters.prop
    index, root = {event: position for position, event in enumerate(prop.events)}, prop.tree.root
    minimal = semantics is Semantics.SCATTERED and not prop.absences  # an absent event may be one that is used
    found: dict[BitScenario, None] = {}
    nodes, width = 0, 1 + len(index) // 1000  # larger bit sets are slower
    for one in scenarios(prop, minimal=minimal, limit=limit):
        nodes += (
            len(one.kept) + len(prop.parts) // 4
        ) * width  # finding a scenario also costs the size of the property
        if nodes > WORK * limit:
            raise TooLarge(f"nodes of scenarios, {WORK} allowed for each scenario", limit=limit)
        number = [index[event] for event in one.events]
        before = ((number[i], mask_of(number[j] for j in bits(one.before[i]))) for i in range(len(number)))
        absent = (
            AbsentEvent(letter, mask_of(index[event] for event in part), clause.side is Side.BEFORE)
            for clause, part in one.absences
            if (letter := letters.absent(clause)) is not None
        )
        found.setdefault(BitScenario(mask_of(number), tuple(before), frozenset(one.conditions), tuple(absent)))
    if not found:
        raise TreeError("no scenario is feasible", rule="no-scenario", nodes=[root])
    for scenario in found:
        if not scenario.occurrences:
            raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario", nodes=[root])
        bound = {name for i in bits(scenario.occurrences) for name in patterns.variables(prop.events[i].pattern)}
        for condition in scenario.guards:
            for variable in variables(condition.guard):
                if variable not in bound:
                    node = condition.source.node
                    message = f"the guard of {node} uses {variable}, which is unbound in one of its scenarios"
                    raise TreeError(message, rule="unbound-variable", nodes=[node])
    return list(found)


# The sets of letters that one event can satisfy, largest first.

Combination: TypeAlias = tuple[tuple[RmlLetter, ...], int]
"""The letters to write, and all letters that the event then satisfies."""


def combinations(
    tree: RVAFT, letters: list[RmlLetter], detecting: int, bound: frozenset[str], counted: Callable[[], None]
) -> Iterator[Combination]:
    """Yield each detecting letter alone, then all closed sets of the others, larger ones first.

    A set is closed under implication of calls and guards. `counted` is called before each set is
    examined, and may raise.
    """
    calls = list(dict.fromkeys(letter.call for letter in letters))
    call_patterns = [call.pattern(tree) for call in calls]
    overlaps = Overlaps(call_patterns)
    near = [overlaps.compatible(i) for i in range(len(calls))]
    implied = [
        mask_of(j for j in bits(near[i]) if i == j or implies(pattern, call_patterns[j], bound))
        for i, pattern in enumerate(call_patterns)
    ]
    number = {call: position for position, call in enumerate(calls)}
    call_of = [number[letter.call] for letter in letters]
    having = [0] * len(calls)
    for i, call in enumerate(call_of):
        having[call] |= 1 << i
    facts = list(dict.fromkeys(guard for letter in letters for guard in letter.guards))
    place = {guard: position for position, guard in enumerate(facts)}
    guards = [mask_of(place[guard] for guard in letter.guards) for letter in letters]

    def entailed(fits: int, among: int) -> int:
        allowed = union(guards[i] for i in bits(fits))
        reached = union(having[call] for call in bits(union(implied[call_of[i]] for i in bits(fits))))
        return mask_of(i for i in bits(reached & among) if not guards[i] & ~allowed)

    detects = mask_of(
        i
        for i in bits(detecting)
        if not any(j < i or not entailed(1 << j, 1 << i) for j in bits(entailed(1 << i, detecting & ~(1 << i))))
    )
    others = mask_of(i for i in range(len(letters)) if not detecting >> i & 1 and not entailed(1 << i, detects))
    for i in bits(detects):
        counted()
        yield (letters[i],), 1 << i
    single = list(dict.fromkeys(entailed(1 << i, others) for i in bits(others)))
    agenda, seen = list(single), set(single)
    found: list[Combination] = []
    for fits in agenda:
        counted()
        if entailed(fits, detects):
            continue  # the detecting alternative comes first
        written: dict[int, int] = defaultdict(int)  # one letter per call, with all its guards
        beside = others
        for i in bits(fits):
            written[call_of[i]] |= guards[i]
            beside &= union(having[call] for call in bits(near[call_of[i]]))
        needed = _unimplied(written, calls, implied)
        found.append((tuple(RmlLetter(calls[c], frozenset(facts[g] for g in bits(written[c]))) for c in needed), fits))
        for other in single if beside & ~fits else ():
            if other & ~fits and not other & ~beside:
                more = entailed(fits | other, others)
                if more not in seen:
                    seen.add(more)
                    agenda.append(more)
    yield from sorted(found, key=lambda combination: -combination[1].bit_count())


def _unimplied(guards: Mapping[int, int], calls: list[Call], implied: list[int]) -> list[int]:

    def spares(one: int, other: int) -> bool:
        covers = implied[one] >> other & 1 and not guards[other] & ~guards[one]
        return bool(covers) and {*calls[other].registers} <= {*calls[one].registers}

    return [
        call
        for call in guards
        if not any(spares(one, call) and (one < call or not spares(call, one)) for one in guards if one != call)
    ]


# States.

ACCEPT: Final = -1
STAY: Final = -2
Partial: TypeAlias = tuple[int, tuple[tuple[str, str], ...]]
Partials: TypeAlias = Mapping[Partial, int]


class MatchState(NamedTuple):
    """Partial matches with their scenarios, and the bound registers."""

    partials: frozenset[tuple[Partial, int]]
    bound: frozenset[str] = frozenset()


class RmlAlternative(NamedTuple):
    """A transition on an event that satisfies `letters`, and therefore all letters of `fits`."""

    letters: tuple[RmlLetter, ...]
    fits: int
    target: int


class Determinised:
    """The alternatives of each state; state 0 is the first.

    Raises `TooLarge` beyond `limit` alternatives, rejected ones included. In RML a variable is
    bound once. A register is named after its first variable, with a number if that name is already
    bound on the way to the state, or if one event could bind it twice.
    """

    def __init__(self, found: list[BitScenario], letters: RmlLetters, semantics: Semantics, *, limit: int) -> None:
        self._letters, self._tree, self._limit = letters, letters.tree, limit
        self._scattered = semantics is Semantics.SCATTERED
        self._anew = semantics is Semantics.CONSECUTIVE
        """Whether every state includes the empty partial match."""
        self._absent = [scenario.absent for scenario in found]
        self._absences = any(self._absent)
        absent = {one.letter.call.pattern(letters.tree) for some in self._absent for one in some}
        self._apart = not any(compatible(event.pattern, one) for event in letters.prop.events for one in absent)
        """No event of a match can be an absent one."""
        self.cyclic = self._anew or self._absences
        self._size = self._work = 0
        self._known: dict[int, frozenset[str]] = {}
        names = RmlNames()
        ordered = [name for name in self._tree.variables if name in letters.remembered]
        ordered += sorted(letters.remembered.difference(ordered))  # of counted events
        self._wanted = {name: names.fresh(name, otherwise="v") for name in ordered}
        self.registers: dict[str, None] = {}
        ready: dict[int, dict[int, int]] = {}  # for each occurrence, its predecessors and their scenarios
        self._complete: dict[int, int] = defaultdict(int)
        self._guarded: dict[Condition, int] = defaultdict(int)
        for number, scenario in enumerate(found):
            self._complete[scenario.occurrences] |= 1 << number
            for index, before in scenario.before:
                ready.setdefault(index, defaultdict(int))[before] |= 1 << number
            for condition in scenario.guards:
                self._guarded[condition] |= 1 << number
        self._ready = {index: tuple(ways.items()) for index, ways in sorted(ready.items())}
        guarded = (
            part for part in reversed(letters.prop.parts) if isinstance(part, Condition) and part in self._guarded
        )
        self._binding: dict[str, int] = defaultdict(int)
        """The occurrences of each variable."""
        for index in self._ready:
            for name in letters.variables[index]:
                self._binding[name] |= 1 << index
        self._condition_names = {condition: frozenset(variables(condition.guard)) for condition in guarded}
        self._start: Partials = {(0, ()): (1 << len(found)) - 1}
        start = MatchState(frozenset(self._start.items()))
        self._number = {start: 0}
        self._waiting = [start]
        self.alternatives = [list(self._alternatives(state)) for state in self._waiting]

    def _alternatives(self, state: MatchState) -> Iterator[RmlAlternative]:
        moves, detecting = self._moves(state)
        breaks = self._breaks(state)
        if self._scattered and not breaks:
            moves = {
                letter: partials
                for letter, partials in moves.items()
                if letter in detecting or self._merged(state, [partials]) != state.partials
            }
        made = list(dict.fromkeys((*moves, *breaks)))
        these = mask_of(i for i, letter in enumerate(made) if letter in detecting)
        for letters, fits in combinations(self._tree, made, these, state.bound, self._count):
            fitting = [made[i] for i in bits(fits)]
            target = ACCEPT
            if not fits & these:
                bound = state.bound.union(*(letter.call.registers for letter in letters))
                broken = [breaks[letter] for letter in fitting if letter in breaks]
                after = MatchState(self._merged(state, [moves.get(letter, {}) for letter in fitting], broken), bound)
                if self._scattered and not breaks and after == state:
                    continue
                if after not in self._number:
                    self._number[after] = len(self._number)
                    self._waiting.append(after)
                target = STAY if self._scattered and after == state else self._number[after]
            yield RmlAlternative(letters, fits, target)
        if self._scattered or self._anew:
            yield RmlAlternative((), 0, STAY if self._scattered else 0)

    def _count(self) -> None:
        self._size += 1
        if self._size > self._limit:
            raise TooLarge("alternatives of the RML equations", limit=self._limit)

    def _spend(self, steps: int) -> None:
        self._work += steps
        if self._work > WORK * self._limit:
            raise TooLarge(f"steps of partial matches, {WORK} allowed for each alternative", limit=self._limit)

    def _breaks(self, state: MatchState) -> dict[RmlLetter, dict[Partial, int]]:
        """Return the partial matches that absent events end."""
        found: dict[RmlLetter, dict[Partial, int]] = {}
        for partial, mask in sorted(state.partials) if self._absences else ():
            for number in bits(mask):
                self._spend(1 + len(self._absent[number]))
                for one in self._absent[number]:
                    if one.breaks(partial[0]):
                        found.setdefault(one.letter, defaultdict(int))[partial] |= 1 << number
        return found

    def _merged(
        self, state: MatchState, moves: Iterable[Partials], broken: Iterable[Partials] = ()
    ) -> frozenset[tuple[Partial, int]]:
        """Return the partial matches after the moves, without those that an absent event breaks.

        `scattered` drops a partial match that another one of the same scenario includes, and outlasts.
        """
        merged: dict[Partial, int] = defaultdict(int, state.partials if self._scattered else ())
        merged.update(self._start if self._anew else {})
        for partials in broken:
            for partial, mask in partials.items():
                merged[partial] &= ~mask
        for partials in moves:
            for partial, mask in partials.items():
                merged[partial] |= mask
        if not self._scattered:
            return frozenset(merged.items())
        found: dict[Partial, int] = {}
        for partial, mask in sorted(merged.items(), key=lambda item: (-item[0][0].bit_count(), item[0])):
            left = mask
            self._spend(len(found) // 10)  # much cheaper than a step of a match
            for (larger, _), others in found.items():
                if not partial[0] & ~larger:
                    same = left & others
                    left &= ~(self._outlasting(same, larger, partial[0]) if same and self._absences else same)
                    if not left:
                        break
            if left:
                found[partial] = left
        return frozenset(found.items())

    def _outlasting(self, scenarios: int, larger: int, smaller: int) -> int:
        """Return the scenarios in which absent events that break the larger match, now or later, break the smaller."""
        if not self._apart:
            return 0

        def breaks_both(one: AbsentEvent) -> bool:
            return one.before or not one.occurrences & larger or one.occurrences & smaller != 0

        return mask_of(
            number
            for number in bits(scenarios)
            if all(breaks_both(one) or not one.occurrences & ~larger for one in self._absent[number])
        )

    def _moves(self, state: MatchState) -> tuple[dict[RmlLetter, dict[Partial, int]], set[RmlLetter]]:
        self._spend(len(state.partials) * len(self._ready))
        candidates = [
            (done, dict(environment), index, mask & ways)
            for (done, environment), mask in sorted(state.partials)
            for index, before in self._ready.items()
            if not done >> index & 1
            if mask & (ways := union(members for earlier, members in before if not earlier & ~done))
        ]
        chosen = self._chosen(((index, known.keys()) for _, known, index, _ in candidates), state.bound)
        moves: dict[RmlLetter, dict[Partial, int]] = {}
        detecting: set[RmlLetter] = set()
        for done, known, index, mask in candidates:
            registers = dict(known)
            for where, name in self._letters.remembered_parameters(index):
                if name not in registers:
                    registers[name] = chosen[where]
            after = done | 1 << index
            partial = (after, self._remembered(after, registers))
            for part, guards in self._split(done, after, mask):
                letter = self._letters.letter(index, registers, guards)
                if letter is not None:
                    moves.setdefault(letter, defaultdict(int))[partial] |= part
                    if self._complete.get(after, 0) & part:
                        detecting.add(letter)
        return moves, detecting

    def _chosen(self, waiting: Iterable[tuple[int, Set[str]]], bound: Set[str]) -> dict[Where, str]:
        here: dict[Where, list[tuple[str, int]]] = {}
        for index, known in waiting:
            for where, name in self._letters.remembered_parameters(index):
                if name not in known:
                    here.setdefault(where, []).append((name, index))
        chosen: dict[Where, str] = {}
        takers: dict[str, list[int]] = defaultdict(list)
        loose = self._letters.loose
        for where, candidates in here.items():
            names, occurrences = zip(*candidates, strict=True)
            wanted = next(register for name, register in self._wanted.items() if name in names)
            chosen[where] = next(
                register
                for register in (wanted if number == 1 else f"{wanted}_{number}" for number in count(1))
                if register not in bound
                and not any(compatible(loose(i), loose(j)) for i in occurrences for j in takers[register])
            )
            takers[chosen[where]].extend(occurrences)
            self.registers.setdefault(chosen[where])
        return chosen

    def _split(self, done: int, after: int, mask: int) -> list[tuple[int, tuple[Condition, ...]]]:
        parts: list[tuple[int, tuple[Condition, ...]]] = [(mask, ())]
        for condition, names in self._condition_names.items():
            if names <= self._bound(after) and not names <= self._bound(done):
                having = self._guarded[condition]
                parts = [
                    (members, required)
                    for part, guards in parts
                    for members, required in ((part & having, (*guards, condition)), (part & ~having, guards))
                    if members
                ]
        return parts

    def _bound(self, done: int) -> frozenset[str]:
        if done not in self._known:
            self._known[done] = frozenset().union(*(self._letters.variables[index] for index in bits(done)))
        return self._known[done]

    def _remembered(self, done: int, registers: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
        if not registers:
            return ()
        bound = self._bound(done)
        open_ = {name for names in self._condition_names.values() if not names <= bound for name in names}
        kept = (item for item in registers.items() if item[0] in open_ or self._binding[item[0]] & ~done)
        return tuple(sorted(kept))


# Merging of states with the same future, and removal of redundant alternatives.

StateClass: TypeAlias = tuple[tuple[tuple[RmlLetter, ...], int], ...]


def minimised(states: list[list[RmlAlternative]]) -> list[StateClass]:
    """Return the classes of an acyclic automaton, targets first; that of state 0 is last."""
    number: dict[StateClass, int] = {}
    of_state: dict[int, int] = {}
    agenda = [(0, False)]
    while agenda:  # post-order; the only loops are STAY
        state, visited = agenda.pop()
        if state in of_state:
            continue
        if not visited:
            agenda.append((state, True))
            agenda.extend((one.target, False) for one in states[state] if one.target >= 0)
            continue
        choices = _without_idle(states[state], of_state)
        of_state[state] = number.setdefault(choices, len(number))
    assert of_state[0] == len(number) - 1, "the first state lies before all others"
    return list(number)


def refined(states: list[list[RmlAlternative]]) -> list[StateClass]:
    """Return the classes of an automaton with cycles by partition refinement; that of state 0 is
    last.
    """
    class_of = dict.fromkeys(range(len(states)), 0)
    while True:
        number: dict[tuple[int, StateClass], int] = {}
        made = {class_of[state]: _without_idle(own, class_of) for state, own in reversed([*enumerate(states)])}
        new = {
            state: number.setdefault((class_of[state], _without_idle(own, class_of)), len(number))
            for state, own in enumerate(states)
        }
        if len(number) == len(made):
            last = len(number) - 1
            return [
                tuple((some, last - to if to >= 0 else to) for some, to in made[one]) for one in range(last, -1, -1)
            ]
        class_of = new


def _without_idle(own: list[RmlAlternative], class_of: Mapping[int, int]) -> StateClass:
    """Return the alternatives by class, without those that the next fitting one makes redundant."""
    kept: list[RmlAlternative] = []
    by_lowest: dict[int, list[int]] = defaultdict(list)
    """The kept alternatives by the lowest bit of what they fit."""
    for alternative in reversed(own):
        target, fits = class_of.get(alternative.target, alternative.target), alternative.fits
        inside = (
            next((one for one in reversed(by_lowest[low]) if not kept[one].fits & ~fits), -1)
            for low in (0, *(1 << bit for bit in bits(fits)))
            if low in by_lowest
        )
        following = max(inside, default=-1)
        if following < 0 or kept[following].target != target:
            by_lowest[fits & -fits].append(len(kept))
            kept.append(alternative._replace(target=target))
    return tuple((alternative.letters, alternative.target) for alternative in reversed(kept))


def equations(
    classes: list[StateClass], letters: RmlLetters, *, cyclic: bool = False
) -> tuple[Written, list[tuple[str, Written]]]:
    """Return the expression of the first state, and an equation per class with several
    predecessors.

    Other classes are inlined, unless they are nested too deeply or there may be cycles (`cyclic`).
    """
    uses = Counter(target for choices in classes for target in {target for _, target in choices})
    apart = {
        number
        for number, choices in enumerate(classes)
        if cyclic or uses[number] > 1 or any(t == STAY for _, t in choices)
    }
    height: dict[int, int] = {}
    for number, choices in enumerate(classes):
        height[number] = 1 + max((height[t] for _, t in choices if t >= 0 and t not in apart), default=0)
        if height[number] >= MAX_DEPTH:
            height[number] = 0
    order = dict.fromkeys([len(classes) - 1])
    for number in (agenda := list(order)):  # in reading order
        fresh = [target for _, target in classes[number] if target >= 0 and target not in order]
        agenda += dict.fromkeys(fresh)
        order.update(dict.fromkeys(fresh))
    own = [number for number in order if number in apart or height[number] == 0]
    names = {number: named(f"S{position}") for position, number in enumerate(own, 1)}
    bodies: list[Written] = []
    for number, choices in enumerate(classes):
        parts: list[Written] = []
        after = {ACCEPT: ALL, STAY: names.get(number, NONE)}
        texts = [(letters.all_texts(found), target) for found, target in choices]
        for (target, joint), run in groupby(texts, key=lambda one: (one[1], one[1] == ACCEPT and len(one[0]) > 1)):
            if joint:  # detection by several event types at once has its own form
                parts += [join(AND, (then(event, ALL) for event in events)) for events, _ in run]
            else:  # neighbours with the same target are merged
                heads = [join(AND, events) if events else ANY for events, _ in run]
                parts.append(then(join(OR, heads), after.get(target) or names.get(target) or bodies[target]))
        bodies.append(join(OR, parts) if parts else NONE)  # no event satisfies the guards
    return names.get(len(classes) - 1) or bodies[-1], [(names[number].word, bodies[number]) for number in names]
