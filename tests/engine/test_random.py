"""The engine against the reference on random trees: verdicts, explanations, what equal states
promise, and ways to the same events.
"""

import pickle
from contextlib import suppress
from itertools import islice, product
from random import Random

import pytest

from rvaft.core.restriction import restrict
from rvaft.engine import Engine, stages
from rvaft.errors import TreeError
from rvaft.model.verdict import Semantics, Verdict
from rvaft.semantics import Reference
from tests.engine.checking import compare, small_valid_trees
from tests.engine.dense import SHAPES, WILD, dense_trace, dense_tree, trace_of, tree_of
from tests.tables import sampled

SEMANTICS = [semantics.value for semantics in Semantics]
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 21))]
NOISE = {"nothing": "of the tree"}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("shape", sampled([*SHAPES, *WILD], 8, ci=3))
def test_verdicts_and_explanations(shape: str, seed: int) -> None:
    random = Random(f"{shape} {seed}")
    count = 50 if seed else 6 if shape in SHAPES else 12
    for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), count):
        for semantics in SEMANTICS:
            trace = trace_of(random, tree, shape, semantics)
            compare(tree, trace, semantics)
            if random.random() < 0.3:
                compare(tree, trace, semantics, branch=random.randint(1, 3))
                compare(tree, trace, semantics, kind=random.choice(("fault", "attack")))
            if shape in SHAPES:
                compare(tree, dense_trace(random, SHAPES[shape], 9), semantics)


@pytest.mark.parametrize(("shape", "semantics"), sampled(product(SHAPES, SEMANTICS), 23, ci=9))
def test_equal_states_have_equal_futures(shape: str, semantics: str) -> None:
    """Held against the reference too: the state must not forget what the meaning depends on."""
    random = Random(f"states {shape}")
    compared = 0
    for tree in islice(small_valid_trees(lambda: dense_tree(random, SHAPES[shape])), 4):
        by_state: dict[object, list[tuple[Engine, Reference]]] = {}
        for _ in range(15):  # times differ in most states
            monitor, reference = Engine(tree, semantics), Reference(tree, semantics)
            for event in dense_trace(random, SHAPES[shape], 4):
                if monitor.step(event).final:
                    break
                reference.step(event)
                by_state.setdefault(monitor.state, []).append((monitor.fork(), reference.fork()))
        for alike in by_state.values():
            for event in dense_trace(random, SHAPES[shape], 5):
                assert len({monitor.state for monitor, _ in alike}) == 1
                assert len({verdict for pair in alike for verdict in (pair[0].step(event), pair[1].step(event))}) == 1
            compared += len(alike) - 1
    assert compared


def told_by(monitor: Engine) -> tuple[object, ...]:
    return monitor.verdict, monitor.state, monitor.explanation, monitor.pending(), monitor.ended


@pytest.mark.parametrize(("shape", "semantics"), sampled(product([*SHAPES, *WILD], SEMANTICS), 17, ci=7))
def test_all_ways_to_the_same_events(shape: str, semantics: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Events read beforehand, events skipped, copies and pickles made in between, a memory that
    loses everything all the time.
    """
    random = Random(f"ways {shape} {semantics}")
    told = dict.fromkeys(Verdict, 0)
    for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), 4):
        kinds = sorted({node.kind for node in tree.nodes.values() if node.kind is not None})
        part = tree
        if kinds and random.random() < 0.3:
            with suppress(TreeError):
                restricted = restrict(tree, kind=random.choice(kinds))
                Engine(restricted, semantics)  # raises if no scenario of the kind is feasible
                part = restricted
        straight, taking, pickled, forgetful = (Engine(part, semantics) for _ in range(4))
        for event in trace_of(random, tree, shape, semantics):
            skipped = random.randint(1, 3) if random.random() < (0.03 if semantics == "strict" else 0.3) else 0
            for monitor in (straight, pickled, forgetful):
                for _ in range(skipped):
                    monitor.step(NOISE)
            assert taking.skip(skipped) == straight.verdict
            kept = pickle.dumps(pickled)
            pickled.step(NOISE)
            pickled = pickle.loads(kept)
            taking = taking.fork()
            with monkeypatch.context() as patch:
                patch.setattr(stages, "MEMORY", 3)
                forgetful.step(event)
            straight.step(event)
            if taking.is_late(event):
                taking.skip(1)
            else:
                taking.take(taking.read(event, taking.letters.classify(event)))
            pickled.step(event)
            for monitor in (taking, pickled, forgetful):
                assert told_by(monitor) == told_by(straight)
        told[straight.verdict] += 1
    assert told[Verdict.TRUE] + told[Verdict.FALSE] or semantics in ("scattered", "consecutive")
