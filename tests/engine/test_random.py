"""The engine against the reference on random trees: verdicts, explanations, and what equal states promise."""

from itertools import islice
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cross_check.generate.strategies import trees_with_traces
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft.engine import Engine
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.engine.checking import compare, small_and_valid, small_valid_trees
from tests.engine.dense import SHAPES, dense_trace, dense_tree

SEMANTICS = [semantics.value for semantics in Semantics]
WILD = {
    "any": Shape(),
    "shared": Shape(sharing=0.6, variables=0.3),
    "variables": Shape(sharing=0.1, variables=1, typed_events=0.9, guards=0.5),
    "wide": Shape(max_nodes=13, max_children=6, typed_events=0.3),
}


def _dense_cases(shape: str, seed: int, count: int) -> None:
    random = Random(f"{shape} {seed}")
    for tree in islice(small_valid_trees(lambda: dense_tree(random, SHAPES[shape])), count):
        for semantics in SEMANTICS:
            _check(random, tree, dense_trace(random, SHAPES[shape], 9), semantics)
            _check(random, tree, _living_trace(random, tree, shape, semantics), semantics)


def _check(random: Random, tree: RVAFT, trace: list[dict[str, Any]], semantics: str) -> None:
    compare(tree, trace, semantics)
    if random.random() < 0.3:
        compare(tree, trace, semantics, branch=random.randint(1, 3))
        compare(tree, trace, semantics, kind=random.choice(("fault", "attack")))


def _living_trace(random: Random, tree: RVAFT, shape: str, semantics: str) -> list[dict[str, Any]]:
    """A trace that avoids ⊥ for as long as it easily can."""
    trace: list[dict[str, Any]] = []
    monitor = Engine(tree, semantics)
    while len(trace) < 9 and not monitor.verdict.final:
        for event in dense_trace(random, SHAPES[shape], 6):
            monitor = Engine(tree, semantics)
            if [verdict.value for verdict in monitor.run([*trace, event])][-1] != "false":
                break
        trace.append(event)
    return trace


@pytest.mark.parametrize("shape", SHAPES)
def test_dense_trees(shape: str) -> None:
    _dense_cases(shape, 0, 12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
@pytest.mark.parametrize("shape", SHAPES)
def test_many_dense_trees(shape: str, seed: int) -> None:
    _dense_cases(shape, seed, 50)


def _wild_cases(shape: str, seed: int, count: int) -> None:
    random = Random(f"{shape} {seed}")
    for _ in range(count):
        tree = random_tree(random, WILD[shape])
        if small_and_valid(tree):
            for semantics in SEMANTICS:
                _check(random, tree, random_trace(random, tree), semantics)


@pytest.mark.parametrize("shape", WILD)
def test_wild_trees(shape: str) -> None:
    _wild_cases(shape, 0, 40)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
@pytest.mark.parametrize("shape", WILD)
def test_many_wild_trees(shape: str, seed: int) -> None:
    _wild_cases(shape, seed, 200)


@settings(deadline=None, max_examples=60, suppress_health_check=list(HealthCheck))
@given(trees_with_traces(), st.sampled_from(SEMANTICS))
def test_any_tree(tree_and_trace: tuple[RVAFT, list[dict[str, Any]]], semantics: str) -> None:
    tree, trace = tree_and_trace
    assume(small_and_valid(tree))
    compare(tree, trace, semantics)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_equal_states_have_equal_futures(shape: str, semantics: str) -> None:
    """Held against the reference too: the state must not forget what the meaning depends on."""
    random = Random(f"states {shape}")
    compared = 0
    for _ in range(14):
        tree = dense_tree(random, SHAPES[shape])
        if small_and_valid(tree):
            compared += _compare_futures(random, tree, shape, semantics)
    assert compared


def _compare_futures(random: Random, tree: RVAFT, shape: str, semantics: str) -> int:
    by_state: dict[object, list[list[dict[str, Any]]]] = {}
    for _ in range(6):
        monitor, trace = Engine(tree, semantics), []
        for event in dense_trace(random, SHAPES[shape], 4):
            trace.append(event)
            if not monitor.step(event).final:
                by_state.setdefault(monitor.state, []).append(list(trace))
    compared = 0
    for traces in by_state.values():
        monitors = [Engine(tree, semantics) for _ in traces]
        references = [Reference(tree, semantics) for _ in traces]
        future = dense_trace(random, SHAPES[shape], 5)
        for monitor, reference, trace in zip(monitors, references, traces, strict=True):
            _run(monitor, reference, trace)
        for event in future:
            assert len({monitor.state for monitor in monitors}) == 1
            verdicts = {*(m.step(event) for m in monitors), *(r.step(event) for r in references)}
            assert len(verdicts) == 1, traces
        compared += len(traces) - 1
    return compared


def _run(monitor: Engine, reference: Reference, trace: list[dict[str, Any]]) -> None:
    for event in trace:
        monitor.step(event)
        reference.step(event)
