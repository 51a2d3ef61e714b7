"""The probability of a tree in time: independent parts by chains, what joins them by a decision diagram.

A part is independent if nothing outside depends on its leaves (modules of Dutuit and Rauzy, 1996);
it needs a chain if the order of its events matters.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import networkx as nx

from rvaft.errors import installed
from rvaft.risk.chain import DEFAULT_STATES, Machine
from rvaft.risk.diagram import DEFAULT_NODES, Diagram, diagram
from rvaft.risk.model import PACKAGES, Leaf, RiskError, RiskTree
from rvaft.risk.transient import Chain, chain, from_start, mean_time

if TYPE_CHECKING:
    import numpy as np

    Numbers = np.ndarray[Any, Any]

MTTF_ERROR: Final = 1e-9
"""The relative error that a mean time by integration may have."""
_PER_DECADE: Final = 3
_NEGLIGIBLE: Final = 1e-13


def _decades(longest: float, rates: Sequence[float]) -> int:
    return max(2, math.ceil(math.log10(longest * max(rates))) + 2)


@dataclass(frozen=True, slots=True)
class Importance:
    """How much one leaf matters to the probability of the root, at one time.

    `probability` is the leaf's own, `birnbaum` is P(root | leaf) - P(root | not leaf), `criticality`
    is birnbaum × probability / P(root), `diagnostic` (DIF) is P(leaf | root), `achievement` (RAW) is
    P(root | leaf) / P(root), `reduction` (RRW) is P(root) / P(root | not leaf). None where a number is not
    defined: a leaf in a part in which order matters has no probability of its own.
    """

    leaf: str
    probability: float | None
    birnbaum: float
    criticality: float | None
    diagnostic: float | None
    achievement: float | None
    reduction: float | None


class Analysis:
    """The probabilities of one tree; solved parts are kept. Times are in the unit of the rates.

    Raises `RiskError` for a tree that cannot be analysed, and `TooLarge` beyond the limits.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> analysis = Analysis(of_tree(rvaft.loads("t sand x y; x lambda=.5; y lambda=.2;")))
    >>> round(analysis.at(1.0), 10), round(analysis.mean_time(), 6)
    (0.039802518, 7.0)
    """

    def __init__(self, tree: RiskTree, *, states: int = DEFAULT_STATES, nodes: int = DEFAULT_NODES) -> None:
        tree.require_numbers()
        self.unit = tree.unit
        if tree.timed:
            some = ", ".join(tree.timed[:5])
            raise RiskError(
                f"windows, absent events and ends in order ({some}) have no chain: `rvaft risk --simulate N` estimates"
            )
        self.tree = tree
        self._states, self._nodes = states, nodes
        self.parts = dynamic_parts(tree)
        """The roots of the independent parts in which order matters."""

    @cached_property
    def diagram(self) -> Diagram:
        """The function of leaves and parts that is the root."""
        return diagram(self.tree, self.parts, nodes=self._nodes)

    @cached_property
    def chains(self) -> Mapping[str, Chain]:
        """The chain of each part."""
        return {part: self._chain(part, {}) for part in sorted(self.parts)}

    def _chain(self, part: str, given: Mapping[str, float]) -> Chain:
        return chain(Machine(self.tree, part, given=given), states=self._states)

    def at(self, time: float) -> float:
        """Return the probability that the root has happened by a time."""
        return self.curve([time])[0]

    def curve(self, times: Sequence[float]) -> list[float]:
        """Return the probability that the root has happened by each time."""
        return [float(one) for one in _array(self.diagram.probability(self._chances(times)), len(times))]

    def element(self, name: str, time: float) -> float:
        """Return the probability of another element than the root."""
        return Analysis(replace(self.tree, root=name), states=self._states, nodes=self._nodes).at(time)

    def _chances(self, times: Sequence[float]) -> dict[str, Any]:
        import numpy as np  # noqa: PLC0415 -- imported on use

        found: dict[str, Any] = {}
        for name in self.diagram.variables:
            if name in self.parts:
                found[name] = _of_chain(self.chains[name], times)
            else:
                leaf = self.tree.leaves[name]
                found[name] = np.array([leaf_probability(leaf, time) for time in times])
        return found

    def mean_time(self) -> float:
        """Return the mean time until the root happens, or infinity if it may never happen.

        Raises `RiskError` if the integral does not converge.
        """
        if self.diagram.variables == (self.tree.root,) and self.tree.root in self.parts:
            return _mean_of_chain(self.chains[self.tree.root])
        rates = [leaf.numbers.rate for leaf in self._leaves() if leaf.numbers.chance is None and leaf.numbers.rate]
        if self.diagram.probability({name: self._at_last(name) for name in self.diagram.variables}) < 1:
            return math.inf
        if not rates:
            return 0.0
        longest = self._longest(rates)
        if not math.isfinite(longest * max(rates)):
            raise RiskError("the rates are too far apart: no number is printed")
        cuts = [
            0.0,
            *(longest * 10 ** (-step / _PER_DECADE) for step in range(_PER_DECADE * _decades(longest, rates), -1, -1)),
        ]
        few, many = (self._integral(cuts, points) for points in (16, 24))
        rest = (1 - self.at(longest)) * longest
        if abs(few - many) + rest > MTTF_ERROR * many:
            raise RiskError("the mean time does not converge to a relative 1e-9: no number is printed")
        return many

    def _integral(self, cuts: Sequence[float], points: int) -> float:
        """Return the integral of 1 - P over panels, by Gauss and Legendre."""
        numpy = installed("numpy", "NumPy", "pip install numpy")
        nodes, weights = numpy.polynomial.legendre.leggauss(points)
        times: list[float] = []
        scaled: list[float] = []
        for begin, end in pairwise(cuts):
            times += list((end - begin) / 2 * nodes + (begin + end) / 2)
            scaled += list((end - begin) / 2 * weights)
        return float(sum(weight * (1 - p) for weight, p in zip(scaled, self.curve(times), strict=True)))

    def _longest(self, rates: Sequence[float]) -> float:
        """Return a time by which the root has happened, but for a negligible part."""
        time = 1 / max(rates)
        while 1 - self.at(time) > _NEGLIGIBLE:
            time *= 4
        return time

    def _leaves(self) -> list[Leaf]:
        return [self.tree.leaves[name] for name in self.tree.order() if name in self.tree.leaves]

    def _at_last(self, name: str) -> float:
        """Return the probability that a variable ever happens, 1 exactly if it is certain."""
        if name not in self.parts:
            numbers = self.tree.leaves[name].numbers
            return numbers.chance if numbers.chance is not None else 1.0 if numbers.rate else 0.0
        return 1.0 if math.isfinite(_mean_of_chain(self.chains[name])) else 0.0

    def importance(self, time: float) -> list[Importance]:
        """Return the importance of each leaf at a time, in the order of the leaves."""
        chances = {name: float(_array(one, 1)[0]) for name, one in self._chances([time]).items()}
        slopes = self.diagram.slopes(chances)
        whole = float(self.diagram.probability(chances))
        found: list[Importance] = []
        for name in self.diagram.variables:
            if name in self.parts:
                for leaf in Machine(self.tree, name).leaves:
                    happened, never = (float(_of_chain(self._given(name, leaf, how), [time])[0]) for how in (1.0, 0.0))
                    with_it, without = (whole + slopes[name] * (value - chances[name]) for value in (happened, never))
                    found.append(_importance(leaf.name, None, with_it, without, whole))
            else:
                p, slope = chances[name], float(slopes[name])
                found.append(_importance(name, p, whole + (1 - p) * slope, whole - p * slope, whole))
        return found

    def _given(self, part: str, leaf: Leaf, how: float) -> Chain:
        return self._chain(part, {leaf.name: how})


def _importance(name: str, p: float | None, with_it: float, without: float, whole: float) -> Importance:
    slope = with_it - without
    ratio = with_it / whole if whole else None
    return Importance(
        name,
        p,
        slope,
        None if p is None or not whole else p * slope / whole,
        None if p is None or ratio is None else p * ratio,
        ratio,
        whole / without if without > 0 else math.inf if whole else None,
    )


def leaf_probability(leaf: Leaf, time: float) -> float:
    """Return the probability that a leaf has happened by a time, all its events.

    >>> from rvaft.model.quantities import Quantities
    >>> round(leaf_probability(Leaf("a", "a", Quantities(rate=1.0), once=True, times=2), 1.0), 12)
    0.264241117657
    """
    numbers = leaf.numbers
    if numbers.chance is not None:
        return numbers.chance
    mean = ((numbers.rate or 0.0) * time) ** numbers.shape
    if leaf.times == 1:
        return -math.expm1(-mean)
    if numbers.shape != 1:
        raise RiskError(f"{leaf.node} has `times` and `shape`: write one of them")
    special = installed("scipy.special", "scipy", PACKAGES)
    return float(special.gammainc(leaf.times, mean))


def leaf_chances(tree: RiskTree, time: float) -> dict[str, float]:
    """Return the probability of each leaf by a time."""
    return {name: leaf_probability(leaf, time) for name, leaf in tree.leaves.items()}


def _of_chain(solved: Chain, times: Sequence[float]) -> "Numbers":
    return from_start(solved, solved.machine.start(), times)


def _mean_of_chain(solved: Chain) -> float:
    start = solved.start(solved.machine.start())
    means = mean_time(solved)
    return float(sum(weight * mean for weight, mean in zip(start, means, strict=True) if weight))


def _array(value: Any, count: int) -> "Numbers":
    import numpy as np  # noqa: PLC0415 -- imported on use

    return np.broadcast_to(np.asarray(value, dtype=float), (count,))


def dynamic_parts(tree: RiskTree) -> frozenset[str]:
    """Return the roots of the least independent parts that contain all gates in which order matters.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> sorted(dynamic_parts(of_tree(rvaft.loads("t or g c; g sand a b;"))))
    ['g']
    """
    names = list(tree.needed(tree.root))
    restricted = {child for one in tree.restrictions for child in one.children}
    dynamic = [name for name in names if (name in tree.gates and not tree.gates[name].op.static) or name in restricted]
    if not dynamic:
        return frozenset()
    graph = nx.DiGraph()
    graph.add_node(tree.root)
    graph.add_edges_from((name, other) for name in names for other in tree.needs(name))
    above = nx.immediate_dominators(graph, tree.root)
    reach: dict[str, frozenset[str]] = {}
    found: set[str] = set()
    for name in dynamic:
        part = name
        while part != tree.root and not (part in tree.gates and _independent(graph, tree.root, part, reach)):
            part = above[part]
        found.add(part)
    inside = {part: _reachable(graph, part) for part in found}
    return frozenset(part for part in found if not any(part in inside[o] and part != o for o in found))


def _reachable(graph: "nx.DiGraph[str]", name: str) -> frozenset[str]:
    return frozenset(nx.descendants(graph, name))


def _independent(graph: "nx.DiGraph[str]", root: str, part: str, known: dict[str, frozenset[str]]) -> bool:
    if part not in known:
        inside = _reachable(graph, part)
        outside = nx.descendants(nx.restricted_view(graph, [part], []), root)
        known[part] = inside & outside
    return not known[part]
