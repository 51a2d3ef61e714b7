"""Events read beforehand, and events skipped, are as good as steps."""

from itertools import islice
from random import Random

import pytest

import rvaft
from rvaft.engine import Engine
from rvaft.errors import TraceError
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.checking import small_valid_trees
from tests.engine.dense import SHAPES, dense_trace, dense_tree

NOISE = {"nothing": "of the tree"}


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize("shape", SHAPES)
def test_taking_and_skipping_are_steps(shape: str, semantics: Semantics) -> None:
    random = Random(f"taking {shape} {semantics}")
    for tree in islice(small_valid_trees(lambda: dense_tree(random, SHAPES[shape])), 10):
        noise = 0.03 if semantics is Semantics.STRICT else 0.4
        stepping, taking = Engine(tree, semantics), Engine(tree, semantics)
        for event in dense_trace(random, SHAPES[shape], 8):
            count = random.randint(1, 3) if random.random() < noise else 0
            for _ in range(count):
                stepping.step(NOISE)
            assert taking.skip(count) == stepping.verdict
            assert taking.take(taking.read(event)) == stepping.step(event)
            assert taking.state == stepping.state
        assert taking.explanation == stepping.explanation
        assert taking.ended == stepping.ended
        assert taking.pending() == stepping.pending()


def told(monitor: Engine, word: str) -> list[Verdict]:
    return [monitor.step({"event": letter}) for letter in word]


def test_the_first_skipped_event_ends_a_strict_match() -> None:
    monitor = Engine(rvaft.loads("top sand a b;"), "strict")
    told(monitor, "a")
    assert monitor.skip(0) is Verdict.UNKNOWN
    assert monitor.skip(5) is Verdict.FALSE
    assert monitor.ended is not None
    assert monitor.ended.event == 2
    assert [awaited.node for awaited in monitor.ended.pending[0].awaited] == ["b"]
    assert monitor.skip(3) is Verdict.FALSE


@pytest.mark.parametrize("semantics", ["projected", "scattered"])
def test_skipped_events_are_counted(semantics: str) -> None:
    monitor = Engine(rvaft.loads("top sand a b;"), semantics)
    monitor.skip(1_000_000)
    told(monitor, "a")
    monitor.skip(10)
    assert told(monitor, "b") == [Verdict.TRUE]
    assert monitor.explanation is not None
    assert monitor.explanation.matched == {"a": 1_000_001, "b": 1_000_012}
    assert monitor.skip(1) is Verdict.TRUE
    with pytest.raises(TraceError) as caught:
        monitor.step([])
    assert caught.value.line == 1_000_014
