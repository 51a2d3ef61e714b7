"""Random trees to compare, reproducible from a seed."""

from collections.abc import Iterator
from random import Random
from typing import Final

from cross_check.catalogue import Entry
from rvaft.errors import TreeError
from rvaft.random_trees import Shape, random_tree
from rvaft.restrict import restrict
from rvaft.rules import require_valid
from rvaft.tree import RVAFT

MAX_NODES: Final = 9
_PARTS: Final = 0.2
"""How often one branch of a tree is compared instead of the whole."""


def campaign(number: int, seed: int, max_nodes: int = MAX_NODES) -> Iterator[Entry]:
    """So many trees of every shape; the i-th depends on the seed, the size and i alone."""
    shape = Shape(max_nodes=max_nodes)
    for index in range(1, number + 1):
        random = Random(f"{seed} {max_nodes} {index}")  # noqa: S311 (no secret)
        tree = random_tree(random, shape)
        branch = _feasible_branch(random, tree) if random.random() < _PARTS else None
        yield Entry(f"random {index} of seed {seed}", tree, branch)


def _feasible_branch(random: Random, tree: RVAFT) -> int | None:
    """The number of some branch that can be monitored by itself."""
    number = random.randint(1, sum(1 for _ in tree.branches()))
    try:
        require_valid(restrict(tree, branch=number))
    except TreeError:
        return None
    return number
