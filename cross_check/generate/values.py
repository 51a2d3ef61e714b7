"""Random values for variables under which some demands are met: the guards of a scenario, and that no event be ignored.

Candidates for a variable are what its comparisons are about, solved for it as far as the other sides have values (`T2 >= T1 + 10`
with T1 = 3 gives 12, 13 and 14), and a handful of values of the tree. Finding none proves nothing.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Final

import networkx as nx

from rvaft.model.guards import COMPARISONS, UNDEFINED, Guard, Operation, Operator, conjuncts, holds, value
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Binding, Literal, Variable
from rvaft.model.values import Json, is_number

TRIES: Final = 200
"""How many values to try for variables that hang together, and 20 more for each of them, before giving up."""
_ANY_ORDER: Final = 0.3
_INVERSE: Final = {
    Operator.ADD: (Operator.SUB, Operator.SUB),
    Operator.SUB: (Operator.ADD, Operator.SUB),
    Operator.MUL: (Operator.DIV, Operator.DIV),
    Operator.DIV: (Operator.MUL, Operator.DIV),
}
"""What solves `x ∘ a = g` for x (g applied to a), and `a ∘ x = g` (g and a, in the order that `_inverted` knows)."""


@dataclass(frozen=True, slots=True)
class Demand:
    """Something that a node asks of the values of some variables."""

    node: str
    needs: tuple[str, ...]
    test: Callable[[Binding], bool]
    guard: Guard | None = None


class Unmet(Exception):
    """No values were found; `refusing` are the last demands that refused."""

    def __init__(self, refusing: Sequence[Demand]) -> None:
        self.refusing = refusing
        super().__init__([demand.node for demand in refusing])


def guard_demands(node: str, guard: Guard) -> list[Demand]:
    """That a guard holds: a conjunction does when all its parts do, each of which can be looked at on its own."""
    return [Demand(node, guard_variables(part), partial(holds, part), part) for part in conjuncts(guard)]


def meeting(
    random: Random,
    demands: Sequence[Demand],
    names: Iterable[str],
    some: Callable[[str], Sequence[Json]],
    others: Sequence[Json],
    *,
    near: bool = True,
) -> dict[str, Json]:
    """Values for these variables and those of the demands; `some`, by name, are tried rather than `others`. Raises `Unmet`.

    Without `near`, strings next to those of guards are tried last, and variables get their values in their order.
    """
    refused = [demand for demand in demands if not demand.needs and not demand.test({})]
    if refused:
        raise Unmet(refused)
    graph = nx.Graph()
    graph.add_nodes_from(names)
    for demand in demands:
        graph.add_nodes_from(demand.needs)
        graph.add_edges_from((demand.needs[0], name) for name in demand.needs[1:])
    touching: dict[str, list[Demand]] = {name: [] for name in graph}
    for demand in demands:
        for name in demand.needs:
            touching[name].append(demand)
    found: dict[str, Json] = {}
    place = {name: index for index, name in enumerate(graph)}
    for component in nx.connected_components(graph):
        # Mostly in the order in which the trace binds them, so that times grow; what is hard from there may be easy from elsewhere.
        start = min(component, key=place.__getitem__)
        if near and random.random() < _ANY_ORDER:
            start = random.choice(sorted(component))
        order = [start, *(name for _, name in nx.bfs_edges(graph, start))]
        found |= _ValueSearch(random, order, touching, some, others, near=near).solve()
    return found


class _ValueSearch:
    """Variables that demands tie together, in the order in which they get values."""

    def __init__(
        self,
        random: Random,
        order: list[str],
        touching: dict[str, list[Demand]],
        some: Callable[[str], Sequence[Json]],
        others: Sequence[Json],
        *,
        near: bool,
    ) -> None:
        self.random = random
        self.order = order
        self.touching = touching
        self.some = some
        self.others = others
        self.near = near
        self.rank = {name: index for index, name in enumerate(order)}
        self.due = {name: [d for d in touching[name] if self._last(d) == name] for name in order}

    def _last(self, demand: Demand) -> str:
        return max(demand.needs, key=self.rank.__getitem__)

    def solve(self) -> dict[str, Json]:
        """Depth first, and back to the last variable that has to do with a failure; raises `Unmet`."""
        binding: dict[str, Json] = {}
        levels: list[tuple[Iterator[Json], set[int]]] = []
        deepest, refused = -1, list[Demand]()
        tries = TRIES + 20 * len(self.order)
        while len(binding) < len(self.order):
            if len(levels) == len(binding):
                levels.append((self._candidates(self.order[len(levels)], binding), set()))
            depth = len(levels) - 1
            name = self.order[depth]
            candidates, blamed = levels[-1]
            for candidate in candidates:
                tries -= 1
                binding[name] = candidate
                against = next((demand for demand in self.due[name] if not demand.test(binding)), None)
                if against is None:
                    break
                del binding[name]
                blamed.update(self.rank[other] for other in against.needs if other != name)
                if depth > deepest:
                    deepest, refused = depth, []
                if depth == deepest and against not in refused:
                    refused.append(against)
                if tries < 0:
                    raise Unmet(refused)
            else:
                if not blamed:
                    raise Unmet(refused)
                back = max(blamed)
                levels[back][1].update(blamed - {back})
                del levels[back + 1 :]
                for other in self.order[back:depth]:
                    del binding[other]
        return binding

    def _candidates(self, name: str, binding: Binding) -> Iterator[Json]:
        """Values to try for a variable: the promising ones in random order, then all others."""
        guards = [demand.guard for demand in self.touching[name] if demand.guard is not None]
        bounds = [bound for guard in guards for bound in _bounds(guard, name, binding)]
        close = [value for bound in bounds for value in around(bound)]
        last = [] if self.near else [value for value in close if isinstance(value, str) and value not in bounds]
        first = [*(value for value in close if self.near or value not in last), *self.some(name)]
        self.random.shuffle(first)
        yield from first
        yield from last
        yield from self.random.sample(self.others, len(self.others))


def around(bound: Json) -> list[Json]:
    """A value and those next to it."""
    if is_number(bound):
        near = [bound - 1, bound, bound + 1]
        if isinstance(bound, float):
            near += [math.nextafter(bound, -math.inf), math.nextafter(bound, math.inf)]
        return [number for number in near if _writable(number)]
    if isinstance(bound, str):
        return [bound, f"{bound}a", bound[:-1]]
    return [bound]


def _writable(number: float) -> bool:
    """Whether every JSON reader takes the number: no integer beyond a double, no infinity."""
    try:
        return math.isfinite(float(number))
    except OverflowError:
        return False


def _bounds(guard: Guard, name: str, binding: Binding) -> Iterator[Json]:
    """The values at which a comparison in the guard changes its mind about a variable, as far as that is known now."""
    todo: list[Guard] = [guard]
    while todo:
        part = todo.pop()
        if not isinstance(part, Operation):
            continue
        todo.extend(part.operands)
        if part.operator in COMPARISONS:
            left, right = part.operands
            for side, other in ((left, right), (right, left)):
                goal = _known(other, binding)
                if goal is not UNDEFINED:
                    yield from _solved(side, name, goal, binding)


def _solved(side: Guard, name: str, goal: Json, binding: Binding) -> Iterator[Json]:
    """The value of a variable with which a term has a value, where the variable stands in it once."""
    while isinstance(side, Operation):
        if side.operator is Operator.NEGATE:
            (side,) = side.operands
            goal = value(Operation(Operator.NEGATE, (Literal(goal),)), {})
        elif side.operator in _INVERSE:
            operator, (left, right) = side.operator, side.operands
            if (other := _known(right, binding)) is not UNDEFINED:
                side, goal = left, _inverted(operator, goal, other, unknown_left=True)
            elif (other := _known(left, binding)) is not UNDEFINED:
                side, goal = right, _inverted(operator, goal, other, unknown_left=False)
            else:
                return
        else:
            return
        if goal is UNDEFINED:
            return
    if side == Variable(name):
        yield goal


def _inverted(operator: Operator, goal: Json, other: Json, *, unknown_left: bool) -> Json:
    inverse = _INVERSE[operator][not unknown_left]
    first, second = Literal(goal), Literal(other)
    if not unknown_left and operator in (Operator.SUB, Operator.DIV):
        first, second = second, first
    found = value(Operation(inverse, (first, second)), {})
    return int(found) if isinstance(found, float) and found.is_integer() and abs(found) < 2**53 else found


def _known(guard: Guard, binding: Binding) -> Json:
    return value(guard, binding) if all(name in binding for name in guard_variables(guard)) else UNDEFINED
