"""What a drawing leaves out never happens: without it the automaton gives the same verdicts."""

from random import Random

import pytest

from backends.automaton import AutomatonBackend
from backends.automaton.backend import _built, _relevance
from backends.automaton.diagram import possible
from backends.automaton.hoa_writer import write
from backends.automaton.structure import Work
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft import RVAFT, Semantics, load, loads
from tests.cli.runs import PRUNED

SHAPE = Shape(max_nodes=7, sharing=0.3, variables=1, guards=0.6, typed_events=0.9)


def both(tree: RVAFT, semantics: Semantics) -> tuple[str, str]:
    """The text of the whole automaton, and that of what is possible in it."""
    work = Work(10_000)
    automaton, parts, letters = _built(tree, semantics, work)
    whole, rest = (
        write(one, parts, letters, name="", relevance=_relevance(tree, semantics), work=work)[0]
        for one in (automaton, possible(automaton, parts))
    )
    return whole, rest


@pytest.mark.spot
@pytest.mark.parametrize("semantics", list(Semantics))
def test_what_is_left_out_makes_no_difference(semantics: Semantics) -> None:
    pytest.importorskip("spot")
    random = Random("possible")
    different = 0
    for _ in range(30):
        tree = random_tree(random, SHAPE)
        whole, rest = both(tree, semantics)
        different += whole != rest
        if whole != rest:
            for trace in (random_trace(random, tree) for _ in range(5)):
                one, other = (AutomatonBackend().read(text) for text in (whole, rest))
                assert list(one.run(trace)) == list(other.run(trace))
    assert different >= 5


def test_states_behind_guards_that_cannot_fail_yet_are_left_out() -> None:
    """`T2` has its value from the event that comes after."""
    automaton, parts, _ = _built(load(PRUNED), Semantics.PROJECTED, Work(1000))
    assert len(automaton.in_order()) == 8
    assert len(possible(automaton, parts).in_order()) == 7


def test_without_guards_nothing_is_left_out() -> None:
    automaton, parts, _ = _built(loads("top 2of3 a b c;"), Semantics.STRICT, Work(1000))
    assert possible(automaton, parts) == automaton
