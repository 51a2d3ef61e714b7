"""Hypothesis strategies for trees and traces (needs the extra `testing`)."""

from collections.abc import Callable
from random import Random
from typing import Final, TypeVar

from hypothesis import reject
from hypothesis import strategies as st

from cross_check.generate.disturbances import NearMiss, disturbed, near_miss
from cross_check.generate.traces import NoTraceFound, detecting, random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

T = TypeVar("T")
ANY: Final = Shape()


def randoms() -> st.SearchStrategy[Random]:
    """Sources of randomness by their seed: what is made with them takes one number, however large it gets."""
    return st.integers(min_value=0, max_value=2**32 - 1).map(Random)


def trees(shape: Shape = ANY) -> st.SearchStrategy[RVAFT]:
    """Valid random trees of a shape."""
    return randoms().map(lambda random: random_tree(random, shape))


def traces(tree: RVAFT, *, max_length: int = 8) -> st.SearchStrategy[list[Json]]:
    """Traces that have to do with a tree."""
    return randoms().map(lambda random: random_trace(random, tree, max_length=max_length))


@st.composite
def trees_with_traces(draw: st.DrawFn, shape: Shape = ANY, max_length: int = 8) -> tuple[RVAFT, list[Json]]:
    """A tree and a trace for it."""
    tree = draw(trees(shape))
    return tree, draw(traces(tree, max_length=max_length))


def semantics() -> st.SearchStrategy[Semantics]:
    """The four semantics."""
    return st.sampled_from(Semantics)


def detecting_traces(tree: RVAFT, semantics: Semantics = Semantics.PROJECTED) -> st.SearchStrategy[list[Json]]:
    """Traces at the last event of which a valid tree is detected."""
    return _found(lambda random: detecting(random, tree, semantics))


def disturbed_traces(tree: RVAFT, semantics: Semantics = Semantics.PROJECTED) -> st.SearchStrategy[list[Json]]:
    """Detecting traces after one edit or a few; the tree may be detected in them all the same."""
    return _found(lambda random: disturbed(random, detecting(random, tree, semantics), tree))


def near_misses(tree: RVAFT, semantics: Semantics = Semantics.PROJECTED) -> st.SearchStrategy[NearMiss]:
    """Traces in which a valid tree is not detected, one edit away from one in which it is."""
    return _found(lambda random: near_miss(random, tree, semantics))


@st.composite
def trees_with_guided_traces(draw: st.DrawFn, shape: Shape = ANY) -> tuple[RVAFT, Semantics, list[Json]]:
    """A valid tree, a semantics, and a trace that is led through the tree under it, disturbed or not."""
    tree, chosen = draw(trees(shape)), draw(semantics())
    return tree, chosen, draw(st.one_of(detecting_traces(tree, chosen), disturbed_traces(tree, chosen)))


def _found(make: Callable[[Random], T]) -> st.SearchStrategy[T]:
    """What is made with a source of randomness; where no trace is found, the example is passed over."""

    def made(random: Random) -> T:
        try:
            return make(random)
        except NoTraceFound:
            reject()

    return randoms().map(made)
