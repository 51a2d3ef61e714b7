"""Absent events in the languages that write them, held against the reference on random trees."""

from contextlib import suppress
from random import Random

import pytest

from rvaft import NotExpressible, RvaftError, Semantics, TooLarge
from rvaft.backend import backend
from rvaft.rules.validity import require_valid
from tests.backends.texts import agreeing, readable
from tests.engine.dense import CHOOSING, Dense, dense_trace, dense_tree

SHAPES = {
    "events": Dense(absences=0.3, nodes=6, sharing=0.3, guards=0, gates=CHOOSING),
    "values": Dense(absences=0.5, nodes=4, letters=3, variables=0.6, guards=0),
    "other letters": Dense(absences=0.5, nodes=4, letters=5, gate_events=0.1, guards=0, gates=CHOOSING),
}


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.ci)])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", readable("automaton", "c", "eql", "ltlf", "mtl", "sql", "sql-duckdb"))
def test_absent_events_of_random_trees(name: str, shape: str, count: int) -> None:
    random, translator, trees, compared = Random(f"{name} {shape}"), backend(name), 0, 0
    while trees < count:
        tree = dense_tree(random, SHAPES[shape])
        with suppress(RvaftError):
            require_valid(tree)
            if not tree.absences:
                continue
            trees += 1
            for semantics in Semantics:
                with suppress(NotExpressible, TooLarge):
                    traces = [dense_trace(random, SHAPES[shape], 7) for _ in range(6)]
                    compared += agreeing(translator, tree, semantics, traces)
    assert compared >= count // 2
