"""Subset construction and minimisation; a state is the set of partial matches (residuals) of a
prefix.

- `strict`: every event must extend a partial match.
- `projected`: every relevant event must.
- `scattered`: events may be skipped, and a dominated residual is dropped. Every move leaves fewer
  occurrences, so the only cycles are self-loops.
- `consecutive`: every state includes the initial residuals, so the graph has cycles.

An absent event removes the residuals that it breaks, so that the graph has cycles under `scattered`, too.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, NamedTuple

from backends.automaton.letters import FeasibleLetters
from backends.automaton.partial_matches import PartialMatches
from rvaft.core.residual import Move, Residual, ResidualSpace
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, mask_of, union
from rvaft.support.budget import Work

DETECTED: Final = 0
HOPELESS: Final = 1
"""The first two states of every automaton."""
EDGES: Final = 10
"""Edges allowed per state of the limit."""


class StateRow(NamedTuple):
    """One state: the atoms it reads, the guards it reads per set of true atoms, and its successors.

    A letter is a bit set of true atoms and guards. `targets` maps each letter over `sees` and
    `asks` to a state. `skips` maps the sets of atoms that an irrelevant event makes true, of those in
    `misses`, to a state; other irrelevant events keep the state.
    """

    sees: int
    asks: dict[int, int]
    targets: dict[int, int]
    misses: int = 0
    skips: Mapping[int, int] = MappingProxyType({})

    def target(self, letter: int) -> int | None:
        """Return the successor for a letter over more propositions, or None for an infeasible
        letter.
        """
        seen = letter & self.sees
        return self.targets.get(seen | letter & self.asks.get(seen, 0))

    def redirected(self, new: dict[int, int]) -> "StateRow":
        """Return the row with its targets renamed by `new`."""
        targets, skips = (
            {letter: new.get(target, target) for letter, target in some.items()} for some in (self.targets, self.skips)
        )
        return self._replace(targets=targets, skips=skips)


@dataclass(slots=True)
class Automaton:
    """The rows by state, and the initial state."""

    start: int
    rows: list[StateRow] = field(
        default_factory=lambda: [StateRow(0, {0: 0}, {0: state}) for state in (DETECTED, HOPELESS)]
    )

    def in_order(self) -> list[int]:
        """Return the reachable states in breadth-first order."""
        order = [self.start]
        seen = set(order)
        for state in order:
            for target in (*self.rows[state].targets.values(), *self.rows[state].skips.values()):
                if target not in seen:
                    seen.add(target)
                    order.append(target)
        return order


def determinised(
    residuals: ResidualSpace | PartialMatches, letters: FeasibleLetters, work: Work, semantics: Semantics
) -> Automaton:
    """Return the automaton of the residuals; raises `TooLarge`."""
    scattered = semantics is Semantics.SCATTERED
    number: dict[frozenset[Residual], int] = {}
    waiting: list[frozenset[Residual]] = []

    def numbered(state: frozenset[Residual]) -> int:
        if not state:
            return HOPELESS
        if state not in number:
            number[state] = len(number) + 2
            waiting.append(state)
            work.check(len(number), "states of the automaton")
        return number[state]

    start = list(residuals.starts)
    if any(map(residuals.is_complete, start)):
        return Automaton(DETECTED)
    automaton = Automaton(numbered(frozenset(start)))
    edges, cost = 0, 50 + residuals.width // 10  # steps per letter
    for state in waiting:
        configurations = sorted(state)
        kept = configurations if scattered else start if semantics is Semantics.CONSECUTIVE else ()
        successors = _Successors(residuals, configurations, kept, scattered=scattered, work=work)
        row = StateRow(mask_of(successors.by_atom) | successors.breaking, {}, {})
        for atoms in letters.over(row.sees):
            row.asks[atoms] = union(successors.guards.get(atom, 0) for atom in bits(atoms))
            for holding in _subsets(row.asks[atoms]):
                after = successors.of(atoms, holding)
                row.targets[atoms | holding] = DETECTED if after is None else numbered(after)
                edges += 1
                work.step(cost)
                work.check(edges, f"edges of the automaton, {EDGES} allowed for each state", EDGES)
        automaton.rows.append(row if scattered else _with_skips(row, residuals, letters, configurations, numbered))
        edges += len(automaton.rows[-1].skips)
    return automaton


def _with_skips(
    row: StateRow,
    residuals: ResidualSpace | PartialMatches,
    letters: FeasibleLetters,
    state: Sequence[Residual],
    numbered: Callable[[frozenset[Residual]], int],
) -> StateRow:
    """Return the row with the irrelevant events that break a residual of the state."""
    if not isinstance(residuals, PartialMatches):
        return row
    absent = {one: residuals.absent(one) for one in state}
    misses = union(absent.values())
    broken = (atoms for atoms in letters.irrelevant(misses) if atoms)
    skips = {atoms: numbered(frozenset(one for one in state if not absent[one] & atoms)) for atoms in broken}
    return row._replace(misses=misses, skips=skips)


class _Successors:
    """The successors of one state, computed per atom and combined as bit sets.

    Dominance is computed once per pair of residuals, because a state may have exponentially many
    letters. `kept` holds the residuals in every successor: under `consecutive` the initial ones,
    under `scattered` those of the state. None of them dominates another.
    """

    def __init__(
        self,
        residuals: ResidualSpace | PartialMatches,
        state: Sequence[Residual],
        kept: Sequence[Residual],
        *,
        scattered: bool,
        work: Work,
    ) -> None:
        self._residuals = residuals
        self._work = work
        self._scattered = scattered
        self.by_atom: dict[int, list[Move]] = {}
        for configuration in state:
            for move in residuals.moves(configuration):
                self.by_atom.setdefault(move.label, []).append(move)
        self.guards = {atom: union(one.needed | one.noted for one in own) for atom, own in self.by_atom.items()}
        """The guards that matter for each true atom."""
        self._kept = kept
        self._absent = [residuals.absent(one) if isinstance(residuals, PartialMatches) else 0 for one in kept]
        self.breaking = union(self._absent)
        """The atoms of events that break a residual which is kept otherwise."""
        self._found = list(kept)
        known = not scattered or self.breaking
        self._bit = {one: 1 << number for number, one in enumerate(kept)} if known else {}
        self._worse = [0] * len(self._found)  # for each residual, the residuals that it dominates
        self._reached: dict[tuple[int, int], int | None] = {}
        self._best: dict[int, frozenset[Residual]] = {}

    def of(self, atoms: int, holding: int) -> frozenset[Residual] | None:
        together = mask_of(number for number, absent in enumerate(self._absent) if not absent & atoms)
        for atom in bits(atoms & mask_of(self.by_atom)):
            case = atom, holding & self.guards[atom]
            if case not in self._reached:
                self._reached[case] = self._lead(*case)
            reached = self._reached[case]
            if reached is None:
                return None
            together |= reached
        if together not in self._best:
            best = together & ~union(self._worse[index] for index in bits(together))
            self._best[together] = found = frozenset(self._found[index] for index in bits(best))
            self._work.step(10 * len(found))
        return self._best[together]

    def _lead(self, atom: int, holding: int) -> int | None:
        moves = self.by_atom[atom]
        self._work.step(20 * len(moves))
        possible = (move for move in moves if not move.needed & ~holding)
        moved = [self._residuals.breaking(move, holding) for move in possible]
        if any(map(self._residuals.is_complete, moved)):
            return None
        for configuration in moved:
            if configuration not in self._bit:
                self._bit[configuration] = self._new(configuration)
        return union(self._bit[configuration] for configuration in moved)

    def _new(self, configuration: Residual) -> int:
        """Return the bit of a residual, or 0 if a kept residual dominates it."""
        dominates = self._residuals.dominates
        bit, worse = 1 << len(self._found), 0
        if self._scattered:
            self._work.step(len(self._found) * (10 + self._residuals.width // 50))
            lasting = (other for other, absent in zip(self._kept, self._absent, strict=True) if not absent)
            if any(dominates(other, configuration) for other in lasting):
                return 0
            for index, other in enumerate(self._found):
                if dominates(other, configuration):
                    self._worse[index] |= bit
                elif dominates(configuration, other):
                    worse |= 1 << index
        self._found.append(configuration)
        self._worse.append(worse)
        return bit


def _subsets(mask: int) -> Iterator[int]:
    """Return all subsets of a bit set, the full set first.

    >>> list(_subsets(0b101))
    [5, 4, 1, 0]
    """
    subset = mask
    while True:
        yield subset
        if not subset:
            return
        subset = (subset - 1) & mask


# Minimisation. Without cycles except self-loops, one backward pass suffices: the classes of all
# other successors of a state are known. The state joins the class of a successor, a class with the
# same edges, or a new class. With cycles, classes are split until no letter distinguishes two
# states of a class. States that read different atoms are compared on the letters over both.

_SELF: Final = -1
"""The class of the source of an edge."""


def minimised(automaton: Automaton, letters: FeasibleLetters, work: Work, *, looping: bool) -> Automaton:
    """Return the minimal automaton over the feasible letters, in breadth-first order.

    A letter that a state does not read keeps the state if `looping`, else leads to `HOPELESS`.
    """
    default = _SELF if looping else HOPELESS
    rows = automaton.rows[:2]  # per class, the row of its first state, with classes as targets
    by_signature: dict[frozenset[tuple[int, int]], list[int]] = {frozenset(): [DETECTED, HOPELESS]}
    class_of = {DETECTED: DETECTED, HOPELESS: HOPELESS}

    def equals(row: StateRow, successor: int) -> bool:
        theirs, either = rows[successor], {successor: _SELF}
        work.step(len(row.targets) + len(theirs.targets))
        if {*row.targets.values(), _SELF, successor} != {*theirs.targets.values(), _SELF, successor}:
            return False
        return _same(row.redirected(either), theirs.redirected(either), letters, work)

    def class_for(row: StateRow) -> int:
        for successor in dict.fromkeys(row.targets.values()):
            if successor not in (_SELF, DETECTED) and equals(row, successor):
                return successor
        known = by_signature.setdefault(_signature(row, letters, default), [])
        for one in known:
            if _same(row, rows[one], letters, work):
                return one
        known.append(len(rows))
        rows.append(row)
        return known[-1]

    for state in _from_the_end(automaton):
        class_of[state] = _SELF
        work.step(2 * len(automaton.rows[state].targets))
        class_of[state] = class_for(automaton.rows[state].redirected(class_of))
    return _in_order(class_of[automaton.start], [row.redirected({_SELF: number}) for number, row in enumerate(rows)])


def refined(automaton: Automaton, letters: FeasibleLetters, work: Work) -> Automaton:
    """Return the minimal automaton in which letters that a state does not read lead to start."""
    order = [state for state in automaton.in_order() if state not in (DETECTED, HOPELESS)]
    class_of = {DETECTED: DETECTED, HOPELESS: HOPELESS, **dict.fromkeys(order, 2)}
    while True:
        rows, split = automaton.rows[:2], dict[tuple[int, frozenset[tuple[int, int]]], list[int]]()
        new = {DETECTED: DETECTED, HOPELESS: HOPELESS}
        for state in order:
            row = automaton.rows[state].redirected(class_of)
            row = row._replace(skips={atoms: to for atoms, to in row.skips.items() if to != class_of[state]})
            work.step(2 * len(row.targets))
            known = split.setdefault((class_of[state], _signature(row, letters, class_of[automaton.start])), [])
            alike = next(
                (one for one in known if _same(row, rows[one], letters, work) and _skip_alike(row, rows[one], letters)),
                len(rows),
            )
            if alike == len(rows):
                known.append(alike)
                rows.append(row)
            new[state] = alike
        if len(set(new.values())) == len(set(class_of.values())):  # the partition is stable
            first = {one: state for state, one in reversed(class_of.items())}
            rows = [automaton.rows[first.get(one, one)].redirected(class_of) for one in range(len(rows))]
            return _in_order(class_of[automaton.start], rows)
        class_of = new


def _same(one: StateRow, other: StateRow, letters: FeasibleLetters, work: Work) -> bool:
    work.step(len(one.targets) + len(other.targets))
    if one.sees == other.sees and one.targets == other.targets:
        return True
    if set(one.targets.values()) != set(other.targets.values()):
        return False
    for atoms in letters.over(one.sees | other.sees):
        guards = one.asks.get(atoms & one.sees, 0) | other.asks.get(atoms & other.sees, 0)
        work.step(10 << guards.bit_count())
        if any(one.target(atoms | held) != other.target(atoms | held) for held in _subsets(guards)):
            return False
    return True


def _skip_alike(one: StateRow, other: StateRow, letters: FeasibleLetters) -> bool:
    """Return whether irrelevant events lead two states of a class to the same classes."""
    some = letters.irrelevant(one.misses | other.misses)
    return all(one.skips.get(atoms & one.misses) == other.skips.get(atoms & other.misses) for atoms in some)


def _signature(row: StateRow, letters: FeasibleLetters, default: int) -> frozenset[tuple[int, int]]:
    atoms = union(letters.implying(atom) for atom in bits(row.sees))
    leading = ((atom, row.target((letters.closure(1 << atom) or 0) | letters.guards)) for atom in bits(atoms))
    return frozenset((atom, to) for atom, to in leading if to is not None and to != default)


def _in_order(start: int, rows: list[StateRow]) -> Automaton:
    new = {
        one: index for index, one in enumerate(dict.fromkeys([DETECTED, HOPELESS, *Automaton(start, rows).in_order()]))
    }
    return Automaton(new[start], [rows[one].redirected(new) for one in new])


def _from_the_end(automaton: Automaton) -> Iterator[int]:
    begun: set[int] = {DETECTED, HOPELESS}
    todo = [(automaton.start, False)]
    while todo:
        state, left = todo.pop()
        if left:
            yield state
        elif state not in begun:
            begun.add(state)
            todo.append((state, True))
            todo.extend((to, False) for to in automaton.rows[state].targets.values() if to not in begun)
