"""Hypothesis strategies for trees and traces (requires the extra `testing`)."""

from collections.abc import Callable
from random import Random
from typing import Final, TypeVar

from hypothesis import reject
from hypothesis import strategies as st

from cross_check.generate.disturbances import UndetectedTrace, disturbed, near_miss
from cross_check.generate.traces import NoTraceFound, detecting, random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

T = TypeVar("T")
ANY: Final = Shape()


def randoms() -> st.SearchStrategy[Random]:
    """Return random generators by seed, so that an example is one number."""
    return st.integers(min_value=0, max_value=2**32 - 1).map(Random)


def trees(shape: Shape = ANY) -> st.SearchStrategy[RVAFT]:
    """Return valid random trees of a shape."""
    return randoms().map(lambda random: random_tree(random, shape))


def traces(tree: RVAFT, *, max_length: int = 8) -> st.SearchStrategy[list[Json]]:
    """Return traces for a tree."""
    return randoms().map(lambda random: random_trace(random, tree, max_length=max_length))


@st.composite
def trees_with_traces(draw: st.DrawFn, shape: Shape = ANY, max_length: int = 8) -> tuple[RVAFT, list[Json]]:
    """Return a tree and a trace for it."""
    tree = draw(trees(shape))
    return tree, draw(traces(tree, max_length=max_length))


def semantics() -> st.SearchStrategy[Semantics]:
    """Return the four semantics."""
    return st.sampled_from(Semantics)


def detecting_traces(tree: RVAFT, semantics: Semantics = Semantics.PROJECTED) -> st.SearchStrategy[list[Json]]:
    """Return traces whose last event detects a valid tree."""
    return _found(lambda random: detecting(random, tree, semantics))


def disturbed_traces(tree: RVAFT, semantics: Semantics = Semantics.PROJECTED) -> st.SearchStrategy[list[Json]]:
    """Return detecting traces after edits; the tree may still be detected."""
    return _found(lambda random: disturbed(random, detecting(random, tree, semantics), tree))


def near_misses(tree: RVAFT, semantics: Semantics = Semantics.PROJECTED) -> st.SearchStrategy[UndetectedTrace]:
    """Return traces without detection, one edit away from a detecting one."""
    return _found(lambda random: near_miss(random, tree, semantics))


@st.composite
def trees_with_guided_traces(draw: st.DrawFn, shape: Shape = ANY) -> tuple[RVAFT, Semantics, list[Json]]:
    """Return a valid tree, a semantics, and a detecting or disturbed trace."""
    tree, chosen = draw(trees(shape)), draw(semantics())
    return tree, chosen, draw(st.one_of(detecting_traces(tree, chosen), disturbed_traces(tree, chosen)))


def _found(make: Callable[[Random], T]) -> st.SearchStrategy[T]:

    def made(random: Random) -> T:
        try:
            return make(random)
        except NoTraceFound:
            reject()

    return randoms().map(made)
