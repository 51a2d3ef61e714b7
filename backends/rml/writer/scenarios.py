"""The feasible scenarios of a tree as sets of bits (semantics, section 2).

A set of occurrences or of scenarios is an integer, bit i standing for the i-th. Choices are made from the root down; a shared
gate is met once. Under `scattered` a VOT keeps exactly K children: one more never helps, since any position may be skipped.
"""

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

from rvaft.errors import TooLarge, TreeError
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

Kept = Mapping[str, tuple[str, ...]]
Chosen = tuple[tuple[str, ...], ...]
"""The children kept of each choice so far, none of one that is not reached."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """Its occurrences, what comes before each of them (generators of the precedence), and its nodes with a guard to check."""

    occurrences: int
    before: Mapping[int, int]
    guards: frozenset[str]


def bits(mask: int) -> Iterator[int]:
    """The members of a set."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


def feasible_scenarios(tree: RVAFT, semantics: Semantics, *, limit: int) -> list[Scenario]:
    """The feasible scenarios, each once.

    Raises `TooLarge` beyond `limit`; `TreeError` where there is none, where one has no occurrence, or leaves a guard unbound.
    """
    index = {name: position for position, name in enumerate(tree.occurrences)}
    found: dict[object, Scenario] = {}
    for kept in _resolutions(tree, semantics, limit):
        scenario = _scenario(tree, kept, index)
        if tree.shared and not _acyclic(scenario):
            continue
        found.setdefault((scenario.occurrences, tuple(scenario.before.items()), scenario.guards), scenario)
    if not found:
        raise TreeError("no scenario is feasible", rule="no-scenario", nodes=[tree.root])
    for scenario in found.values():
        _check(tree, scenario)
    return list(found.values())


def constant(node: Node) -> bool:
    """Whether the node has a guard without variables."""
    return node.when is not None and not guard_variables(node.when)


def impossible(node: Node) -> bool:
    """Whether the node has a guard without variables that does not hold."""
    return node.when is not None and constant(node) and not holds(node.when, {})


def _resolutions(tree: RVAFT, semantics: Semantics, limit: int) -> Iterator[Kept]:
    """The ways to resolve the reached choices that keep no impossible node."""
    order = tree.order
    position = {name: index for index, name in enumerate(order)}
    surely = _surely(tree, position)
    possible = _possible(tree)
    if tree.root not in possible:
        return
    gates = [name for name in order if tree.nodes[name].gate in (Gate.OR, Gate.VOT)]

    def further(reached: int, chosen: Chosen) -> Iterator[tuple[int, Chosen]]:
        name = gates[len(chosen)]
        if not reached >> position[name] & 1:
            yield reached, (*chosen, ())
            return
        for children in _options(tree.nodes[name], possible, semantics):
            more = reached
            for child in children:
                more |= surely[child]
            yield more, (*chosen, children)

    start: tuple[int, Chosen] = (surely[tree.root], ())
    agenda: list[Iterator[tuple[int, Chosen]]] = [iter([start])]  # not of ways: a VOT may have more than fit anywhere
    count = 0
    while agenda:
        step = next(agenda[-1], None)
        if step is None:
            agenda.pop()
            continue
        reached, chosen = step
        if len(chosen) < len(gates):
            agenda.append(further(reached, chosen))
            continue
        count += 1
        if count > limit:
            raise TooLarge("scenarios of the tree", limit=limit)
        choice = dict(zip(gates, chosen, strict=True))
        yield {order[i]: choice.get(order[i], tree.nodes[order[i]].children) for i in bits(reached)}


def _possible(tree: RVAFT) -> set[str]:
    """The nodes that some resolution of the choices below them keeps without an impossible node."""
    found: set[str] = set()
    for node in tree.bottom_up():
        some = sum(child in found for child in node.children)
        needed = 1 if node.gate is Gate.OR else node.threshold or len(node.children)
        if some >= needed and not impossible(node):
            found.add(node.name)
    return found


def _options(node: Node, possible: Container[str], semantics: Semantics) -> Iterable[tuple[str, ...]]:
    children = [child for child in node.children if child in possible]
    if node.gate is Gate.OR:
        return [(child,) for child in children]
    least = node.threshold or 0
    most = least if semantics is Semantics.SCATTERED else len(children)
    return (chosen for size in range(least, most + 1) for chosen in combinations(children, size))


def _surely(tree: RVAFT, position: Mapping[str, int]) -> dict[str, int]:
    """Of each node, the nodes that are kept whenever it is: those below it up to the next choices."""
    surely: dict[str, int] = {}
    for node in tree.bottom_up():
        mask = 1 << position[node.name]
        if node.gate not in (Gate.OR, Gate.VOT):
            for child in node.children:
                mask |= surely[child]
        surely[node.name] = mask
    return surely


def _scenario(tree: RVAFT, kept: Kept, index: Mapping[str, int]) -> Scenario:
    """One pass up for the events in each part, one pass down for what comes before it."""
    part: dict[str, int] = {}
    for name in reversed(tuple(kept)):
        mask = 1 << index[name] if name in index else 0
        for child in kept[name]:
            mask |= part[child]
        part[name] = mask
    earlier = dict.fromkeys(kept, 0)
    before: dict[int, int] = {}
    for name, children in kept.items():
        node = tree.nodes[name]
        above = earlier[name]
        if name in index and tree.causality is Causality.TOP_DOWN:
            before[index[name]] = above
            above |= 1 << index[name]
        elif name in index:
            before[index[name]] = above | part[name] & ~(1 << index[name])
        in_time = children if node.gate is not Gate.SAND_RL else children[::-1]
        for child in in_time:
            earlier[child] |= above
            if node.gate is not None and node.gate.ordered:
                above |= part[child]
    guards = (name for name in kept if tree.nodes[name].when is not None and not constant(tree.nodes[name]))
    return Scenario(part[tree.root], before, frozenset(guards))


def _acyclic(scenario: Scenario) -> bool:
    """Whether its occurrences have an order in which they can happen."""
    left = scenario.occurrences
    while left:
        now = 0
        for index in bits(left):
            if not scenario.before[index] & left:
                now |= 1 << index
        if not now:
            return False
        left &= ~now
    return True


def _check(tree: RVAFT, scenario: Scenario) -> None:
    if not scenario.occurrences:
        raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario", nodes=[tree.root])
    if not scenario.guards:
        return
    bound = {
        argument.name
        for i in bits(scenario.occurrences)
        if (on := tree.nodes[tree.occurrences[i]].on) is not None
        for argument in on.arguments
        if hasattr(argument, "name")
    }
    for name in sorted(scenario.guards):
        when = tree.nodes[name].when
        assert when is not None
        for variable in guard_variables(when):
            if variable not in bound:
                message = f"the guard of {name} speaks of {variable}, which nothing binds in one of its scenarios"
                raise TreeError(message, rule="unbound-variable", nodes=[name])
