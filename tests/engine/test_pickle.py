"""A monitor pickled in the middle of a trace goes on as if nothing had happened."""

import copy
import pickle
import subprocess
import sys
from itertools import islice
from random import Random
from typing import Any

import pytest

import rvaft
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft.analysis.branches import restrict
from rvaft.engine import Engine
from rvaft.model.nodes import Gate, Kind, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.checking import small_valid_trees
from tests.engine.dense import SHAPES, dense_tree
from tests.engine.living import living_trace

WILD = {
    "any": Shape(),
    "shared": Shape(sharing=0.6, variables=0.3),
    "variables": Shape(sharing=0.1, variables=1, typed_events=0.9, guards=0.5),
}


def again(monitor: Engine) -> Engine:
    """The monitor after a night on disk."""
    twin = pickle.loads(pickle.dumps(monitor))
    assert isinstance(twin, Engine)
    return twin


def same(left: Engine, right: Engine) -> None:
    """Both monitors tell the same."""
    assert left.verdict == right.verdict
    assert left.state == right.state
    assert left.explanation == right.explanation
    assert left.pending() == right.pending()
    assert left.ended == right.ended


def parts(random: Random, tree: RVAFT) -> list[RVAFT]:
    """The tree, and perhaps what a monitor for a kind or a branch looks at."""
    kinds = sorted({node.kind for node in tree.nodes.values() if node.kind is not None})
    found = [tree]
    if kinds and random.random() < 0.5:
        try:
            found.append(restrict(tree, kind=Kind(random.choice(kinds))))
        except rvaft.TreeError:
            found.append(restrict(tree, branch=1))
    return found


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize("shape", [*SHAPES, *WILD])
def test_a_monitor_goes_on(shape: str, semantics: Semantics) -> None:
    random = Random(f"pickle {shape} {semantics}")
    told: dict[Verdict, int] = dict.fromkeys(Verdict, 0)

    def made() -> RVAFT:
        return dense_tree(random, SHAPES[shape]) if shape in SHAPES else random_tree(random, WILD[shape])

    for tree in islice(small_valid_trees(made), 8):
        for part in parts(random, tree):
            trace = living_trace(random, tree, shape, semantics) if shape in SHAPES else random_trace(random, tree)
            straight, halting = Engine(part, semantics), Engine(part, semantics)
            for event in trace:
                kept = pickle.dumps(halting)
                halting.step({"event": "lost with the machine"})
                halting = pickle.loads(kept)
                assert halting.step(event) == straight.step(event)
                assert halting.state == straight.state
            same(halting, straight)
            same(again(halting), straight)
            told[straight.verdict] += 1
    assert told[Verdict.TRUE]


def test_an_end_is_kept() -> None:
    engine = Engine(rvaft.loads("top or x y; x sand a b; y sand c d;"), "strict")
    engine.step({"event": "a"})
    expected = engine.pending()
    engine.step({"event": "c"})
    twin = again(engine)
    assert twin.ended == engine.ended
    assert twin.ended is not None
    assert (twin.ended.event, twin.ended.pending) == (2, expected)


@pytest.mark.parametrize("semantics", list(Semantics))
def test_long_matches_and_small_pickles(semantics: Semantics) -> None:
    """A match of thousands of events is deeper than Python can recurse; what is compiled from the tree is not written."""
    leaves = tuple(f"n{number}" for number in range(3000))
    tree = RVAFT("top", [Node("top", Gate.AND, leaves), *map(Node, leaves)])
    engine = Engine(tree, semantics)
    for name in leaves[:-1]:
        engine.step({"event": name})
    twin = again(engine)
    assert twin.step({"event": leaves[-1]}) is Verdict.TRUE
    engine.step({"event": leaves[-1]})
    assert twin.explanation == engine.explanation
    assert len(pickle.dumps(engine)) < len(pickle.dumps(tree)) + 100 * len(leaves)


def test_partial_matches_share_what_they_have_in_common() -> None:
    """A thousand values after thirty common events are not a thousand times thirty events."""
    names = [f"n{number}" for number in range(30)]
    tree = rvaft.loads(
        f"event e(v) = {{ v: v }}; event f(v) = {{ f: v }}; top sand {' '.join(names)} x y; x on e(V); y on f(V);"
    )
    engine = Engine(tree, "scattered")
    for name in names:
        engine.step({"event": name})
    for value in range(500):
        engine.step({"v": value})
    before = len(pickle.dumps(engine))
    for value in range(500, 1000):
        engine.step({"v": value})
    assert len(pickle.dumps(engine)) - before < 500 * 300
    twin = again(engine)
    assert twin.step({"f": 1000}) is Verdict.UNKNOWN
    assert twin.step({"f": 999}) is Verdict.TRUE
    assert twin.explanation is not None
    assert twin.explanation.matched["x"] == 30 + 1000


@pytest.mark.parametrize("semantics", list(Semantics))
def test_asking_first_changes_nothing(semantics: Semantics) -> None:
    """What was computed on demand is written or made anew, but never wrong afterwards."""
    engine = Engine(rvaft.loads("top 2of3 a b c;"), semantics)
    assert engine.explanation is None
    engine.step({"event": "a"})
    twin = again(engine)
    engine.step({"event": "b"})
    assert engine.explanation is not None
    assert twin.explanation is None
    assert twin.step({"event": "c"}) is Verdict.TRUE
    assert again(engine).explanation == engine.explanation != twin.explanation


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, Engine.fork])
def test_copies_are_independent(copied: Any, semantics: Semantics) -> None:
    for text in ("top sand x y; x or a b; y and c d;", "top sand a b;"):
        engine = Engine(rvaft.loads(text), semantics)
        engine.step({"event": "a"})
        before = engine.state
        twin = copied(engine)
        same(twin, engine)
        twin.step({"event": "c"})
        twin.step({"event": "b"})
        assert engine.state == before
        for name in "bcd":
            fresh = Engine(rvaft.loads(text), semantics)
            fresh.step({"event": "a"})
            assert engine.fork().step({"event": name}) == fresh.step({"event": name})


RESUME = """
import pickle, sys
monitor = pickle.load(sys.stdin.buffer)
monitor.step({"f": 2})
print(monitor.verdict, monitor.explanation.matched, monitor.explanation.variables)
"""


def test_another_process_goes_on() -> None:
    """Where strings hash differently."""
    tree = rvaft.loads("event e(v) = { v: v }; event f(v) = { f: v }; top sand x y; x on e(V); y on f(V);")
    monitor = rvaft.monitor(tree, semantics="scattered")
    for value in (1, 2, 3):
        monitor.step({"v": value})
    done = subprocess.run([sys.executable, "-c", RESUME], input=pickle.dumps(monitor), capture_output=True, check=True)
    assert done.stdout.decode() == "true {'x': 2, 'y': 4} {'V': 2}\n"
