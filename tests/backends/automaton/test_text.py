"""The text itself, pinned: what every HOA tool reads; its names, and its letters."""

import re
from collections.abc import Sequence
from hashlib import sha256
from itertools import product
from random import Random
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from backends.automaton import AutomatonBackend
from backends.automaton.hoa_writer import ALIVE, RELEVANT, atom_name
from backends.automaton.letters import FeasibleLetters, Relevance
from rvaft.api import loads
from rvaft.language.parser import parse_pattern
from rvaft.model.patterns import ObjectPattern, Pattern, match
from rvaft.model.verdict import Semantics
from rvaft.support.bits import union

HEADER = """States: {states}
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
    rest = f"{HEADER.format(states=top + 2, propositions=propositions)}{aliases}--BODY--\n{body}--END--\n"
    tool = f'tool: "rvaft" "{sha256(rest.encode()).hexdigest()[:16]}"'
    assert specification.text == f'HOA: v1\nname: "r, {semantics}"\n{tool}\n{rest}'
    assert specification.metrics.states == top + 2
    assert specification.metrics.edges == body.count("[")


def test_the_header_carries_patterns_guards_and_relevance_but_no_gate() -> None:
    tree = loads(
        'event p(x) = { x: x }; event q(x) = { "y z": x }; ignore p(V) when V < 0;'
        " toplevel r; r sand a b; a on p(X) when X > 1; b on q(X) when X != 5;"
    )
    text = AutomatonBackend().translate(tree, Semantics.PROJECTED).text
    header = r"""event: 2 "{ x: X }"
event: 3 "{ \"y z\": X }"
guard: 4 "X > 1"
guard: 5 "X != 5"
relevant: 1
alphabet: "{ x: X }" "X > 1"
alphabet: "{ \"y z\": X }" "X != 5"
ignore: "{ x: V }" "V < 0"
acc-name: Buchi"""
    assert text.splitlines()[6:15] == header.splitlines()
    assert "sand" not in text


WORDS = ["alive", "relevant", "guard_1", "X", "true", "ev1", "_x61_live", "", "1", "a b", 'q"', "é"]


@given(*[st.text() | st.text(alphabet="_x5f1a", max_size=8) | st.sampled_from(WORDS)] * 2)
@example(" ", "_x20_")
def test_different_nodes_have_different_names_that_every_tool_reads(one: str, other: str) -> None:
    assert (atom_name(one) == atom_name(other)) == (one == other)
    assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", atom_name(one))
    assert atom_name(one) not in {ALIVE, RELEVANT, "guard_1", "X", "F", "G", "U", "true", "false"}
    assert atom_name("take_reading1") == "take_reading1"


# The feasible letters against all events over a grid of values.

LEAVES = [parse_pattern(text) for text in ("1", "2", '"a"', "_", "_1", "[1, _]", "[_1, _]", "{ k: 1 }", "{}")]
VALUES: list[Any] = [1, 2, "a", "other", None, [1, 1], [1, 2], [2, 1], ["other", 1], [], {}]
VALUES += [{"k": 1}, {"k": 2}, {"k": 1, "l": 3}]
GRID = [{"x": x, "y": y} for x, y in product(VALUES, repeat=2)] + [{}, *({name: v} for name in "xy" for v in VALUES)]
GRID += [event for v in VALUES for event in ({"x": v, "y": [v, "other"]}, {"x": [v, "other"], "y": v})]


def random_pattern(random: Random) -> ObjectPattern:
    fields = random.choice((("x",), ("y",), ("x", "y")))
    return ObjectPattern(tuple((name, random.choice(LEAVES)) for name in fields))


def holding(patterns: Sequence[Pattern], event: Any) -> int:
    return sum(1 << index for index, pattern in enumerate(patterns) if match(pattern, event, {}) is not None)


@pytest.mark.parametrize("seed", range(60))
def test_letters_are_those_of_concrete_events(seed: int) -> None:
    random = Random(seed)
    patterns = list(dict.fromkeys(random_pattern(random) for _ in range(random.randint(1, 4))))
    letters, found = FeasibleLetters(patterns), {holding(patterns, event) for event in GRID}
    for some in range(1 << len(patterns)):
        assert set(letters.over(some)) == {letter & some for letter in found}, (patterns, some)
    entries = patterns + [random_pattern(random) for _ in range(random.randint(0, 2))]
    ignored = [random_pattern(random) for _ in range(random.randint(0, 1))]
    found = {holding(patterns, one) for one in GRID if holding(entries, one) and not holding(ignored, one)}
    relevance = Relevance(tuple((one, None) for one in entries), tuple((one, None) for one in ignored))
    claimed = FeasibleLetters(patterns, relevance).over((1 << len(patterns)) - 1)
    # a pattern that only ignored events match keeps its letters
    assert found == {one for one in claimed if not one & ~union(found)}, (patterns, entries, ignored)


@pytest.mark.parametrize(
    ("patterns", "letters"),
    [
        (("{ x: X }", "{ x: Y }", "{ x: X, y: 1 }"), {0b000, 0b001, 0b010, 0b011, 0b101, 0b111}),  # false while unbound
        (("{ a: X, b: { k: Y } }", "{ a: { k: Y }, b: X }"), {0b00, 0b01, 0b10, 0b11}),
        (("{ a: X, b: X }", "{ a: [X] }"), {0b00, 0b01, 0b10}),  # a value that would contain itself is impossible
    ],
)
def test_rigid_variables_are_shared(patterns: Sequence[str], letters: set[int]) -> None:
    parsed = [parse_pattern(text) for text in patterns]
    assert set(FeasibleLetters(parsed).over((1 << len(parsed)) - 1)) == letters
