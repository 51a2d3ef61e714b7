"""What attackers can choose: minimal attacks, and Pareto fronts of cost, probability and damage.

A step is a leaf with a `cost`; an attacker attempts some of the steps, which succeed with their
probabilities. The other leaves are faults, which nobody chooses. One decision diagram has the choices
first and the chances below them, so that each set of choices leads to its probability.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, NamedTuple

from rvaft.errors import TooLarge
from rvaft.risk.cut_sets import CutSet, CutSets
from rvaft.risk.diagram import DEFAULT_NODES, Diagram, diagram
from rvaft.risk.model import Op, RiskError, RiskTree
from rvaft.risk.probability import leaf_probability

DEFAULT_POINTS: Final = 1_000_000
"""The default number of points that are kept at once."""
_ORDER: Final = 4
_DIGITS: Final = 12
"""Numbers with the same digits are equal in comparisons: rounding must not make one dominate the other."""


@dataclass(frozen=True, slots=True)
class Attack:
    """Steps that are attempted, with their cost, the probability of the root, and the expected damage."""

    steps: tuple[str, ...]
    cost: float
    probability: float
    damage: float


class _Point(NamedTuple):
    cost: float
    probability: float
    damage: float
    steps: int


class Attacks:
    """The attacks of a tree at a time; raises `RiskError` without costs, or where order and rates matter together.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> text = "t and g h; g or a b; h or a c; a cost=3 prob=.5; b cost=2 prob=.8; c cost=2 prob=.9;"
    >>> attacks = Attacks(of_tree(rvaft.loads(text)))
    >>> [(one.cost, round(one.probability, 9)) for one in attacks.front()]
    [(0.0, 0.0), (3.0, 0.5), (4.0, 0.72), (7.0, 0.86)]
    """

    def __init__(self, tree: RiskTree, time: float | None = None, *, points: int = DEFAULT_POINTS) -> None:
        self.tree = _static(tree)
        self._points = points
        leaves = [self.tree.leaves[name] for name in self.tree.order() if name in self.tree.leaves]
        self.steps = tuple([leaf.name for leaf in leaves if leaf.numbers.cost is not None])
        if not self.steps:
            raise RiskError("no leaf has a cost: write cost=20 at the steps of an attack")
        if time is None and any(leaf.numbers.rate is not None for leaf in leaves):
            raise RiskError("the tree has rates: say at which time")
        self.faults = tuple([leaf.name for leaf in leaves if leaf.numbers.cost is None])
        missing = [name for name in self.faults if not self.tree.leaves[name].numbers.has_chance]
        if missing:
            raise RiskError(
                f"{missing[0]} has neither a cost nor a probability: write cost=C for a step of an attack, "
                "prob=P or lambda=RATE for a fault"
            )
        self._chances = {
            leaf.name: leaf_probability(leaf, time or 0.0) if leaf.numbers.has_chance else 1.0 for leaf in leaves
        }
        self._costs = {name: self.tree.leaves[name].numbers.cost or 0.0 for name in self.steps}

    def front(self, *, damage: bool = False) -> list[Attack]:
        """Return the attacks that no other beats in cost and probability; with `damage`, in cost, probability and
        expected damage. One attack is given for each point, by cost.

        Raises `TooLarge` beyond a number of points; its note has the best minimal attack of few steps.
        """
        hurting = [
            (name, value)
            for name in self.tree.order()
            if (value := (self.tree.leaves.get(name) or self.tree.gates[name]).numbers.damage)
        ]
        if damage and not hurting:
            raise RiskError("no node has a damage: write damage=100 at the nodes that hurt")
        some = hurting if damage else []
        made = diagram(
            self.tree,
            frozenset(),
            nodes=DEFAULT_NODES,
            others=[name for name, _ in some],
            chosen={name: f"choice of {name}" for name in self.steps},
        )
        try:
            found = _Front(made, self, [value for _, value in some], self._points).of(made.roots)
        except TooLarge as error:
            best = self.minimal(1, order=_ORDER, by="probability")
            if best:
                steps, chance = " ".join(best[0].steps), best[0].probability
                error.add_note(f"{steps} has probability {chance:.6g}, a lower bound of the greatest")
            raise
        return [self._attack(point) for point in sorted(found)]

    def _attack(self, point: _Point) -> Attack:
        steps = tuple([name for place, name in enumerate(self.steps) if point.steps >> place & 1])
        return Attack(steps, point.cost, point.probability, point.damage)

    def minimal(self, most: int | None = None, *, order: int | None = None, by: str = "cost") -> list[Attack]:
        """Return the minimal attacks: the steps of minimal cut sets, with the probability of the set.

        `by` is `cost`, the cheapest first, or `probability`, the most probable first.
        """
        found: dict[tuple[str, ...], Attack] = {}
        for one in CutSets(self.tree, order=order):
            attack = self._of_set(one)
            old = found.get(attack.steps)
            if old is None or attack.probability > old.probability:
                found[attack.steps] = attack
            if len(found) > self._points:
                raise TooLarge("minimal attacks", limit=self._points)
        key = (lambda a: (a.cost, -a.probability)) if by == "cost" else (lambda a: (-a.probability, a.cost))
        return sorted(found.values(), key=key)[:most]

    def _of_set(self, one: CutSet) -> Attack:
        steps = tuple([name for name in one.leaves if name in self._costs])
        probability = 1.0
        for name in one.leaves:
            probability *= self._chances[name]
        return Attack(steps, sum(self._costs[name] for name in steps), probability, self._damage(set(one.leaves)))

    def _damage(self, happened: set[str]) -> float:
        """Return the damage if exactly these leaves happen."""
        true: set[str] = set()
        total = 0.0
        for name in self.tree.order():
            gate = self.tree.gates.get(name)
            if gate is None:
                holds = name in happened
            else:
                many = sum(child in true for child in gate.children)
                need = {Op.OR: 1, Op.AT_LEAST: gate.need}.get(gate.op, len(gate.children))
                holds = many >= need
            if holds:
                true.add(name)
                total += (gate or self.tree.leaves[name]).numbers.damage or 0.0
        return total


class _Front:
    """The fronts of the nodes of a diagram: of tuples of nodes, one for each function, which share the choices."""

    def __init__(self, made: Diagram, attacks: Attacks, damages: Sequence[float], points: int) -> None:
        self._made, self._damages, self._points = made, damages, points
        count = len(attacks.steps)
        names = made.variables[:count]
        place = {f"choice of {name}": number for number, name in enumerate(attacks.steps)}
        self._steps = [place[name] for name in names]
        self._cost = [attacks._costs[attacks.steps[one]] for one in self._steps]  # noqa: SLF001 (its own)
        chances = {**dict.fromkeys(names, 0.0), **{name: attacks._chances[name] for name in made.variables[count:]}}  # noqa: SLF001
        self._values = made.values(chances)
        self._choices = count
        self._known: dict[tuple[int, ...], list[_Point]] = {}
        self._kept = 0

    def of(self, roots: tuple[int, ...]) -> list[_Point]:
        """Return the front of a tuple of nodes."""
        waiting = [roots]
        while waiting:
            nodes = waiting[-1]
            if nodes in self._known:
                waiting.pop()
                continue
            variable = min(map(self._variable, nodes))
            if variable >= self._choices:
                chance = [self._values[node] for node in nodes]
                damage = sum(value * one for value, one in zip(self._damages, chance[1:], strict=True))
                self._known[nodes] = [_Point(0.0, float(chance[0]), float(damage), 0)]
                waiting.pop()
                continue
            high, low = (tuple([self._branch(node, variable, place) for node in nodes]) for place in (1, 2))
            need = [one for one in (high, low) if one not in self._known]
            if need:
                waiting.extend(need)
                continue
            waiting.pop()
            cost, step = self._cost[variable], 1 << self._steps[variable]
            taken = [
                _Point(one.cost + cost, one.probability, one.damage, one.steps | step) for one in self._known[high]
            ]
            self._known[nodes] = _undominated([*self._known[low], *taken])
            self._kept += len(self._known[nodes])
            if self._kept > self._points:
                raise TooLarge("points of fronts", limit=self._points)
        return self._known[roots]

    def _variable(self, node: int) -> int:
        return self._made.nodes[node - 2].variable if node > 1 else len(self._made.variables)

    def _branch(self, node: int, variable: int, place: int) -> int:
        return self._made.nodes[node - 2][place] if self._variable(node) == variable else node


def _same(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _undominated(points: list[_Point]) -> list[_Point]:
    """Return the points that no other beats or equals in all of cost, probability and damage."""
    ranked = sorted(points, key=lambda one: (_same(one.cost), -_same(one.probability), -_same(one.damage), one.steps))
    kept: list[_Point] = []
    best: list[tuple[float, float]] = []
    """The pairs of probability and damage that were attained so far, for no greater cost."""
    for one in ranked:
        probability, damage = _same(one.probability), _same(one.damage)
        if not any(p >= probability and d >= damage for p, d in best):
            kept.append(one)
            best = [(p, d) for p, d in best if p > probability or d > damage]
            best.append((probability, damage))
    return kept


def _static(tree: RiskTree) -> RiskTree:
    """Return the tree with sequences of steps as `and`: an attacker takes the steps in order.

    Raises `RiskError` for a gate in which order changes the probability.
    """
    if tree.dependencies or tree.restrictions:
        raise RiskError("dependencies and restrictions of Galileo have no attack steps: only or, and, K of N, sand")
    gates = {}
    for name, gate in tree.gates.items():
        if gate.op is Op.SEQUENCE:
            timed = [leaf.node for leaf in tree.leaves.values() if leaf.numbers.rate is not None]
            if timed:
                raise RiskError(f"{name} is a sequence, and {timed[0]} has a rate: attacks in which the order and the "
                                "time matter are not analysed; write prob=P")  # fmt: skip
            gates[name] = replace(gate, op=Op.AND)
        elif gate.op.static:
            gates[name] = gate
        else:
            raise RiskError(f"{name} is a {gate.op.value}, which has no attack steps: only or, and, K of N, sand")
    return replace(tree, gates=MappingProxyType(gates))
