"""How many scenarios a tree can have, counted without trying them."""

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
