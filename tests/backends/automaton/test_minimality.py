"""No two states of an emitted automaton can be merged, by two ways of minimising that are not the backend's."""

from itertools import combinations
from typing import Any

import pytest

from backends.automaton import AutomatonBackend
from cross_check.generate.trees import Shape, random_tree
from rvaft.api import loads
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

pytestmark = pytest.mark.spot
spot: Any = pytest.importorskip("spot")

TREES = [
    "r or a b c;",
    "r and a b c d;",
    "r sand a b c;",
    "r 2of4 a b c d;",
    "r and p q; p sand a b; q sand c d;",
    "r or p q; p sand a b; q sand a c;",
    "r or p q; p sand a c; q sand b c;",
    "r and p q; p or a s; q or b s;",
    "r and p q; p sand a s; q sand s b;",
    "r sand v d; v 2of3 a b c;",
    "r 2of3 s b c; s sand a d;",
    "r or p q t; p and a b; q sand a b; t sand b a;",
    "r or a p; p sand a b;",
]


def exclusive(tree: RVAFT, semantics: Semantics) -> Any:
    """The emitted automaton over words of letters that exclude each other, completed where they do."""
    automaton = spot.automaton(AutomatonBackend().translate(tree, semantics).text)
    names = [ap.ap_name() for ap in automaton.ap() if ap.ap_name() not in {"alive", "relevant"}]
    condition = " & ".join(f"!({one} & {other})" for one, other in combinations(names, 2)) or "1"
    if semantics is Semantics.PROJECTED:
        condition += " & " + " & ".join(f"({name} -> relevant)" for name in names)
        condition += f" & (relevant -> ({' | '.join(names)}))"
    return automaton, spot.formula_to_bdd(condition, automaton.get_dict(), automaton)


def distinct(automaton: Any, feasible: Any) -> bool:
    """Moore's algorithm over the feasible letters: whether every state is a class of its own."""
    import buddy

    states = range(automaton.num_states())
    letters = [feasible]
    for edge in automaton.edges():
        letters = [part for one in letters for part in (one & edge.cond, one - edge.cond) if part != buddy.bddfalse]
    moves = [
        [
            next((edge.dst for edge in automaton.out(state) if edge.cond & letter != buddy.bddfalse), -1)
            for letter in letters
        ]
        for state in states
    ]
    classes = {state: int(automaton.state_is_accepting(state)) for state in states} | {-1: 2}
    while True:
        keys = {state: (classes[state], *(classes[to] for to in moves[state])) for state in states}
        numbers = {one: number for number, one in enumerate(dict.fromkeys(keys.values()))}
        refined = {state: numbers[keys[state]] for state in states} | {-1: -1}
        if len(set(refined.values())) == len(set(classes.values())):
            return len(set(refined.values())) == len(refined)
        classes = refined


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize("text", TREES)
def test_no_two_states_are_equivalent(text: str, semantics: Semantics) -> None:
    assert distinct(*exclusive(loads(f"toplevel r; {text}"), semantics))


@pytest.mark.parametrize("seed", range(60))
def test_no_two_states_of_random_trees_are_equivalent(seed: int) -> None:
    from random import Random

    shape = Shape(gate_events=0, typed_events=0, variables=0, guards=0, ignores=0, sharing=0.4, max_nodes=8)
    tree = random_tree(Random(seed), shape)
    for semantics in Semantics:
        assert distinct(*exclusive(tree, semantics))


@pytest.mark.parametrize("text", TREES)
def test_spot_finds_nothing_smaller(text: str) -> None:
    """Spot minimises the product with the exclusive words; the state without hope is Spot's sink, or it trims it."""
    automaton, feasible = exclusive(loads(f"toplevel r; {text}"), Semantics.STRICT)
    import buddy

    for edge in automaton.edges():
        if edge.cond & feasible != buddy.bddfalse:
            edge.cond &= feasible
    smaller = spot.scc_filter_states(spot.minimize_wdba(automaton))
    trimmed = spot.scc_filter_states(automaton)
    assert smaller.num_states() == trimmed.num_states()
