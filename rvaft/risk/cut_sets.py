"""Minimal cut sets: the least sets of leaves that bring the root about.

A family of sets is a zero-suppressed decision diagram (Minato, 1993), built gate by gate and cut at
an order. Of a part in which order matters, the least sequences are listed.
"""

import heapq
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, permutations
from typing import Any, Final, NamedTuple

from rvaft.errors import TooLarge, ToolMissing, installed
from rvaft.model.nodes import Kind
from rvaft.risk.chain import Machine, State
from rvaft.risk.diagram import DEFAULT_NODES as DIAGRAM
from rvaft.risk.diagram import diagram, flat_diagram, gate_value, walk
from rvaft.risk.model import PACKAGES, Op, RiskTree, below
from rvaft.risk.probability import dynamic_parts

NONE: Final = 0
"""The empty family."""
UNIT: Final = 1
"""The family of the empty set."""
DEFAULT_NODES: Final = 10_000_000
"""The default number of nodes of a family: about 2 GB."""
DEFAULT_ORDER: Final = 8
"""The default greatest length of a sequence of events."""
_QUICK_NODES: Final = 1_000_000
_MOST_WORDS: Final = 200_000


class Families:
    """Families of sets over numbered variables, without sets that contain another of the family.

    >>> families = Families(order=None)
    >>> a, b, c = map(families.single, range(3))
    >>> both = families.product(families.union(a, b), families.union(a, c))
    >>> sorted(map(sorted, families.sets(both)))
    [[0], [1, 2]]
    """

    def __init__(self, *, order: int | None, nodes: int = DEFAULT_NODES) -> None:
        self.marks: set[int] = set()
        """Variables that do not count for the order: each stands for the orders of events of one part."""
        self.nodes: list[tuple[int, int, int]] = [(sys.maxsize, 0, 0), (sys.maxsize, 0, 0)]
        """The variable of each node, and the families with and without it."""
        self.order = sys.maxsize if order is None else order
        """No set has more variables."""
        self.cut = False
        """Whether a set was left out for its order."""
        self._limit = nodes
        self._numbers: dict[tuple[int, int, int], int] = {}
        self._unions: dict[tuple[int, int], int] = {}
        self._products: dict[tuple[int, int, int], int] = {}
        self._differences: dict[tuple[int, int], int] = {}
        self._sizes: dict[int, int] = {NONE: sys.maxsize, UNIT: 0}

    def single(self, variable: int) -> int:
        """Return the family with one set of one variable."""
        return self.node(variable, UNIT, NONE) if self.order or variable in self.marks else self._left_out()

    def weight(self, variable: int) -> int:
        """Return how much a variable counts for the order of a set."""
        return variable not in self.marks

    def _left_out(self) -> int:
        self.cut = True
        return NONE

    def node(self, variable: int, with_it: int, without: int) -> int:
        """Return the family of the sets of `with_it` with a variable, and those of `without`."""
        if with_it == NONE:
            return without
        key = (variable, with_it, without)
        found = self._numbers.get(key)
        if found is None:
            found = self._numbers[key] = len(self.nodes)
            self.nodes.append(key)
            self._sizes[found] = min(self._sizes[with_it] + self.weight(variable), self._sizes[without])
            if found > self._limit:
                raise TooLarge("nodes of the families of cut sets", limit=self._limit)
        return found

    def union(self, one: int, other: int) -> int:
        """Return the least sets of two families."""
        if other in (one, NONE):
            return one
        if one == NONE:
            return other
        if UNIT in (one, other):
            return UNIT
        key = (one, other) if one < other else (other, one)
        found = self._unions.get(key)
        if found is None:
            (v, v1, v0), (w, w1, w0) = self.nodes[one], self.nodes[other]
            if v == w:
                low = self.union(v0, w0)
                found = self.node(v, self.without(self.union(v1, w1), low), low)
            elif v < w:
                low = self.union(v0, other)
                found = self.node(v, self.without(v1, low), low)
            else:
                low = self.union(one, w0)
                found = self.node(w, self.without(w1, low), low)
            self._unions[key] = found
        return found

    def product(self, one: int, other: int, order: int | None = None) -> int:
        """Return the least unions of a set of each family, with at most `order` variables."""
        if NONE in (one, other):
            return NONE
        left = self.order if order is None else order
        if max(self._sizes[one], self._sizes[other]) > left:
            return self._left_out()
        if one == UNIT:
            return self.cut_at(other, left)
        if other in (UNIT, one):
            return self.cut_at(one, left)
        key = (one, other, left) if one < other else (other, one, left)
        found = self._products.get(key)
        if found is None:
            (v, v1, v0), (w, w1, w0) = self.nodes[one], self.nodes[other]
            if v == w:
                low = self.product(v0, w0, left)
                rest = left - self.weight(v)
                high = self.union(self.product(v1, self.union(w1, w0), rest), self.product(v0, w1, rest))
            elif v < w:
                low = self.product(v0, other, left)
                high, w = self.product(v1, other, left - self.weight(v)), v
            else:
                low = self.product(one, w0, left)
                high = self.product(one, w1, left - self.weight(w))
            found = self._products[key] = self.node(w, self.without(high, low), low)
        return found

    def cut_at(self, family: int, order: int) -> int:
        """Return the sets with at most `order` variables."""
        if self._sizes[family] > order:
            return self._left_out() if family != NONE else NONE
        if family <= UNIT or order >= self.order:
            return family
        key = (family, UNIT, order)
        found = self._products.get(key)
        if found is None:
            variable, with_it, without = self.nodes[family]
            found = self.node(
                variable, self.cut_at(with_it, order - self.weight(variable)), self.cut_at(without, order)
            )
            self._products[key] = found
        return found

    def without(self, family: int, least: int) -> int:
        """Return the sets of a family that contain no set of `least`."""
        nodes = self.nodes
        v, v1, v0 = nodes[family]
        while nodes[least][0] < v:  # no set of the family has this variable
            least = nodes[least][2]
        if NONE in (family, least):
            return family
        if least in (UNIT, family):
            return NONE
        key = (family, least)
        found = self._differences.get(key)
        if found is None:
            w, w1, w0 = nodes[least]
            if v == w:
                found = self.node(v, self.without(self.without(v1, w1), w0), self.without(v0, w0))
            else:
                found = self.node(v, self.without(v1, least), self.without(v0, least))
            self._differences[key] = found
        return found

    def below(self, family: int) -> list[int]:
        """Return the inner nodes of a family, each after those that it needs."""
        reached = {family}
        waiting = [family]
        while waiting:
            for one in self.nodes[waiting.pop()][1:]:
                if one not in reached:
                    reached.add(one)
                    waiting.append(one)
        return sorted(one for one in reached if one > UNIT)

    def of_order(self, family: int, order: int) -> int:
        """Return the sets with exactly `order` variables."""
        if family == NONE or self._sizes[family] > order:
            return NONE
        if family == UNIT:
            return UNIT if order == 0 else NONE
        key = (family, NONE, order)
        found = self._products.get(key)
        if found is None:
            variable, with_it, without = self.nodes[family]
            rest = order - self.weight(variable)
            found = self.node(variable, self.of_order(with_it, rest), self.of_order(without, order))
            self._products[key] = found
        return found

    def sets(self, family: int) -> Iterator[tuple[int, ...]]:
        """Yield the sets of a family, by the numbers of their variables."""
        waiting: list[tuple[int, tuple[int, ...]]] = [(family, ())]
        while waiting:
            one, chosen = waiting.pop()
            while one > UNIT:
                variable, with_it, without = self.nodes[one]
                waiting.append((without, chosen))
                one, chosen = with_it, (*chosen, variable)
            if one == UNIT:
                yield chosen


