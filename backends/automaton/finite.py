"""When an automaton accepts a finite word: two readings of a text, both made with Spot.

With a proposition `alive` (the encoding of Spot's `from_ltlf`) a word is accepted when it goes on for ever without `alive` and
without any other proposition. Without `alive` the automaton is one over finite words: it accepts where its run may end in an
accepting state or, if acceptance is on the edges, with an accepting edge, its marks being seen for ever.
"""

import re
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

Moves: TypeAlias = list[list[tuple[Any, int]]]
"""For each state the edges that leave it: label and target."""

_STATE: Final = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/|State:\s*(?:\[[^\]]*\]\s*)?(?P<state>\d+)\s*(?:"(?:\\.|[^"\\])*"\s*)?(?:\{(?P<marks>[^}]*)\})?',
    re.DOTALL,
)


def moves(automaton: Any) -> Moves:
    """The edges by state."""
    return [[(edge.cond, edge.dst) for edge in automaton.out(state)] for state in range(automaton.num_states())]


def after_the_end(spot: Any, buddy: Any, automaton: Any, variables: Sequence[int]) -> list[bool]:
    """For each state whether the word that goes on with no proposition at all is accepted from there."""
    silence = buddy.bddtrue
    for variable in variables:
        silence &= buddy.bdd_nithvar(variable)
    after = spot.make_twa_graph(automaton.get_dict())
    after.copy_acceptance_of(automaton)
    states = automaton.num_states()
    after.new_states(states + 1)
    after.set_init_state(states)
    for state in range(states):
        after.new_edge(states, state, buddy.bddtrue)
        for edge in automaton.out(state):
            if edge.cond & silence != buddy.bddfalse:
                after.new_edge(state, edge.dst, buddy.bddtrue, edge.acc)
    components = spot.scc_info_with_options(after, spot.scc_info_options_ALL)
    components.determine_unknown_acceptance()
    return [bool(components.is_useful_scc(components.scc_of(state))) for state in range(states)]


def _state_marks(text: str) -> dict[int, list[int]] | None:
    """The marks that a text puts on states, or None where it puts them on edges."""
    body = text.partition("--BODY--")[2]
    found = [token for token in _STATE.finditer(body) if token["state"] is not None]
    if not any(token["marks"] is not None for token in found):
        return None
    return {int(token["state"]): [int(mark) for mark in (token["marks"] or "").split()] for token in found}


def marked_moves(automaton: Any, text: str) -> Moves:
    """The edges of an automaton over finite words; where edges have marks, a state is split by the marks of the last edge."""
    if _state_marks(text) is not None:
        return moves(automaton)
    number = _splits(automaton)
    split: Moves = [[] for _ in range(automaton.num_states() + len(number))]
    for state in range(automaton.num_states()):
        leaving = [(edge.cond, number[edge.dst, str(edge.acc)]) for edge in automaton.out(state)]
        split[state] = leaving
        for (to, _), index in number.items():
            if to == state:
                split[index] = leaving
    return split


def _splits(automaton: Any) -> dict[tuple[int, str], int]:
    splits: dict[tuple[int, str], int] = {}
    for edge in automaton.edges():
        splits.setdefault((edge.dst, str(edge.acc)), automaton.num_states() + len(splits))
    return splits


def ends(spot: Any, automaton: Any, text: str) -> list[bool]:
    """For each state of `_marked_moves` whether a word may end there."""
    acceptance = automaton.acc()
    marks = _state_marks(text)
    if marks is not None:
        return [_satisfied(spot, acceptance, marks.get(state, [])) for state in range(automaton.num_states())]
    by_text = {str(edge.acc): edge.acc for edge in automaton.edges()}
    ends = [bool(acceptance.accepting(by_text[mark])) for _, mark in _splits(automaton)]
    return [False] * automaton.num_states() + ends


def _satisfied(spot: Any, acceptance: Any, marks: Sequence[int]) -> bool:
    return bool(acceptance.accepting(spot.mark_t(list(marks))))
