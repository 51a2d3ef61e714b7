"""A monitor pickled in the middle of a trace goes on as if nothing had happened (see also `test_random`)."""

import copy
import pickle
import subprocess
import sys
from typing import Any

import pytest

import rvaft
from rvaft.engine import Engine
from rvaft.errors import TraceError
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.test_random import same


def again(monitor: Engine) -> Engine:
    """The monitor after a night on disk."""
    twin = pickle.loads(pickle.dumps(monitor))
    assert isinstance(twin, Engine)
    return twin


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


@pytest.mark.parametrize("semantics", list(Semantics))
def test_skipped_events_are_counted(semantics: Semantics) -> None:
    monitor = Engine(rvaft.loads("top sand a b;"), semantics)
    monitor.step({"event": "a"})
    assert monitor.skip(0) is Verdict.UNKNOWN
    expected = Verdict.FALSE if semantics is Semantics.STRICT else Verdict.UNKNOWN
    assert monitor.skip(1_000_000) is expected
    if expected is Verdict.FALSE:  # the first one ends the match
        assert monitor.ended is not None
        assert (monitor.ended.event, [one.node for one in monitor.ended.pending[0].awaited]) == (2, ["b"])
        assert monitor.skip(3) is Verdict.FALSE
    else:
        assert monitor.step({"event": "b"}) is Verdict.TRUE
        assert monitor.explanation is not None
        assert monitor.explanation.matched == {"a": 1, "b": 1_000_002}
    with pytest.raises(TraceError):
        monitor.step([])
