"""Hypothesis strategies for trees and traces (needs the extra `rvaft[testing]`)."""

from random import Random

from hypothesis import strategies as st

from rvaft.random_traces import random_trace
from rvaft.random_trees import Shape, random_tree
from rvaft.tree import RVAFT
from rvaft.values import Json


def randoms() -> st.SearchStrategy[Random]:
    """Sources of randomness by their seed: what is made with them takes one number, however large it gets."""
    return st.integers(min_value=0, max_value=2**32 - 1).map(Random)


def trees(shape: Shape = Shape()) -> st.SearchStrategy[RVAFT]:  # noqa: B008 -- immutable
    """Valid random trees of a shape."""
    return randoms().map(lambda random: random_tree(random, shape))


def traces(tree: RVAFT, *, max_length: int = 8) -> st.SearchStrategy[list[Json]]:
    """Traces that have to do with a tree."""
    return randoms().map(lambda random: random_trace(random, tree, max_length=max_length))


@st.composite
def trees_with_traces(
    draw: st.DrawFn,
    shape: Shape = Shape(),  # noqa: B008 -- immutable
    max_length: int = 8,
) -> tuple[RVAFT, list[Json]]:
    """A tree and a trace for it."""
    tree = draw(trees(shape))
    return tree, draw(traces(tree, max_length=max_length))
