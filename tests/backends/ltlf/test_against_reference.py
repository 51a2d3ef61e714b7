"""Random trees of every shape: after every prefix the text gives the verdict of the reference, and nothing is refused."""

from itertools import islice
from random import Random

import pytest

from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft.analysis.branches import restrict
from rvaft.errors import TreeError
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.ltlf.building import BACKEND, needs_spot

pytestmark = needs_spot

SHAPES = {
    "any": Shape(),
    "shared": Shape(max_nodes=11, sharing=0.5, typed_events=0.3, variables=0, guards=0.1, gate_events=0.3),
    "overlapping": Shape(max_nodes=10, sharing=0.2, typed_events=0.9, variables=0, guards=0.1, gate_events=0.4),
    "apart": Shape(max_nodes=11, sharing=0.1, typed_events=0.1, variables=0, guards=0, gate_events=0.2),
    "variables": Shape(max_nodes=10, sharing=0.3, typed_events=0.9, variables=1, guards=0.5),
}


def selection(random: Random, tree: RVAFT) -> dict[str, int | str]:
    """The whole tree, a branch, or a kind that it has."""
    kinds = {str(kind) for node in tree.top_down() if (kind := node.kind) is not None}
    count = sum(1 for _ in islice(tree.branches(), 10))
    choices: list[dict[str, int | str]] = [{}, {"branch": random.randint(1, count)}]
    choices += [{"kind": kind} for kind in sorted(kinds)]
    return random.choice(choices)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(16))
def test_random_trees(shape: str, seed: int) -> None:
    random = Random(f"{shape} {seed}")
    tree = random_tree(random, SHAPES[shape])
    chosen = selection(random, tree)
    try:
        Reference(tree, Semantics.STRICT, **chosen)  # type: ignore[arg-type]
        part = restrict(tree, **chosen)  # type: ignore[arg-type]
    except TreeError:  # that branch has no feasible scenario
        chosen, part = {}, tree
    traces = [random_trace(random, tree) for _ in range(5)]
    for semantics in Semantics:
        specification = BACKEND.translate(part, semantics)
        for trace in traces:
            expected = list(Reference(tree, semantics, **chosen).run(trace))  # type: ignore[arg-type]
            assert list(specification.monitor().run(trace)) == expected, (semantics, trace, specification.text)
