"""A continuous-time Markov chain of a tree, or of a part of it, in which order matters.

A state is a tuple with one entry for each element, children before gates. What a decided gate no
longer depends on is forgotten, so that few states remain. Leaves with a probability are decided at
time 0; those of a later part of a sequence happen when that part begins.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product
from typing import Final, TypeAlias, assert_never

from rvaft.errors import TooLarge
from rvaft.risk.model import Leaf, Op, RiskError, RiskTree, below

State: TypeAlias = tuple[int, ...]

OPEN: Final = 0
"""A gate that has not failed and still can, and a leaf of which no event has happened."""
FAILED: Final = -1
SAFE: Final = -2
"""What can never fail."""
FORGOTTEN: Final = -3
"""An element on which no open element depends."""
WON: Final = -4
"""A leaf with a probability that happens as soon as its part begins."""
LOST: Final = -5
"""A leaf with a probability that did not happen, and that a trigger can still fail."""

DEFAULT_STATES: Final = 200_000
_MOST_COINS: Final = 16
_MOST_ORDERS: Final = 10_000


@dataclass(frozen=True, slots=True)
class _Place:
    """What an element is, by the numbers of others."""

    number: int
    op: Op | None
    children: tuple[int, ...]
    need: int = 0


class Machine:
    """The states of the elements below `root`, and what the events of its leaves do to them.

    Raises `RiskError` for what no chain describes.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> machine = Machine(of_tree(rvaft.loads("t sand a b; a lambda=1; b lambda=2;")), "t")
    >>> start = machine.start()
    >>> [(leaf.name, rate) for leaf, rate in machine.rates(start)]
    [('a', 1.0)]
    >>> machine.decided(machine.after(machine.after(start, "a"), "b"))
    True
    """

    def __init__(self, tree: RiskTree, root: str, *, given: Mapping[str, float | None] | None = None) -> None:
        self.tree = tree
        names = below(tree, [root, *tree.needed(root)])
        self.names = tuple(names)
        self.number = {name: place for place, name in enumerate(names)}
        self._root = self.number[root]
        number = self.number
        self._places = tuple(self._placed(place, name) for place, name in enumerate(names))
        self._leaves: dict[int, Leaf] = {number[name]: tree.leaves[name] for name in names if name in tree.leaves}
        self._gates = [place for place in self._places if place.op is not None]
        self._spares = [place for place in self._gates if place.op is Op.SPARE]
        users = Counter(child for spare in self._spares for child in spare.children)
        self._shared = {child for child, count in users.items() if count > 1}
        """The parts that several spare gates can use: whoever has one that never fails keeps it from the others."""
        self._dependencies = tuple(one for one in tree.dependencies if any(name in number for name in one.dependents))
        self._coins = {number[one.coin] for one in self._dependencies if one.coin is not None}
        self._waits = self._waiting(root)
        self._follows, self._excludes = self._restricted()
        self._modules = self._claimed()
        self._ordered = self._order_matters()
        self._given = given or {}
        self._chanced = [place for place, leaf in self._leaves.items() if self._chance(leaf) is not None]
        self._free = {place for place in self._leaves
                      if not (self._waits[place] or self._follows.get(place) or self._excludes.get(place))}  # fmt: skip
        for place, leaf in self._leaves.items():
            if self._waits[place] and self._is_dependent(leaf.name):
                raise RiskError(f"{leaf.node} depends on a trigger, and its clock starts with a later part of a "
                                "sequence: which of the two wins is not defined")  # fmt: skip
            if leaf.numbers.shape != 1.0:
                raise RiskError(
                    f"the rate of {leaf.node} changes with time (`shape`), which only static trees can have"
                )

    @property
    def leaves(self) -> tuple[Leaf, ...]:
        """The leaves below the root, and below what it depends on."""
        return tuple(self._leaves.values())

    def _placed(self, place: int, name: str) -> _Place:
        gate = self.tree.gates.get(name)
        if gate is None:
            return _Place(place, None, ())
        return _Place(place, gate.op, tuple([self.number[child] for child in gate.children]), gate.need)

    def _waiting(self, root: str) -> dict[int, frozenset[int]]:
        """Return the parts that must be complete before the clock of each leaf starts."""
        found: dict[int, set[frozenset[int]]] = {self.number[root]: {frozenset()}}
        for place in reversed(self._places):
            mine = found.get(place.number, {frozenset()})
            if len(mine) > 1:
                name = self.names[place.number]
                raise RiskError(f"{name} is shared by parts of sequences that begin at different times: no chain "
                                "describes this: `rvaft risk --simulate N` estimates")  # fmt: skip
            [waits] = mine
            for before, child in zip((None, *place.children), place.children, strict=False):
                more = waits if place.op is not Op.SEQUENCE or before is None else waits | {before}
                found.setdefault(child, set()).add(more)
        return {leaf: next(iter(found.get(leaf, {frozenset()}))) for leaf in self._leaves}

    def _restricted(self) -> tuple[dict[int, set[int]], dict[int, set[int]]]:
        follows: dict[int, set[int]] = {}
        excludes: dict[int, set[int]] = {}
        dependents = {name for one in self._dependencies for name in one.dependents}
        for restriction in self.tree.restrictions:
            inside = [name for name in restriction.children if name in self.number]
            for name in inside if len(inside) == len(restriction.children) else ():
                if name in dependents:
                    raise RiskError(f"{name} is restricted by {restriction.name} and depends on a trigger: which of "
                                    "the two wins is not defined")  # fmt: skip
            for before, name in pairwise(inside):
                if not restriction.exclusive:
                    follows.setdefault(self.number[name], set()).add(self.number[before])
            if restriction.exclusive:
                for name in inside:
                    excludes.setdefault(self.number[name], set()).update(self.number[o] for o in inside if o != name)
        return follows, excludes

    def _claimed(self) -> dict[int, frozenset[frozenset[tuple[int, int]]]]:
        """Return, for each leaf that is not always in use, the uses that make it so: spares with their places."""
        used = {child for place in self._places for child in place.children}
        found: dict[int, frozenset[frozenset[tuple[int, int]]]] = {}
        for place in reversed(self._places):
            mine = found.get(place.number, frozenset())
            if place.number == self._root or place.number not in used or frozenset() in mine:
                mine = frozenset([frozenset()])
            found[place.number] = mine
            for position, child in enumerate(place.children):
                use = frozenset([(place.number, position)] if place.op is Op.SPARE and position else [])
                found[child] = found.get(child, frozenset()) | {one | use for one in mine}
        for spare in self._spares:
            for child in spare.children[1:]:
                self._check_module(child)
        return {place: found[place] for place in self._leaves if frozenset() not in found[place]}

    def _check_module(self, spare: int) -> None:
        """Raise `RiskError` if a part that is a spare has a spare gate, or leaves that others use, too."""
        inside = {self.number[name] for name in below(self.tree, [self.names[spare]])}
        for number in sorted(inside):
            if self._places[number].op is Op.SPARE:
                raise RiskError(
                    f"the spare {self.names[spare]} has a spare gate, {self.names[number]}, of its own, which is not "
                    "analysed"
                )
        if all(self._leaves[one].numbers.dormancy in (None, 1.0) for one in inside if one in self._leaves):
            return
        for place in self._places:
            shared = inside.intersection(place.children) - {spare}
            if shared and place.number not in inside:
                raise RiskError(
                    f"{self.names[min(shared)]} is part of the spare {self.names[spare]} and of "
                    f"{self.names[place.number]}: when it is in use is not defined"
                )

    def _order_matters(self) -> frozenset[int]:
        """Return the elements below gates in which the order at one moment matters, also through triggers."""
        found = {place.number for place in self._gates if place.op in (Op.PRIORITY, Op.FIRST, Op.SPARE)}
        waiting = list(found)
        while waiting:
            place = waiting.pop()
            name = self.names[place]
            causes = [self.number[one.trigger] for one in self._dependencies if name in one.dependents]
            new = {*self._places[place].children, *causes} - found
            found |= new
            waiting.extend(new)
        return frozenset(found)

    # ---- events ---------------------------------------------------------------------------------

    def start(self) -> State:
        """Return the state before all events, in which no probability is decided."""
        first = [OPEN] * len(self._places)
        for place, leaf in self._leaves.items():
            if self._chance(leaf) is None and leaf.numbers.rate == 0 and not self._is_dependent(leaf.name):
                first[place] = SAFE
        return self._settled(tuple(first), ())

    def resolved(self, state: State) -> dict[State, float]:
        """Return the states with decided probabilities, and the chances of each, which sum to 1.

        Raises `TooLarge` for more than sixteen probabilities that are not decided.
        """
        coins = [(place, chance) for place, leaf in self._leaves.items() if state[place] == OPEN
                 and (chance := self._chance(leaf)) is not None]  # fmt: skip
        uncertain = [(place, chance) for place, chance in coins if 0 < chance < 1]
        if len(uncertain) > _MOST_COINS:
            raise TooLarge("probabilities in one part in which order matters", limit=_MOST_COINS)
        if not coins:
            return {state: 1.0}
        found: dict[State, float] = {}
        for outcome in product((True, False), repeat=len(uncertain)):
            decided, weight = list(state), 1.0
            for place, chance in coins:
                decided[place] = WON if chance else self._lost(place)
            for (place, chance), won in zip(uncertain, outcome, strict=True):
                decided[place] = WON if won else self._lost(place)
                weight *= chance if won else 1 - chance
            settled = self._settled(tuple(decided), ())
            found[settled] = found.get(settled, 0.0) + weight
        return found

    def _lost(self, place: int) -> int:
        return LOST if self._is_dependent(self.names[place]) else SAFE

    def _chance(self, leaf: Leaf) -> float | None:
        return self._given.get(leaf.name, leaf.numbers.chance)

    def _rate(self, leaf: Leaf) -> float:
        return 0.0 if self._chance(leaf) is not None else leaf.numbers.rate or 0.0

    def _is_dependent(self, name: str) -> bool:
        return any(name in one.dependents for one in self._dependencies)

    def possible(self, state: State) -> Iterator[Leaf]:
        """Yield the leaves of which an event can change the state, also those with a probability."""
        if state[self._root] < 0:
            return
        for place, leaf in self._leaves.items():
            cold = place in self._modules and leaf.numbers.dormancy == 0 and not self._active(state, place)
            never = self._chance(leaf) == 0 or leaf.numbers.rate == 0
            if state[place] >= 0 and not (cold or never) and self._may_happen(state, place):
                yield leaf

    def excludes(self, state: State, name: str) -> bool:
        """Whether the model excludes that a failure comes now: it has failed, or cannot fail yet."""
        place = self.number[name]
        if not self._leaves[place].once or state[self._root] < 0 or state[place] == FORGOTTEN:
            return False
        return all(leaf.name != name for leaf in self.possible(state))

    def rates(self, state: State) -> Iterator[tuple[Leaf, float]]:
        """Yield the leaves of which an event can change the state, with the rates of these events."""
        if state[self._root] < 0:
            return
        for place, leaf in self._leaves.items():
            if state[place] >= 0 and self._may_happen(state, place):
                rate = self._rate(leaf)
                if rate and place in self._modules and not self._active(state, place):
                    rate *= 1.0 if leaf.numbers.dormancy is None else leaf.numbers.dormancy
                if rate:
                    yield leaf, rate

    def _may_happen(self, state: State, place: int) -> bool:
        if place in self._free:
            return True
        if any(state[before] != FAILED for before in self._waits[place]):
            return False
        if any(state[before] != FAILED for before in self._follows.get(place, ())):
            return False
        return not any(state[other] == FAILED for other in self._excludes.get(place, ()))

    def _active(self, state: State, place: int) -> bool:
        return any(all(state[spare] == position for spare, position in one) for one in self._modules[place])

    def after(self, state: State, name: str) -> State:
        """Return the state after one more event of a leaf, which may leave it as it is.

        Raises `RiskError` if the order of simultaneous failures decides.
        """
        place = self.number[name]
        if state[self._root] < 0 or state[place] < 0 or not self._may_happen(state, place):
            return state
        return self._settled(state, (place,))

    def decided(self, state: State) -> bool | None:
        """Return True if the root has happened, False if it never can, else None."""
        return {FAILED: True, SAFE: False}.get(state[self._root])

    def _counted(self, state: list[int], place: int) -> None:
        leaf = self._leaves[place]
        happened = max(state[place], 0) + 1
        state[place] = FAILED if happened >= leaf.times else happened

    def _settled(self, state: State, events: Iterable[int]) -> State:
        """Return the state after the events of leaves, and what follows from them at once."""
        left = list(state)
        for place in events:
            self._counted(left, place)
        first = self._evaluated(state, left)
        self._check_claims(state, first)
        due = self._due(first)
        if not due:
            return self._tidy(first)
        together = self._together(state, left)
        if len(due) == 1 and not self._dependencies:
            self._check_claims(state, together)
            return self._tidy(together)
        outcomes = {self._tidy(one) for one in (together, *self._in_turn(first))}
        if len(outcomes) > 1:
            names = sorted(self.names[place] for place in due if place in self._ordered)
            some = ", ".join(names[:5])
            raise RiskError(f"the order of simultaneous failures decides ({some} happen at the same moment): a number "
                            "would depend on it")  # fmt: skip
        return outcomes.pop()

    def _together(self, before: State, left: list[int]) -> State:
        """Return the state if all that follows happens at the same moment."""
        while True:
            found = self._evaluated(before, left)
            more = [place for place in self._due(found) if left[place] != FAILED]
            if not more:
                return found
            for place in more:
                left[place] = FAILED

    def _check_claims(self, before: State, after: State) -> None:
        """Raise `RiskError` if two gates need one spare at the same moment."""
        changed = [
            gate for gate in self._spares if before[gate.number] >= 0 and after[gate.number] != before[gate.number]
        ]
        for gate, other in permutations(changed, 2) if len(changed) > 1 else ():
            new, last = after[gate.number], after[other.number]
            passed = other.children[before[other.number] + 1 : last if last >= 0 else None]
            if new >= 0 and gate.children[new] in passed:
                raise RiskError(
                    f"{self.names[gate.number]} and {self.names[other.number]} need the spare "
                    f"{self.names[gate.children[new]]} at the same moment: their order would decide"
                )

    def _in_turn(self, start: State) -> set[State]:
        """Return the states if what follows happens one after the other, in each order."""
        found: set[State] = set()
        seen, waiting = {start}, [start]
        while waiting:
            state = waiting.pop()
            due = self._due(state)
            if not due:
                found.add(state)
                continue
            free = [place for place in due if place not in self._ordered]
            for places in [free] if free else [[place] for place in due]:
                left = list(state)
                for place in places:
                    left[place] = FAILED
                then = self._evaluated(state, left)
                self._check_claims(state, then)
                if then not in seen:
                    seen.add(then)
                    waiting.append(then)
            if len(seen) > _MOST_ORDERS:
                raise TooLarge("orders of failures that one trigger brings about", limit=_MOST_ORDERS)
        return found

    def _due(self, state: State) -> list[int]:
        """Return the leaves that fail now: dependents of failed triggers, and won leaves whose part begins."""
        found = [
            self.number[name]
            for one in self._dependencies
            if state[self.number[one.trigger]] == FAILED
            and (one.coin is None or state[self.number[one.coin]] in (WON, FAILED))
            for name in one.dependents
            if name in self.number and state[self.number[name]] not in (FAILED, FORGOTTEN)
        ]
        coins = self._coins
        won = [p for p in self._chanced if state[p] == WON and p not in coins and self._may_happen(state, p)]
        return list(dict.fromkeys([*won, *found]))

    # ---- gates ----------------------------------------------------------------------------------

    def _evaluated(self, before: State, left: Sequence[int]) -> State:
        """Return the state with the gates after changes of leaves; `before` has what gates remember."""
        now = list(left)
        for place in self._excludes:
            if now[place] == OPEN and any(now[other] == FAILED for other in self._excludes[place]):
                now[place] = SAFE
        for spare in self._gates:
            now[spare.number] = before[spare.number]
        for gate in self._gates:
            if now[gate.number] >= 0:
                now[gate.number] = self._gate(gate, now)
        return tuple(now)

    def _gate(self, gate: _Place, now: list[int]) -> int:
        states = [now[child] for child in gate.children]
        failed, safe = states.count(FAILED), states.count(SAFE)
        match gate.op:
            case Op.OR:
                return FAILED if failed else SAFE if safe == len(states) else OPEN
            case Op.AND:
                return SAFE if safe else FAILED if failed == len(states) else OPEN
            case Op.AT_LEAST:
                return FAILED if failed >= gate.need else SAFE if len(states) - safe < gate.need else OPEN
            case Op.SEQUENCE:
                return SAFE if safe else FAILED if failed == len(states) else OPEN
            case Op.PRIORITY:
                waiting = next((place for place, one in enumerate(states) if one != FAILED), len(states))
                if safe or any(one == FAILED for one in states[waiting:]):
                    return SAFE
                return FAILED if waiting == len(states) else OPEN
            case Op.FIRST:
                if states[0] == FAILED:
                    return FAILED
                return SAFE if failed or states[0] == SAFE else OPEN
            case Op.SPARE:
                return self._spare(gate, now)
            case None:
                raise AssertionError
            case _:
                assert_never(gate.op)

    def _spare(self, gate: _Place, now: list[int]) -> int:
        used = now[gate.number]
        while now[gate.children[used]] == FAILED:
            taken = {
                other.children[now[other.number]]
                for other in self._spares
                if other is not gate and now[other.number] >= 0
            }
            free = (
                place
                for place in range(used + 1, len(gate.children))
                if now[gate.children[place]] != FAILED and gate.children[place] not in taken
            )
            found = next(free, None)
            if found is None:
                return FAILED
            used = found
        child = gate.children[used]
        return SAFE if now[child] == SAFE and child not in self._shared else used

    # ---- what is forgotten ----------------------------------------------------------------------

    def _tidy(self, state: State) -> State:
        if state[self._root] < 0:
            return tuple([state[self._root] if place == self._root else FORGOTTEN for place in range(len(state))])
        needed: set[int] = set()
        waiting = [self._root]
        while waiting:
            place = waiting.pop()
            if place in needed:
                continue
            needed.add(place)
            if state[place] < 0 and state[place] not in (WON, LOST):
                continue
            waiting.extend(self._depends(state, place))
        return tuple([one if place in needed else FORGOTTEN for place, one in enumerate(state)])

    def _depends(self, state: State, place: int) -> Iterator[int]:
        """Yield the elements that may still change what an open element does."""
        element = self._places[place]
        if element.op is Op.SPARE:
            rest = element.children[state[place] :]
            yield from rest
            for other in self._spares:
                if state[other.number] >= 0 and not set(rest).isdisjoint(other.children[state[other.number] :]):
                    yield other.number
        else:
            yield from element.children
        if place in self._leaves:
            yield from self._waits[place]
            yield from self._follows.get(place, ())
            yield from self._excludes.get(place, ())
            name = self.names[place]
            for one in self._dependencies:
                if name in one.dependents:
                    yield self.number[one.trigger]
                    yield place if one.coin is None else self.number[one.coin]
            for uses in self._modules.get(place, ()):
                yield from (spare for spare, _ in uses if state[spare] >= 0)
