"""How many scenarios a tree can have and how many events a detection takes, counted without trying them."""

from itertools import pairwise
from math import prod
from typing import Final

from rvaft.model import Gate, Node
from rvaft.tree import RVAFT

SCENARIOS: Final = 5_000
"""The most scenarios that the reference is made to try."""


def most_scenarios(tree: RVAFT) -> int:
    """A bound on the number of scenarios; the number itself where no node is shared and every scenario is feasible."""
    ways: dict[str, int] = {}
    for node in tree.bottom_up():
        ways[node.name] = _ways(node, [ways[child] for child in node.children])
    return ways[tree.root]


def _ways(node: Node, below: list[int]) -> int:
    match node.gate:
        case Gate.OR:
            return sum(below)
        case Gate.VOT:
            return _at_least(node.threshold or 0, below)
        case _:
            return prod(below)


def _at_least(threshold: int, below: list[int]) -> int:
    """The ways to keep at least so many children."""
    keeping = [1, *([0] * len(below))]
    for ways in below:
        keeping = [keeping[0], *(more + ways * fewer for fewer, more in pairwise(keeping))]
    return sum(keeping[threshold:])


def least_events(tree: RVAFT) -> int:
    """About how many events a detection takes at least; exact where no node is shared and every scenario is feasible."""
    least: dict[str, int] = {}
    for node in tree.bottom_up():
        below = sorted(least[child] for child in node.children)
        kept = {Gate.OR: 1, Gate.VOT: node.threshold or 0}.get(node.gate or Gate.AND, len(below))
        least[node.name] = sum(below[:kept]) + node.has_event
    return least[tree.root]
