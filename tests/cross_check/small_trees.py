"""Small trees of every shape, and what the reference says of traces for them."""

from collections.abc import Callable, Iterator
from random import Random
from typing import Any, Final, ParamSpec, TypeVar

from cross_check.generate.traces import NoTraceFound
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, Shape, random_tree
from rvaft import RVAFT, Semantics, Verdict
from rvaft.model.values import Json
from rvaft.semantics import Reference
from tests.engine.checking import small_and_valid
from tests.engine.dense import SHAPES as DENSE
from tests.engine.dense import dense_tree

P = ParamSpec("P")
T = TypeVar("T")

SHAPES: Final = {
    "everything": Shape(),
    "plain": PLAIN,
    "without variables": VARIABLE_FREE,
    "shared": Shape(sharing=0.7, gate_events=0.5, max_nodes=8),
    "guarded": Shape(variables=1, guards=0.7, typed_events=0.9, ignores=0),
    "ignoring": Shape(ignores=1, typed_events=0.9),
    "in practice": Shape(times=0.9, counted=0.2, pand=0.5, functions=0.6, variables=0.7, max_nodes=7),
}


def small_trees(shape: str, count: int) -> Iterator[tuple[Random, RVAFT]]:
    """Valid trees that the reference can follow, each with the randomness to go on with."""
    seed = 0
    while count:
        random = Random(f"{shape} {seed}")
        seed += 1
        tree = random_tree(random, SHAPES[shape]) if shape in SHAPES else dense_tree(random, DENSE[shape])
        if small_and_valid(tree):
            count -= 1
            yield random, tree


def verdicts(tree: RVAFT, semantics: Semantics, trace: list[Json], **part: Any) -> list[Verdict]:
    return list(Reference(tree, semantics, **part).run(trace))


def detects(tree: RVAFT, semantics: Semantics, trace: list[Json], **part: Any) -> bool:
    """Whether the reference says ⊤ after the last event, and nothing before."""
    return verdicts(tree, semantics, trace, **part) == [*[Verdict.UNKNOWN] * (len(trace) - 1), Verdict.TRUE]


def found(make: Callable[P, T], *args: P.args, **options: P.kwargs) -> T | None:
    """What is made, or None where no trace was found."""
    try:
        return make(*args, **options)
    except NoTraceFound:
        return None
