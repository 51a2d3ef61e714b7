"""What the general monitor of `scattered` remembers from event to event changes nothing of what it says."""

from itertools import islice
from random import Random

import pytest

import rvaft
from rvaft.engine import Engine, scattered_general
from rvaft.model.verdict import Verdict
from tests.engine.checking import small_valid_trees
from tests.engine.dense import SHAPES, dense_trace, dense_tree

TYPES = "event e(n, v) = { n: n, v: v }; "


@pytest.mark.parametrize("memory", [scattered_general.MEMORY, 3])
@pytest.mark.parametrize("shape", SHAPES)
def test_memory_changes_nothing(shape: str, memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy starts with none, and another loses it all the time."""
    random = Random(f"memory {shape}")
    for tree in islice(small_valid_trees(lambda: dense_tree(random, SHAPES[shape])), 8):
        straight = Engine(tree, "scattered")
        monkeypatch.setattr(scattered_general, "MEMORY", memory)
        other = Engine(tree, "scattered")
        for event in dense_trace(random, SHAPES[shape], 25):
            monkeypatch.undo()
            verdict = straight.step(event)
            monkeypatch.setattr(scattered_general, "MEMORY", memory)
            other = other.fork() if memory > 3 else other
            assert other.step(event) == verdict
            assert other.state == straight.state
            assert other.pending() == straight.pending()
        assert other.explanation == straight.explanation
        monkeypatch.undo()


def test_what_once_changed_nothing_may_matter_later() -> None:
    monitor = Engine(
        rvaft.loads(TYPES + 'top sand a b c; a on e("a", X); b on e("b", X); c on e("c", X);'), "scattered"
    )
    for letter, value in [("a", 1), ("b", 2), ("a", 3), ("b", 2), ("a", 2), ("c", 2)]:
        assert monitor.step({"n": letter, "v": value}) is Verdict.UNKNOWN
    assert monitor.step({"n": "b", "v": 2}) is Verdict.UNKNOWN
    assert monitor.step({"n": "c", "v": 1}) is Verdict.UNKNOWN
    assert monitor.step({"n": "c", "v": 2}) is Verdict.TRUE


def test_equal_values_of_two_types_meet_but_are_told_apart_by_guards() -> None:
    """The values of a match are those that came first; 2.0**53 + 11 is not 2**53 + 11."""
    types = TYPES + "event f(n, v, w) = { n: n, v: v, w: w }; "
    tree = rvaft.loads(types + 'top sand a b g; a on e("a", X); b on f("b", X, Y); g when X + Y == 9007199254741003;')
    for first, second in ((2**53, 2.0**53), (2.0**53, 2**53)):
        monitor = Engine(tree, "scattered")
        monitor.step({"n": "a", "v": first})
        found = monitor.step({"n": "b", "v": second, "w": 11})
        assert found is (Verdict.TRUE if type(first) is int else Verdict.UNKNOWN)


def test_a_value_that_will_not_do_does_not_stand_for_one_that_will() -> None:
    monitor = Engine(rvaft.loads(TYPES + 'top sand a g b; a on e("a", X); g when X > 5; b;'), "scattered")
    for value in (3, 6):
        assert monitor.step({"n": "a", "v": value}) is Verdict.UNKNOWN
    assert monitor.step({"event": "b"}) is Verdict.TRUE


def test_an_event_of_no_use_may_be_of_use_to_a_later_match() -> None:
    """In the first branch 3 is too little; the second asks for no more, once `c` has come."""
    text = 'top or x y; x sand a g b; y sand c a2 d; a on e("a", X); a2 on e("a", X); g when X > 5; b; c; d;'
    monitor = Engine(rvaft.loads(TYPES + text), "scattered")
    low = {"n": "a", "v": 3}
    for event in (low, {"event": "c"}, low):
        assert monitor.step(event) is Verdict.UNKNOWN
    assert monitor.step({"event": "d"}) is Verdict.TRUE


def test_copies_do_not_detect_for_one_another() -> None:
    monitor = Engine(rvaft.loads(TYPES + 'top sand a b; a on e("a", X); b on e("b", X);'), "scattered")
    monitor.step({"n": "a", "v": 1})
    assert monitor.fork().step({"n": "b", "v": 1}) is Verdict.TRUE
    assert monitor.step({"n": "a", "v": 2}) is Verdict.UNKNOWN
    assert monitor.explanation is None
