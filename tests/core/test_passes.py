"""A property and every pass on it mean what the tree means: two references, verdict for verdict."""

from contextlib import suppress
from itertools import islice
from random import Random

import pytest

from cross_check.generate.traces import NoTraceFound, guided, random_trace
from cross_check.generate.trees import random_tree
from rvaft import RVAFT, Kind, Semantics, TooLarge, TreeError
from rvaft.core import passes, time_order
from rvaft.core.branches import branches
from rvaft.core.property import Property
from rvaft.core.restriction import property_of, restrict
from rvaft.semantics import Reference
from rvaft.semantics.properties import PropertyReference
from tests.engine.checking import small_valid_trees
from tests.engine.dense import WILD, tree_of
from tests.tables import sampled

CHAINS = {
    "build": (),
    "expand_times": (passes.expand_times,),
    "order_ends": (time_order.order_ends,),
    "windows_to_guards": (time_order.windows_to_guards,),
    "simplify": (time_order.windows_to_guards, passes.simplify),
    "flatten": (time_order.windows_to_guards, passes.simplify, passes.flatten),
}
"""The passes in the orders in which they are used."""

SEEDS = [
    pytest.param(0, 2, marks=pytest.mark.sample),
    pytest.param(0, 4, marks=pytest.mark.ci),
    *(pytest.param(seed, 40, marks=pytest.mark.slow) for seed in range(1, 11)),
]


def through(prop: Property, chain: str) -> Property:
    """The property after the passes of a chain, each of which removed what it says."""
    for one in CHAINS[chain]:
        prop = one(prop)
        assert not one.removes & {type(part) for part in prop.parts}
    return prop


def agree(tree: RVAFT, random: Random, *, branch: int | None = None, kind: Kind | None = None) -> int:
    """How many verdicts both references gave, on traces that detect and others, after each chain of passes."""
    part = restrict(tree, branch=branch, kind=kind)
    prop = property_of(part)
    traces = [random_trace(random, tree) for _ in range(3)]
    compared = 0
    for semantics in Semantics:
        with suppress(NoTraceFound, TooLarge):
            traces.append(guided(random, part, semantics))
        try:
            expected = [run(Reference(tree, semantics, branch=branch, kind=kind), trace) for trace in traces]
        except TreeError:
            return 0
        for chain in CHAINS:
            after = through(prop, chain)
            for trace, verdicts in zip(traces, expected, strict=True):
                assert run(PropertyReference(after, semantics), trace) == verdicts, (chain, semantics, trace)
                compared += len(verdicts)
    return compared


def run(monitor: Reference | PropertyReference, trace: list[object]) -> list[str]:
    """The verdicts."""
    return [monitor.step(event).symbol for event in trace]


@pytest.mark.parametrize(("seed", "count"), SEEDS)
@pytest.mark.parametrize("shape", sampled(WILD, 3))
def test_random_trees(shape: str, seed: int, count: int) -> None:
    random = Random(f"core {shape} {seed}")
    compared = 0
    for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), count):
        compared += agree(tree, random)
        number = random.randint(1, len(list(islice(branches(tree), 5))))
        compared += agree(tree, random, branch=number)
        kinds = {kind for one in islice(branches(tree), 50) for kind in one.kinds}
        compared += sum(agree(tree, random, kind=kind) for kind in kinds)
    assert compared


@pytest.mark.parametrize("seed", sampled(range(3), 3))
def test_generated_trees(seed: int) -> None:
    random = Random(f"core {seed}")
    for tree in islice(small_valid_trees(lambda: random_tree(random)), 8):
        agree(tree, random)