@contextmanager
def _deep(levels: int) -> Iterator[None]:
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, 1000 + 4 * levels))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


class Sequenced(NamedTuple):
    """Events of one part in which order matters: `events` is a set, and `orders` are the orders of it that count.

    `before` has the pairs that every order keeps; if it says all, `orders` is empty.
    """

    events: tuple[str, ...]
    before: tuple[tuple[str, str], ...]
    orders: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class CutSet:
    """A least set of leaves; `sequences` has the orders that are needed, one for each part of it."""

    leaves: tuple[str, ...]
    sequences: tuple[Sequenced, ...] = ()

    @property
    def order(self) -> int:
        """The number of events."""
        return len(self.leaves)


class CutSets:
    """The minimal cut sets of a tree up to an order, which None leaves open; raises `TooLarge` beyond the limits.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> found = CutSets(of_tree(rvaft.loads("t and g h; g or a b; h or a c; a attack; b fault;")))
    >>> [one.leaves for one in found.listed()], found.complete
    ([('a',), ('b', 'c')], True)
    >>> sorted(found.by_order().items())
    [(1, 1), (2, 1)]
    """

    def __init__(self, tree: RiskTree, *, order: int | None = None, nodes: int = DEFAULT_NODES) -> None:
        self.tree = tree
        self.parts = dynamic_parts(tree)
        self.families = Families(order=order, nodes=nodes)
        self.names: list[str] = []
        """The variables: leaves, and sequences of parts."""
        self.sequences: dict[int, Sequenced] = {}
        self._number: dict[str, int] = {}
        with _deep(len(tree.leaves) + len(tree.gates)):
            found = self._of_diagram() if order is None and not self.parts else None
            self.root = self._build(order) if found is None else found

    @property
    def complete(self) -> bool:
        """Whether it is certain that no set was left out for its order."""
        return not self.families.cut

    def _of_diagram(self) -> int | None:
        """Return the family from a decision diagram (Rauzy, 1993), ten times faster than gate by gate.

        Return None without oxidd, or if the diagram has too many nodes.
        """
        try:
            made = diagram(self.tree, frozenset(), nodes=_QUICK_NODES)
        except (TooLarge, ToolMissing):
            return None
        self.names = list(made.variables)
        self._number = {name: place for place, name in enumerate(self.names)}
        never = [self._never(name) for name in self.names]
        families, found = self.families, [NONE, UNIT]
        for variable, high, low in made.nodes:
            least = found[low]
            more = NONE if never[variable] else families.without(found[high], least)
            found.append(families.node(variable, more, least))
        return found[made.root]

    def _build(self, order: int | None) -> int:
        families, made = self.families, dict[str, int]()
        causes = self.tree.causes()
        walked = walk(self.tree, self.parts, causes)
        for name in walked:
            for leaf in self._own(name):
                self._number[leaf] = len(self.names)
                self.names.append(leaf)
        while True:
            before = dict(made)
            for name in walked:
                if name in self.parts:
                    if name not in made:
                        made[name] = self._part(name, order)
                elif name in self.tree.leaves:
                    found = families.single(self._number[name])
                    if self._never(name):
                        found = NONE
                    for trigger, coin in causes.get(name, ()):
                        cause = made.get(trigger, NONE)
                        own = cause if coin is None else families.product(cause, made.get(coin, NONE))
                        found = families.union(found, own)
                    made[name] = found
                else:
                    gate = self.tree.gates[name]
                    children = [made.get(child, NONE) for child in gate.children]
                    made[name] = gate_value(
                        gate, children, false=NONE, true=UNIT, either=families.union, both=families.product
                    )
            if not causes or made == before:
                return made[self.tree.root]

    def _never(self, name: str) -> bool:
        numbers = self.tree.leaves[name].numbers
        return numbers.chance == 0 or (numbers.chance is None and numbers.rate == 0)

    def _own(self, name: str) -> list[str]:
        if name in self.parts:
            return [leaf.name for leaf in Machine(self.tree, name).leaves]
        return [name] if name in self.tree.leaves else []

    def _part(self, part: str, order: int | None) -> int:
        families, found = self.families, NONE
        some, complete = sequences(self.tree, part, order)
        families.cut = families.cut or not complete
        for one in some:
            own = UNIT
            for leaf in one.events:
                own = families.product(families.single(self._number[leaf]), own)
            if one.before or one.orders:
                families.marks.add(mark := len(self.names))
                self.names.append("")
                self.sequences[mark] = one
                own = families.product(own, families.single(mark))
            found = families.union(found, own)
        return found

    # ---- what is asked --------------------------------------------------------------------------

    def _cut_set(self, numbers: Iterable[int]) -> CutSet:
        leaves = tuple([self.names[one] for one in sorted(numbers) if one not in self.sequences])
        return CutSet(leaves, tuple([self.sequences[one] for one in sorted(numbers) if one in self.sequences]))

    def __iter__(self) -> Iterator[CutSet]:
        """Yield the sets, in a stable order."""
        return map(self._cut_set, self.families.sets(self.root))

    def listed(self, most: int | None = None) -> list[CutSet]:
        """Return the sets by order, then from left to right, at most `most` of them."""
        found: list[CutSet] = []
        for order in sorted(self.by_order()):
            with _deep(len(self.names)):
                upto = self.families.of_order(self.root, order)
            for one in self.families.sets(upto):
                if most is not None and len(found) >= most:
                    return found
                found.append(self._cut_set(one))
        return found

    def by_order(self) -> Counter[int]:
        """Return the number of sets of each order."""
        found: Counter[int] = Counter()
        for (order, _), number in self._counts().items():
            found[order] += number
        return found

    def by_kind(self) -> Counter[frozenset[Kind]]:
        """Return the number of sets by the kinds of their leaves: a kind below a gate of a kind is its own."""
        found: Counter[frozenset[Kind]] = Counter()
        for (_, kinds), number in self._counts().items():
            found[kinds] += number
        return found

    @property
    def count(self) -> int:
        """The number of sets."""
        return sum(self._counts().values())

    def _counts(self) -> Mapping[tuple[int, frozenset[Kind]], int]:
        empty: frozenset[Kind] = frozenset()
        known: dict[int, Counter[tuple[int, frozenset[Kind]]]] = {NONE: Counter(), UNIT: Counter({(0, empty): 1})}
        for node in self.families.below(self.root):
            variable, with_it, without = self.families.nodes[node]
            leaf = self.tree.leaves.get(self.names[variable])
            kind = frozenset() if leaf is None or leaf.kind is None else frozenset([leaf.kind])
            mine = Counter(known[without])
            for (order, kinds), number in known[with_it].items():
                mine[order + self.families.weight(variable), kinds | kind] += number
            known[node] = mine
        return known[self.root]

    def most_probable(self, most: int, chances: Mapping[str, float]) -> list[tuple[CutSet, float]]:
        """Return the sets with the greatest product of probabilities of their leaves, with these products."""
        best: dict[int, float] = {NONE: 0.0, UNIT: 1.0}
        for node in self.families.below(self.root):
            variable, with_it, without = self.families.nodes[node]
            best[node] = max(self._chance(variable, chances) * best[with_it], best[without])
        found: list[tuple[CutSet, float]] = []
        waiting: list[tuple[float, int, int, tuple[int, ...], float]] = [(-best[self.root], 0, self.root, (), 1.0)]
        number = 0
        while waiting and len(found) < most:
            value, _, node, chosen, product = heapq.heappop(waiting)
            if not value:
                break
            if node == UNIT:
                found.append((self._cut_set(chosen), product))
                continue
            variable, with_it, without = self.families.nodes[node]
            taken = product * self._chance(variable, chances)
            for one, many, now in ((with_it, (*chosen, variable), taken), (without, chosen, product)):
                if best[one]:
                    number += 1
                    heapq.heappush(waiting, (-now * best[one], number, one, many, now))
        return found

    def probability(self, chances: Mapping[str, float], leaf: str | None = None, *, nodes: int = DIAGRAM) -> float:
        """Return the probability that all leaves of a set have happened, of some set, with `leaf` if it is given.

        If all sets are there and no order matters, that is the probability of the root without a
        `leaf`; of sets up to an order it is a lower bound. Raises `TooLarge` beyond a number of nodes.
        """
        oxidd = installed("oxidd.bdd", "oxidd", PACKAGES)
        manager = oxidd.BDDManager(nodes, max(1024, nodes // 4), 1)
        manager.add_vars(len(self.names))
        wanted = -1 if leaf is None else self._number[leaf]
        some: dict[int, Any] = {NONE: manager.false(), UNIT: manager.true()}
        own: dict[int, Any] = {NONE: manager.false(), UNIT: manager.false()}
        try:
            for node in self.families.below(self.root):
                variable, with_it, without = self.families.nodes[node]
                here = manager.true() if variable in self.sequences else manager.var(variable)
                some[node] = (here & some[with_it]) | some[without]
                own[node] = (here & (some if variable == wanted else own)[with_it]) | own[without]
            function = (some if leaf is None else own)[self.root]
            made = flat_diagram(tuple(self.names), [function], nodes)
        except MemoryError:
            raise TooLarge("nodes of a decision diagram", limit=nodes) from None
        return float(made.probability({"": 1.0, **chances}))

    def _chance(self, variable: int, chances: Mapping[str, float]) -> float:
        return 1.0 if variable in self.sequences else chances[self.names[variable]]


# ---- parts in which order matters -------------------------------------------------------------------


def sequences(tree: RiskTree, part: str, order: int | None) -> tuple[list[Sequenced], bool]:
    """Return the least sequences of events that bring a part about, by their sets, and whether these are all.

    A sequence is least if no other is left when events are dropped from it. Raises `TooLarge` beyond
    a number of sequences.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> sequences(of_tree(rvaft.loads("t sand a g; g and b c;")), "t", None)
    ([Sequenced(events=('a', 'b', 'c'), before=(('a', 'b'), ('a', 'c')), orders=())], True)
    """
    if _plain(tree, part):
        return _plain_sequences(tree, part, order)
    machine = Machine(tree, part)
    longest = DEFAULT_ORDER if order is None else order
    words: list[tuple[str, ...]] = []
    complete = True
    waiting: list[tuple[tuple[str, ...], State]] = [((), machine.start())]
    while waiting:
        word, state = waiting.pop()
        decided = machine.decided(state)
        if decided:
            words.append(word)
            if len(words) > _MOST_WORDS:
                raise TooLarge(f"sequences of events of {part}", limit=_MOST_WORDS)
        if decided is not None:
            continue
        possible = [leaf.name for leaf in machine.possible(state)]
        if len(set(word)) >= longest and any(name not in word for name in possible):
            complete = complete and order is not None
            possible = [name for name in possible if name in word]
            if order is None:
                raise TooLarge(f"events in a sequence of {part}", limit=longest, remedy="ask for an order: --max-order")
            complete = False
        waiting.extend(((*word, name), machine.after(state, name)) for name in reversed(possible))
        if len(waiting) > _MOST_WORDS:
            raise TooLarge(f"sequences of events of {part}", limit=_MOST_WORDS)
    return _grouped(tree, _least(words)), complete


def _least(words: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    known = set(words)
    return [
        word
        for word in words
        if not any(tuple(shorter) in known for size in range(len(word)) for shorter in combinations(word, size))
    ]


def _grouped(tree: RiskTree, words: list[tuple[str, ...]]) -> list[Sequenced]:
    place = {name: number for number, name in enumerate(tree.leaves)}
    by_set: dict[frozenset[str], list[tuple[str, ...]]] = {}
    for word in words:
        ends = tuple(dict.fromkeys(reversed(word)))[::-1]  # of an event that is needed several times, the last
        by_set.setdefault(frozenset(word), []).append(ends)
    found: list[Sequenced] = []
    for events, orders in by_set.items():
        names = tuple(sorted(events, key=place.__getitem__))
        different = sorted(set(orders))
        before = [
            pair for pair in permutations(names, 2) if all(w.index(pair[0]) < w.index(pair[1]) for w in different)
        ]
        repeated = any(tree.leaves[name].times > 1 for name in names)
        told = not repeated and _extensions(names, before) == len(different)
        pairs = tuple(_reduced(before))
        found.append(Sequenced(names, pairs, () if told else tuple(different)))
    return sorted(found, key=lambda one: (len(one.events), [place[name] for name in one.events]))


def _extensions(names: Sequence[str], before: Sequence[tuple[str, str]]) -> int:
    """Return the number of orders that keep all pairs."""
    number = {name: place for place, name in enumerate(names)}
    needs = [0] * len(names)
    for first, then in before:
        needs[number[then]] |= 1 << number[first]
    ways = {0: 1}
    for _ in names:
        more: dict[int, int] = {}
        for done, many in ways.items():
            for place, need in enumerate(needs):
                if not done >> place & 1 and not need & ~done:
                    more[done | 1 << place] = more.get(done | 1 << place, 0) + many
        ways = more
    return sum(ways.values())


def _reduced(before: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the pairs from which the others follow."""
    known = set(before)
    return [(a, b) for a, b in before if not any((a, c) in known and (c, b) in known for c, _ in before)]


def _plain(tree: RiskTree, part: str) -> bool:
    """Whether sequences are all that orders a part, and no two gates share an element."""
    names = below(tree, [part])
    uses = Counter(child for name in names for child in tree.children(name))
    if any(number > 1 for number in uses.values()):
        return False
    if any(name in one.dependents for one in tree.dependencies for name in names):
        return False
    if any(name in one.children for one in tree.restrictions for name in names):
        return False
    gates = [tree.gates[name] for name in names if name in tree.gates]
    return all(gate.op.static or gate.op is Op.SEQUENCE for gate in gates)


def _plain_sequences(tree: RiskTree, part: str, order: int | None) -> tuple[list[Sequenced], bool]:
    names = below(tree, [part])
    relaxed = {
        name: replace(gate, op=Op.AND if gate.op is Op.SEQUENCE else gate.op)
        for name in names
        if (gate := tree.gates.get(name)) is not None
    }
    found = CutSets(replace(tree, root=part, gates=relaxed, dependencies=(), restrictions=()), order=order)
    inside = {name: frozenset(below(tree, [name])) for name in names}
    ordered = [gate.children for name in names if (gate := tree.gates.get(name)) and gate.op is Op.SEQUENCE]
    some: list[Sequenced] = []
    for one in found:
        before = [
            (a, b)
            for children in ordered
            for first, then in pairwise([c for c in children if not inside[c].isdisjoint(one.leaves)])
            for a in one.leaves
            if a in inside[first]
            for b in one.leaves
            if b in inside[then]
        ]
        some.append(Sequenced(one.leaves, tuple(before)))
        if len(some) > _MOST_WORDS:
            raise TooLarge(f"sequences of events of {part}", limit=_MOST_WORDS)
    return some, found.complete
