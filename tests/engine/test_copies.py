"""Monitors that are copied, pickled or told of skipped events in the middle of a trace go on as if
nothing had happened.
"""

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

TYPES = "event e(v) = { v: v }; event f(v) = { f: v }; "


@pytest.mark.ci
@pytest.mark.parametrize(
    "semantics", ["strict", "projected", "scattered"]
)  # under `consecutive` there are as many as events
def test_long_matches_and_small_pickles(semantics: str) -> None:
    """A match of thousands of events is deeper than Python can recurse; what is compiled from the
    tree is not written.
    """
    leaves = tuple(f"n{number}" for number in range(2000))
    tree = RVAFT("top", [Node("top", Gate.AND, leaves), *map(Node, leaves)])
    engine = Engine(tree, semantics)
    for name in leaves[:-1]:
        engine.step({"event": name})
    written = pickle.dumps(engine)
    twin = pickle.loads(written)
    assert twin.step({"event": leaves[-1]}) is engine.step({"event": leaves[-1]}) is Verdict.TRUE
    assert twin.explanation == engine.explanation
    assert len(written) < len(pickle.dumps(tree)) + 100 * len(leaves)


def test_partial_matches_share_what_they_have_in_common() -> None:
    """A thousand values after thirty common events are not a thousand times thirty events."""
    names = [f"n{number}" for number in range(30)]
    engine = Engine(rvaft.loads(f"{TYPES} top sand {' '.join(names)} x y; x on e(V); y on f(V);"), "scattered")
    for name in names:
        engine.step({"event": name})
    sizes = []
    for value in range(1000):
        engine.step({"v": value})
        if value in (499, 999):
            sizes.append(len(pickle.dumps(engine)))
    assert sizes[1] - sizes[0] < 500 * 300
    twin = pickle.loads(pickle.dumps(engine))
    assert [twin.step({"f": value}) for value in (1000, 999)] == [Verdict.UNKNOWN, Verdict.TRUE]
    assert twin.explanation.events["x"] == [30 + 1000]


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, Engine.fork])
def test_copies_are_independent(copied: Any, semantics: Semantics) -> None:
    for text in ("top sand x y; x or a b; y and c d;", "top sand a b;"):
        engine, fresh = (Engine(rvaft.loads(text), semantics) for _ in range(2))
        for monitor in (engine, fresh):
            monitor.step({"event": "a"})
        twin = copied(engine)
        assert twin.pending() == engine.pending()
        list(twin.run([{"event": "c"}, {"event": "b"}]))
        assert (engine.state, engine.pending()) == (fresh.state, fresh.pending())


RESUME = """
import pickle, sys
monitor = pickle.load(sys.stdin.buffer)
monitor.step({"f": 2})
print(monitor.verdict, monitor.explanation.events, monitor.explanation.variables)
"""


def test_another_process_goes_on() -> None:
    """Where strings hash differently."""
    monitor = rvaft.monitor(rvaft.loads(f"{TYPES} top sand x y; x on e(V); y on f(V);"), semantics="scattered")
    for value in (1, 2, 3):
        monitor.step({"v": value})
    done = subprocess.run([sys.executable, "-c", RESUME], input=pickle.dumps(monitor), capture_output=True, check=True)
    assert done.stdout.decode() == "true {'x': [2], 'y': [4]} {'V': 2}\n"


@pytest.mark.parametrize("semantics", list(Semantics))
def test_skipped_events_are_counted(semantics: Semantics) -> None:
    monitor = Engine(rvaft.loads("top sand a b;"), semantics)
    monitor.step({"event": "a"})
    assert monitor.skip(0) is Verdict.UNKNOWN
    if semantics is Semantics.STRICT:  # the first one ends the match
        assert monitor.skip(1_000_000) is Verdict.FALSE
        assert monitor.ended is not None
        assert (monitor.ended.event, [one.node for one in monitor.ended.pending[0].awaited]) == (2, ["b"])
        assert monitor.skip(3) is Verdict.FALSE
    else:
        assert monitor.skip(1_000_000) is Verdict.UNKNOWN
        assert monitor.step({"event": "b"}) is Verdict.TRUE
        assert monitor.explanation is not None
        assert monitor.explanation.events == {"a": [1], "b": [1_000_002]}
    with pytest.raises(TraceError):
        monitor.step([])
