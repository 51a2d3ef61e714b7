"""The text itself, pinned: what every HOA tool reads."""

import pytest

from backends.automaton import AutomatonBackend
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
PROJECTED_AB = (
    'AP: 4 "alive" "relevant" "a" "b"\nevent: 2 "{ event: \\"a\\" }"\nevent: 3 "{ event: \\"b\\" }"\nrelevant: 1\n'
    'alphabet: "{ event: \\"a\\" }"\nalphabet: "{ event: \\"b\\" }"'
)
DETECTED = "State: {0}\n[0] {0}\n[!0] {1}\nState: {1} {{0}}\n[!0] {1}\n--END--\n"

PINNED = [
    (
        "r or a b;",
        "scattered",
        3,
        AB,
        "--BODY--\nState: 0\n[0&!1&!2] 0\n[0&1 | 0&2] 1\n" + DETECTED.format(1, 2),
    ),
    (
        "r and a b;",
        "scattered",
        5,
        AB,
        "Alias: @1 0&1&!2\nAlias: @2 0&2&!1\n--BODY--\nState: 0\n[0&!1&!2] 0\n[@1] 1\n[@2] 2\n"
        "State: 1\n[0&!2] 1\n[@2] 3\nState: 2\n[0&!1] 2\n[@1] 3\n" + DETECTED.format(3, 4),
    ),
    (
        "r sand a b;",
        "scattered",
        4,
        AB,
        "--BODY--\nState: 0\n[0&!1] 0\n[0&1] 1\nState: 1\n[0&!2] 1\n[0&2] 2\n" + DETECTED.format(2, 3),
    ),
    (
        "r sand_rl a b;",
        "scattered",
        4,
        AB,
        "--BODY--\nState: 0\n[0&!2] 0\n[0&2] 1\nState: 1\n[0&!1] 1\n[0&1] 2\n" + DETECTED.format(2, 3),
    ),
    (
        "r 1of2 a b;",
        "strict",
        4,
        AB,
        "--BODY--\nState: 0\n[0&!1&!2] 1\n[0&1 | 0&2] 2\nState: 1\n[0] 1\n" + DETECTED.format(2, 3),
    ),
    (
        "r sand a b;",
        "strict",
        5,
        AB,
        "--BODY--\nState: 0\n[0&!1] 1\n[0&1] 2\nState: 1\n[0] 1\nState: 2\n[0&!2] 1\n[0&2] 3\n" + DETECTED.format(3, 4),
    ),
    (
        "r sand a b;",
        "projected",
        5,
        PROJECTED_AB,
        "--BODY--\nState: 0\n[0&1&!2] 1\n[0&1&2] 2\n[0&!1] 0\nState: 1\n[0] 1\n"
        "State: 2\n[0&1&!3] 1\n[0&1&3] 3\n[0&!1] 2\n" + DETECTED.format(3, 4),
    ),
]


@pytest.mark.parametrize(
    ("tree", "semantics", "states", "propositions", "rest"), PINNED, ids=lambda value: str(value)[:20]
)
def test_pinned(tree: str, semantics: str, states: int, propositions: str, rest: str) -> None:
    specification = AutomatonBackend().translate(loads(f"toplevel r; {tree}"), Semantics(semantics))
    header = HEADER.format(name=f"r, {semantics}", states=states, propositions=propositions)
    assert specification.text == header + rest
    assert specification.metrics.states == states
    assert specification.metrics.edges == sum(line.startswith("[") for line in specification.text.splitlines())


def test_the_header_carries_patterns_guards_and_relevance_but_no_gate() -> None:
    tree = loads(
        "event p(x) = { x: x }; event q(x) = { 'y z': x }; ignore p(V) when V < 0;"
        " toplevel r; r sand a b; a on p(X) when X > 1; b on q(X) when X != 5;".replace("'", '"')
    )
    text = AutomatonBackend().translate(tree, Semantics.PROJECTED).text
    assert 'event: 2 "{ x: X }"' in text
    assert 'event: 3 "{ \\"y z\\": X }"' in text
    assert 'guard: 4 "X > 1"' in text
    assert 'guard: 5 "X != 5"' in text
    assert 'alphabet: "{ x: X }" "X > 1"' in text
    assert 'ignore: "{ x: V }" "V < 0"' in text
    assert "sand" not in text


@pytest.mark.parametrize("semantics", list(Semantics))
def test_and_over_twelve_exclusive_letters_is_the_subset_lattice(semantics: Semantics) -> None:
    tree = loads(f"toplevel r; r and {' '.join(f'a{i}' for i in range(12))};")
    metrics = AutomatonBackend().translate(tree, semantics).metrics
    hopeless = semantics is not Semantics.SCATTERED
    assert metrics.states == 4096 + hopeless + 1
    assert metrics.edges is not None
    assert metrics.edges >= 28_674
