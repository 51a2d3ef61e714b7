"""Propositions have names that every tool reads, different ones for different nodes."""

import re

from hypothesis import given
from hypothesis import strategies as st

from backends.automaton.hoa_writer import ALIVE, RELEVANT, atom_name

NAMES = st.one_of(
    st.text(),
    st.text(alphabet="_x5f1a", max_size=8),
    st.sampled_from(["alive", "relevant", "guard_1", "X", "true", "ev1", "_x61_live", "", "1", "a b", 'q"', "é"]),
)


@given(NAMES, NAMES)
def test_different_nodes_have_different_names(one: str, other: str) -> None:
    assert (atom_name(one) == atom_name(other)) == (one == other)


@given(NAMES)
def test_names_are_words_with_no_other_meaning(name: str) -> None:
    assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", atom_name(name))
    assert atom_name(name) not in {ALIVE, RELEVANT, "X", "F", "G", "U", "true", "false"}
    assert atom_name(name) != "guard_1"


def test_a_plain_name_is_kept() -> None:
    assert atom_name("ev10") == "ev10"
    assert atom_name("take_reading") == "take_reading"
