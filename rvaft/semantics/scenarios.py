"""Scenarios and branches (definition, section 2)."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise, product

from rvaft.model.guards import TimePoint, walk
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.semantics.events import bound_by, holds, names

Resolution = Mapping[str, tuple[str, ...]]
Order = Mapping[str, frozenset[str]]
"""For each occurrence, all occurrences that precede it."""


def resolutions(tree: RVAFT, choices: Callable[[Node], Iterable[tuple[str, ...]]]) -> Iterator[Resolution]:
    """Clause: starting at the root keep, at each reached gate, one of its choices. A shared gate is
    resolved once.
    """
    agenda: list[tuple[dict[str, tuple[str, ...]], list[str]]] = [({}, [tree.root])]
    while agenda:
        kept, reached = agenda.pop()
        waiting = [name for name in reached if name not in kept]
        if not waiting:
            yield kept
            continue
        ways = choices(tree.nodes[waiting[0]])
        agenda += [({**kept, waiting[0]: children}, [*waiting[1:], *children]) for children in ways]


def scenario_choices(node: Node) -> Iterable[tuple[str, ...]]:
    """Clause: at each `or` exactly one child; at each `KofN`, K children *or more*; at other gates,
    all.
    """
    if node.gate is Gate.OR:
        return [(child,) for child in node.children]
    if node.gate is Gate.VOT:
        sizes = range(node.threshold or 0, len(node.children) + 1)
        return [chosen for size in sizes for chosen in combinations(node.children, size)]
    return [node.children]


def branch_choices(node: Node) -> Iterable[tuple[str, ...]]:
    """Clause: a branch resolves only the `or` gates and keeps `KofN`."""
    return scenario_choices(node) if node.gate is Gate.OR else [node.children]


@dataclass(frozen=True)
class ReferenceScenario:
    """Clause: a scenario is a labelled partial order of occurrences plus guards."""

    tree: RVAFT
    kept: Resolution

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """The kept nodes."""
        return tuple(self.tree.nodes[name] for name in self.kept)

    @cached_property
    def occurrences(self) -> frozenset[str]:
        """Clause: its nodes with a runtime event are its occurrences: one occurrence per node."""
        return frozenset(self.observing)

    @cached_property
    def observing(self) -> Mapping[str, Node]:
        """The node of each occurrence. Clause: a leaf with `times N` is N occurrences."""
        plain = {node.name for node in self.nodes if node.on is None and node.gate is None and node.when is None}
        events = [node for node in self.nodes if node.on is not None or node.name in plain]
        return {name: node for node in events for name in several(self.tree, node)}

    def events(self, name: str) -> frozenset[str]:
        """Return the occurrences of the part of a node."""
        part = self.part(name)
        return frozenset(occurrence for occurrence, node in self.observing.items() if node.name in part)

    def part(self, name: str) -> frozenset[str]:
        """Clause: the child and its descendants in the scenario."""
        found, agenda = set[str](), [name]
        while agenda:
            name = agenda.pop()
            if name not in found:
                found.add(name)
                agenda += self.kept[name]
        return frozenset(found)

    @cached_property
    def precedences(self) -> list[Order]:
        """The strict precedences by causality, sequence and ends; several only with `pand`."""
        pairs = set[tuple[str, str]]()
        for node in self.nodes:
            below = self.part(node.name) - {node.name}
            # Clause: a node's event comes before the events of all its descendants; bottom_up turns it round.
            pairs |= (
                {(node.name, other) for other in below} if self._top_down else {(other, node.name) for other in below}
            )
            # Clause: under `sand`, all events of a child's part come before all events of each later child's part.
            children = self.kept[node.name] if node.gate is not Gate.SAND_RL else self.kept[node.name][::-1]
            if node.gate in (Gate.SAND, Gate.SAND_RL):
                parts = combinations([self.part(child) for child in children], 2)
                pairs |= {(a, b) for earlier, later in parts for a in earlier for b in later}
        # Clause: a leaf with `times N` is N occurrences, each before the next.
        node_of = self.observing
        fixed = {(a, b) for a in node_of for b in node_of if (node_of[a].name, node_of[b].name) in pairs}
        fixed |= {
            pair for node in self.nodes for pair in combinations(several(self.tree, node), 2) if pair[0] in node_of
        }
        return [_closed(self.occurrences, fixed.union(*ends)) for ends in product(*self._ends)]

    @property
    def _ends(self) -> Iterator[list[set[tuple[str, str]]]]:
        """For each `pand`, the ways to choose the last occurrence of each part, as pairs of the
        precedence.

        Clause: the last position of each part is before the last position of the next; a part
        without occurrences orders nothing.
        """
        for node in self.nodes:
            if node.gate is Gate.PAND:
                parts = [events for child in self.kept[node.name] if (events := self.events(child))]
                yield [
                    {(other, last) for part, last in zip(parts, lasts, strict=True) for other in part - {last}}
                    | set(pairwise(lasts))
                    for lasts in product(*map(sorted, parts))
                ]

    @cached_property
    def orders(self) -> list[Order]:
        """The acyclic precedences."""
        return [
            order
            for order in self.precedences
            if all(occurrence not in order[occurrence] for occurrence in self.occurrences)
        ]

    @property
    def before(self) -> Order:
        """The first precedence, the only one without `pand`."""
        return self.precedences[0]

    @property
    def _top_down(self) -> bool:
        return self.tree.causality is Causality.TOP_DOWN

    @cached_property
    def feasible(self) -> bool:
        """Clause: infeasible when its precedence is cyclic or a guard without variables and time
        points does not hold.
        """
        constant = [node.when for node in self.nodes if node.when is not None and not names(node.when)]
        return bool(self.orders) and all(holds(guard, {}) for guard in constant)

    @cached_property
    def bound(self) -> frozenset[str]:
        """The variables that some `on` of the scenario binds."""
        return frozenset(name for node in self.nodes for name in bound_by(node))

    @cached_property
    def points(self) -> Mapping[str, frozenset[str]]:
        """The time points of the guards and windows, each with the occurrences of its part."""
        guards = [node.when for node in self.nodes if node.when is not None]
        used = {part for guard in guards for part in walk(guard) if isinstance(part, TimePoint)}
        used |= {TimePoint.of(point, n.name) for n in self.nodes if n.within is not None for point in ("start", "end")}
        return {
            point.name: frozenset()
            if point.node not in self.kept
            else self.events(point.node)
            if point.point != "at"
            else self.occurrences & {point.node}
            for point in used
        }


def several(tree: RVAFT, node: Node) -> list[str]:
    """Return the names of a node's occurrences: its own or, with `times N`, numbered ones."""
    if node.times == 1:
        return [node.name]
    numbered = [f"{node.name}[{number}]" for number in range(1, node.times + 1)]
    return [
        next(name + "'" * n for n in range(len(tree.nodes) + 1) if name + "'" * n not in tree.nodes)
        for name in numbered
    ]


