"""Any HOA text: written by hand, by Spot, with other acceptance; texts that are none; and what texts ask of events."""

import re
from collections.abc import Sequence
from typing import Any

import pytest

from backends.automaton import AutomatonBackend
from rvaft import loads
from rvaft.backend import Observed
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import renamed
from rvaft.model.verdict import Semantics
from tests.backends.texts import signs
from tests.tables import rows


@pytest.fixture(autouse=True)
def spot() -> Any:
    return pytest.importorskip("spot")


def verdicts(text: str, word: str | Sequence[Any], **options: Any) -> str:
    monitor = AutomatonBackend().read(text, **options)
    assert monitor.verdict.value == "unknown"
    return signs(monitor, word)


HAND = """HOA: v1
/* a then b, by hand; nothing says what the propositions are */
States: 4
Start: 0
AP: 3 "a" "alive" "b"
acc-name: Buchi
Acceptance: 1 Inf(0)
--BODY--
State: 0
[1&!0] 0
[1&0] 1
State: 1
[1&!2] 1
[1&2] 2
State: 2
[1] 2
[!1] 3
State: 3 {0}
[!1] 3
--END--
"""


def hoa(names: str, body: str, *, start: str = "0", header: str = "") -> str:
    """A text whose states, one after the other, have these edges."""
    names = f"{len(names.split())} " + " ".join(f'"{name}"' for name in names.split())
    states = " ".join(f"State: {number} {edges}\n" for number, edges in enumerate(body.split(";")))
    numbers = f"HOA: v1\nStates: {body.count(';') + 1}\nStart: {start}\nAP: {names}\n"
    return f"{numbers}{header}Acceptance: 1 Inf(0)\nacc-name: Buchi\n--BODY--\n{states}--END--\n"


FINITE = hoa("a b", '[0] 1; [1] 2 [!1] 1; "done" {0} [t] 2')
ON_EDGES = FINITE.replace("[1] 2", "[1] 2 {0}").replace('"done" {0}', "").replace("[t] 2", "[t] 2 {0}")
ALTERNATING = hoa(
    "alive a b",
    "[0&1] 2 [0&!1] 0; [0&2] 2 [0&!2] 1; [0] 2 [!0] 3; {0} [!0] 3",
    start="0&1",
    header="properties: univ-branch\n",
)

pytestmark = pytest.mark.spot


@pytest.mark.parametrize(
    ("text", "word", "expected"),
    [
        (HAND, "b a c b a", "???TT"),
        (hoa("alive a", "[0] 0 [0&1] 1; [!0] 2; {0} [!0] 2"), "b a b", "???"),  # nondeterministic
        (ALTERNATING, "a c b", "??T"),
        (ALTERNATING, "c c a a", "????"),
        (FINITE, "a c b", "??T"),  # without alive it is an automaton over finite words
        (FINITE, "b", "F"),
        (FINITE.replace("[t] 2", ""), "a b", "??"),  # an accepting state may have no edge
        (FINITE.replace("[t] 2", ""), "a b c", "??F"),
        (ON_EDGES, "a c b", "??T"),
    ],
)
def test_by_hand(text: str, word: str, expected: str) -> None:
    assert verdicts(text, word) == expected


@pytest.mark.parametrize(("last", "expected"), [([{"go": 2}, {"stop": 1}], "???T"), ([{"go": 3}], "???")])
def test_given_atoms(last: list[Any], expected: str) -> None:
    atoms = {"a": parse_pattern("{ go: X }"), "b": parse_pattern("{ stop: X }")}
    assert verdicts(HAND, [{"go": 1}, {"stop": 2}, *last], atoms=atoms) == expected


@pytest.mark.parametrize("kind", [["det"], ["small"], ["generic", "det"], ["coBuchi"], ["parity"]])
@pytest.mark.parametrize(
    ("formula", "word", "expected"),
    [
        ("F(a & X[!]F b)", "b a c b", "???T"),
        ("a & X[!]b", "a b", "?T"),
        ("a & X[!]b", "a a", "?F"),
        ("G a", "a a b a", "??FF"),
        ("F G a", "a b a", "???"),
        ("(F a & F b) | (c & X[!]c)", "c c", "?T"),
        ("(G F a) | b", "b", "T"),
    ],
)
def test_spots_own_encoding(spot: Any, kind: list[str], formula: str, word: str, expected: str) -> None:
    automaton = spot.translate(spot.from_ltlf(spot.formula(formula)), *kind)
    assert verdicts(automaton.to_str("hoa"), word) == expected


def said(line: str) -> str:
    return HAND.replace("acc-name", f"{line}\nacc-name")


@pytest.mark.parametrize(("old", "new", "message", "place"), rows(__file__, "malformed.txt"))
def test_malformed(old: str, new: str, message: str, place: list[object] | None) -> None:
    text = new if old == "all" else said(new) if old == "header" else HAND.replace(old, new)
    for use in (AutomatonBackend().read, AutomatonBackend().observed):
        with pytest.raises(LanguageError, match=re.escape(message)) as error:
            use(text.replace("HAND", HAND))
        assert "\n" not in error.value.message
        assert error.value.line >= 1
        assert place in (None, [error.value.line, error.value.column, error.value.source])


def test_a_guard_that_its_pattern_does_not_bind_never_holds() -> None:
    text = AutomatonBackend().translate(loads("toplevel r; r sand a b; a; b;"), Semantics.PROJECTED).text
    odd = text.replace('alphabet: "', 'alphabet: "{ v: V }" "W < 250"\nalphabet: "', 1)
    assert odd != text
    # `v` is not relevant then, and may come at any time
    assert verdicts(odd, [{"v": 1}, {"event": "a"}, {"v": 300}, {"event": "b"}]) == "???T"


OWN = renamed(parse_guard("X > 1"), {"X": "_X"})
ASKED = [  # the propositions, the lines of the header, what is asked: patterns, those with a guard
    ("alive a b c", ('event: 3 "{ x: _1, y: _1 }"',), ('{ event: "a" }', "{ v: 1 }", "{ x: _1, y: _1 }"), ()),
    (
        "alive r",
        ("relevant: 1", 'alphabet: "{ v: X }" "X > 1"', 'ignore: "{ w: X }"'),
        ("{ w: _X }",),
        ("{ v: _X }", OWN),
    ),
    ("alive", ('alphabet: "{ v: X }" "X > 1"', 'ignore: "{ w: X }"'), (), ()),  # no proposition looks at it
    ("alive a g", ('event: 1 "{ v: X }"', 'guard: 2 "X > 1"'), ("{ v: X }",), ("{ v: X }", parse_guard("X > 1"))),
]


@pytest.mark.parametrize(("names", "lines", "patterns", "guarded"), ASKED)
def test_what_a_text_asks_of_events(names: str, lines: Sequence[str], patterns: Sequence[str], guarded: Any) -> None:
    text = hoa(names, "{0} [t] 0", header="".join(f"{line}\n" for line in lines))
    atoms = {name: parse_pattern("{ v: 1 }") for name in "bc"}
    expected = {Observed(parse_pattern(one)) for one in patterns}
    expected |= {Observed(parse_pattern(guarded[0]), guarded[1])} if guarded else set()
    assert set(AutomatonBackend().observed(text, atoms=atoms) or ()) == expected
