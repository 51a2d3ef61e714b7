"""The text itself, pinned: what every HOA tool reads."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backends.automaton import AutomatonBackend
from backends.automaton.hoa_writer import ALIVE, RELEVANT, atom_name
from rvaft.api import loads
from rvaft.model.verdict import Semantics

HEADER = """HOA: v1
name: "{name}"
tool: "rvaft"
States: {states}
Start: 0
{propositions}
acc-name: Buchi
Acceptance: 1 Inf(0)
properties: trans-labels explicit-labels state-acc deterministic
"""
AB = 'AP: 3 "alive" "a" "b"\nevent: 1 "{ event: \\"a\\" }"\nevent: 2 "{ event: \\"b\\" }"'
RELEVANT_AB = (
    'AP: 4 "alive" "relevant" "a" "b"\nevent: 2 "{ event: \\"a\\" }"\nevent: 3 "{ event: \\"b\\" }"\nrelevant: 1\n'
    'alphabet: "{ event: \\"a\\" }"\nalphabet: "{ event: \\"b\\" }"'
)

PINNED = [  # the aliases, and for each state up to ⊤ its edges
    ("r or a b;", "scattered", "", "[0&!1&!2] 0, [0&1 | 0&2] 1; "),
    (
        "r and a b;",
        "scattered",
        "Alias: @1 0&1&!2\nAlias: @2 0&2&!1\n",
        "[0&!1&!2] 0, [@1] 1, [@2] 2; [0&!2] 1, [@2] 3; [0&!1] 2, [@1] 3; ",
    ),
    ("r sand a b;", "scattered", "", "[0&!1] 0, [0&1] 1; [0&!2] 1, [0&2] 2; "),
    ("r sand_rl a b;", "scattered", "", "[0&!2] 0, [0&2] 1; [0&!1] 1, [0&1] 2; "),
    ("r 1of2 a b;", "strict", "", "[0&!1&!2] 1, [0&1 | 0&2] 2; [0] 1; "),
    ("r sand a b;", "strict", "", "[0&!1] 1, [0&1] 2; [0] 1; [0&!2] 1, [0&2] 3; "),
    ("r sand a b;", "projected", "", "[0&1&!2] 1, [0&1&2] 2, [0&!1] 0; [0] 1; [0&1&!3] 1, [0&1&3] 3, [0&!1] 2; "),
]


@pytest.mark.parametrize(("tree", "semantics", "aliases", "states"), PINNED)
def test_pinned(tree: str, semantics: str, aliases: str, states: str) -> None:
    specification = AutomatonBackend().translate(loads(f"toplevel r; {tree}"), Semantics(semantics))
    top = states.count(";")
    states += f"[0] {top}, [!0] {top + 1}; {{0}}[!0] {top + 1}"
    body = ""
    for number, edges in enumerate(states.split("; ")):
        marks = " {0}\n" if edges.startswith("{0}") else "\n"
        body += f"State: {number}{marks}" + "".join(f"{edge}\n" for edge in edges.removeprefix("{0}").split(", "))
    propositions = RELEVANT_AB if semantics == "projected" else AB
    header = HEADER.format(name=f"r, {semantics}", states=top + 2, propositions=propositions)
    assert specification.text == f"{header}{aliases}--BODY--\n{body}--END--\n"
    assert specification.metrics.states == top + 2
    assert specification.metrics.edges == body.count("[")


def test_the_header_carries_patterns_guards_and_relevance_but_no_gate() -> None:
    tree = loads(
        'event p(x) = { x: x }; event q(x) = { "y z": x }; ignore p(V) when V < 0;'
        " toplevel r; r sand a b; a on p(X) when X > 1; b on q(X) when X != 5;"
    )
    text = AutomatonBackend().translate(tree, Semantics.PROJECTED).text
    assert text.splitlines()[6:15] == [
        'event: 2 "{ x: X }"',
        'event: 3 "{ \\"y z\\": X }"',
        'guard: 4 "X > 1"',
        'guard: 5 "X != 5"',
        "relevant: 1",
        'alphabet: "{ x: X }" "X > 1"',
        'alphabet: "{ \\"y z\\": X }" "X != 5"',
        'ignore: "{ x: V }" "V < 0"',
        "acc-name: Buchi",
    ]
    assert "sand" not in text


@pytest.mark.parametrize("semantics", list(Semantics))
def test_and_over_twelve_exclusive_letters_is_the_subset_lattice(semantics: Semantics) -> None:
    tree = loads(f"toplevel r; r and {' '.join(f'a{i}' for i in range(12))};")
    metrics = AutomatonBackend().translate(tree, semantics).metrics
    assert metrics.states == 4096 + (semantics is not Semantics.SCATTERED) + 1
    assert (metrics.edges or 0) >= 28_674


NAMES = st.one_of(
    st.text(),
    st.text(alphabet="_x5f1a", max_size=8),
    st.sampled_from(["alive", "relevant", "guard_1", "X", "true", "ev1", "_x61_live", "", "1", "a b", 'q"', "é"]),
)


@given(NAMES, NAMES)
def test_different_nodes_have_different_names_that_every_tool_reads(one: str, other: str) -> None:
    assert (atom_name(one) == atom_name(other)) == (one == other)
    assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", atom_name(one))
    assert atom_name(one) not in {ALIVE, RELEVANT, "guard_1", "X", "F", "G", "U", "true", "false"}


def test_a_plain_name_is_kept() -> None:
    assert [atom_name(name) for name in ("ev10", "take_reading")] == ["ev10", "take_reading"]
