"""Binary decision diagrams of monotone functions over leaves and independent parts, as flat tables.

Oxidd builds them, in the order in which a depth-first walk meets the leaves.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from itertools import pairwise
from operator import and_, or_
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar, assert_never

from rvaft.errors import TooLarge, installed
from rvaft.risk.model import PACKAGES, Op, RiskGate, RiskTree

T = TypeVar("T")

DEFAULT_NODES: Final = 4_000_000
"""The default number of nodes of a diagram: about 100 MB."""


class Node(NamedTuple):
    """A decision: the number of a variable, and the places of the results where it is true and false."""

    variable: int
    high: int
    low: int


class Diagram(NamedTuple):
    """Functions of variables: `nodes` has each node after its results; 0 and 1 are false and true.

    The node at place i of `nodes` has the number i + 2; `roots` are the numbers of the elements asked for.
    """

    variables: tuple[str, ...]
    nodes: tuple[Node, ...]
    roots: tuple[int, ...]

    @property
    def root(self) -> int:
        """The number of the first element asked for, the root of the tree."""
        return self.roots[0]

    def values(self, chances: Mapping[str, Any]) -> list[Any]:
        """Return the probability of each node, given that of each variable: numbers, or arrays of equal length."""
        chance = [chances[name] for name in self.variables]
        found: list[Any] = [0.0, 1.0]
        for variable, high, low in self.nodes:
            p = chance[variable]
            found.append(p * found[high] + (1 - p) * found[low])
        return found

    def probability(self, chances: Mapping[str, Any]) -> Any:
        """Return the probability of the function."""
        return self.values(chances)[self.root]

    def slopes(self, chances: Mapping[str, Any]) -> dict[str, Any]:
        """Return the derivative by the probability of each variable (Birnbaum's importance)."""
        chance = [chances[name] for name in self.variables]
        values = self.values(chances)
        reached: list[Any] = [0.0] * len(values)
        reached[self.root] = 1.0
        found: list[Any] = [0.0] * len(self.variables)
        for place in range(len(self.nodes) + 1, 1, -1):
            variable, high, low = self.nodes[place - 2]
            weight = reached[place]
            found[variable] = found[variable] + weight * (values[high] - values[low])
            reached[high] = reached[high] + weight * chance[variable]
            reached[low] = reached[low] + weight * (1 - chance[variable])
        return dict(zip(self.variables, found, strict=True))


def diagram(
    tree: RiskTree,
    parts: frozenset[str],
    *,
    nodes: int = DEFAULT_NODES,
    others: Sequence[str] = (),
    chosen: Mapping[str, str] = MappingProxyType({}),
) -> Diagram:
    """Return the diagram of a tree, and of `others` of its elements, with `parts` as variables beside the leaves.

    A leaf in `chosen` happens only if the variable that it names is true, too; these variables come
    first.

    Gates that are no parts are static. A dependent happens, too, if its trigger does. Raises
    `TooLarge` beyond a number of nodes, and `ToolMissing` without oxidd.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> made = diagram(of_tree(rvaft.loads("t or a g; g and b c;")), frozenset())
    >>> made.variables, made.probability({"a": 0.5, "b": 0.5, "c": 0.5})
    (('a', 'b', 'c'), 0.625)
    """
    oxidd = installed("oxidd.bdd", "oxidd", PACKAGES)
    causes = tree.causes()
    order = walk(tree, parts, causes)
    variables = [chosen[name] for name in order if name in chosen]
    variables += [name for name in order if name in tree.leaves or name in parts]
    manager = oxidd.BDDManager(nodes, max(1024, nodes // 4), 1)
    manager.add_vars(len(variables))
    number = {name: place for place, name in enumerate(variables)}
    false, true = manager.false(), manager.true()
    made: dict[str, Any] = dict.fromkeys(order, false)
    try:
        while True:  # once, unless dependencies form a cycle
            changed = False
            for name in order:
                if name in number:
                    found = manager.var(number[name])
                    if name in chosen:
                        found = found & manager.var(number[chosen[name]])
                    for trigger, coin in causes.get(name, ()) if name in tree.leaves else ():
                        found = found | (made[trigger] if coin is None else made[trigger] & made[coin])
                else:
                    gate = tree.gates[name]
                    children = [made[child] for child in gate.children]
                    found = gate_value(gate, children, false=false, true=true, either=or_, both=and_)
                changed = changed or made[name] != found
                made[name] = found
            if not causes or not changed:
                return flat_diagram(tuple(variables), [made[name] for name in (tree.root, *others)], nodes)
    except MemoryError:
        raise TooLarge("nodes of a decision diagram", limit=nodes) from None


def walk(tree: RiskTree, parts: frozenset[str], causes: Mapping[str, Sequence[tuple[str, str | None]]]) -> list[str]:
    """Return the elements to build, each after those that it needs, from left to right."""
    found: dict[str, None] = {}
    entered: set[str] = set()
    waiting = [(tree.root, False)]
    while waiting:
        name, done = waiting.pop()
        if done:
            found[name] = None
        elif name not in entered:
            entered.add(name)
            waiting.append((name, True))
            if name in parts:
                continue
            needs = [one for cause in causes.get(name, ()) for one in cause if one is not None]
            waiting.extend((one, False) for one in reversed([*tree.children(name), *needs]))
    return list(found)


def gate_value(
    gate: RiskGate, parts: Sequence[T], *, false: T, true: T, either: Callable[[T, T], T], both: Callable[[T, T], T]
) -> T:
    """Return the value of a static gate from those of its children, by disjunction and conjunction.

    >>> gate = RiskGate("g", Op.AT_LEAST, ("a", "b", "c"), need=2)
    >>> gate_value(gate, [True, False, True], false=False, true=True, either=or_, both=and_)
    True
    """
    match gate.op:
        case Op.OR:
            return reduce(lambda found, part: either(part, found), reversed(parts), false)
        case Op.AND:
            return reduce(lambda found, part: both(part, found), reversed(parts), true)
        case Op.AT_LEAST:
            row = [true, *[false] * gate.need]
            for part in reversed(parts):  # row[k]: at least k of the parts so far
                row = [true, *(either(more, both(part, fewer)) for fewer, more in pairwise(row))]
            return row[gate.need]
        case Op.SEQUENCE | Op.PRIORITY | Op.FIRST | Op.SPARE:
            raise AssertionError(gate.op)
        case _:
            assert_never(gate.op)


def flat_diagram(variables: tuple[str, ...], roots: list[Any], limit: int) -> Diagram:
    """Return functions of oxidd as a diagram; raises `TooLarge` beyond a number of nodes."""
    place: dict[Any, int] = {}
    nodes: list[Node] = []

    def known(function: Any) -> int | None:
        return (1 if function.valid() else 0) if function.node_level() is None else place.get(function)

    waiting = [*roots]
    while waiting:
        function = waiting[-1]
        if known(function) is not None:
            waiting.pop()
            continue
        high, low = function.cofactors()
        need = [one for one in (high, low) if known(one) is None]
        if need:
            waiting.extend(need)
            continue
        waiting.pop()
        at_high, at_low = known(high), known(low)
        assert at_high is not None
        assert at_low is not None
        place[function] = len(nodes) + 2
        nodes.append(Node(function.node_var(), at_high, at_low))
        if len(nodes) > limit:
            raise TooLarge("nodes of a decision diagram", limit=limit)
    return Diagram(variables, tuple(nodes), tuple([found for root in roots if (found := known(root)) is not None]))