def _closed(occurrences: frozenset[str], pairs: set[tuple[str, str]]) -> Order:
    """Return the transitive closure of the pairs, as all occurrences before each one."""
    before = {occurrence: {a for a, b in pairs if b == occurrence} for occurrence in occurrences}
    for occurrence in occurrences:
        agenda = list(before[occurrence])
        while agenda:
            new = before[agenda.pop()] - before[occurrence]
            before[occurrence] |= new
            agenda += new
    return {occurrence: frozenset(found) for occurrence, found in before.items()}


def scenarios(tree: RVAFT) -> list[ReferenceScenario]:
    """Return all scenarios, including infeasible ones."""
    return [ReferenceScenario(tree, kept) for kept in resolutions(tree, scenario_choices)]


def feasible_scenarios(tree: RVAFT) -> list[ReferenceScenario]:
    """Clause: infeasible scenarios are dropped."""
    return [scenario for scenario in scenarios(tree) if scenario.feasible]


def branches(tree: RVAFT) -> list[Resolution]:
    """Return all branches in the order of their numbers, from 1.

    Clause: numbered from 1; the `or` nearest the root varies fastest (then children in order).
    """
    distance, ring = {tree.root: 0}, [tree.root]
    for name in ring:
        for child in tree.nodes[name].children:
            if child not in distance:
                distance[child] = distance[name] + 1
                ring.append(child)
    ors = [name for name in ring if tree.nodes[name].gate is Gate.OR]

    def digits(branch: Resolution) -> list[int]:
        return [tree.nodes[name].children.index(branch[name][0]) if name in branch else 0 for name in reversed(ors)]

    return sorted(resolutions(tree, branch_choices), key=digits)


def of_branch(scenario: ReferenceScenario, branch: Resolution) -> bool:
    """Whether the scenario resolves its `or` gates as the branch does."""
    ors = [name for name in scenario.kept if scenario.tree.nodes[name].gate is Gate.OR]
    return all(branch.get(name) == scenario.kept[name] for name in ors)
