"""Any HOA text: written by hand, by Spot, with other acceptance; and texts that are none."""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from backends.automaton import AutomatonBackend
from rvaft import loads
from rvaft.backend import Observed
from rvaft.errors import LanguageError, ToolMissing
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import renamed
from rvaft.model.verdict import Semantics

SIGNS = {"true": "T", "false": "F", "unknown": "?"}


def verdicts(text: str, word: str | Sequence[Any], **options: Any) -> str:
    events = [{"event": letter} for letter in word.split()] if isinstance(word, str) else word
    monitor = AutomatonBackend().read(text, **options)
    assert monitor.verdict.value == "unknown"
    return "".join(SIGNS[verdict.value] for verdict in monitor.run(events))


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

pytestmark = pytest.mark.spot


class TestWithSpot:
    """What needs Spot."""

    @pytest.fixture(autouse=True)
    def spot(self) -> Any:
        return pytest.importorskip("spot")

    def test_by_hand(self) -> None:
        assert verdicts(HAND, "b a c b a") == "???TT"

    def test_given_atoms(self) -> None:
        pattern, other = parse_pattern("{ go: X }"), parse_pattern("{ stop: X }")
        events = [{"go": 1}, {"stop": 2}, {"go": 2}, {"stop": 1}]
        assert verdicts(HAND, events, atoms={"a": pattern, "b": other}) == "???T"
        assert verdicts(HAND, [*events[:2], {"go": 3}], atoms={"a": pattern, "b": other}) == "???"

    @pytest.mark.parametrize("kind", ["det", "any", "gen", "coBuchi", "parity"])
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
    def test_spots_own_encoding(self, spot: Any, kind: str, formula: str, word: str, expected: str) -> None:
        options = {"det": ["det"], "any": ["small"], "gen": ["generic", "det"]}.get(kind, [kind])
        automaton = spot.translate(spot.from_ltlf(spot.formula(formula)), *options)
        assert verdicts(automaton.to_str("hoa"), word) == expected

    def test_nondeterministic(self) -> None:
        assert verdicts(hoa("alive a", "[0] 0 [0&1] 1; [!0] 2; {0} [!0] 2"), "b a b") == "???"

    def test_alternating(self) -> None:
        body = "[0&1] 2 [0&!1] 0; [0&2] 2 [0&!2] 1; [0] 2 [!0] 3; {0} [!0] 3"
        text = hoa("alive a b", body, start="0&1", header="properties: univ-branch\n")
        assert verdicts(text, "a c b") == "??T"
        assert verdicts(text, "c c a a") == "????"

    def test_without_alive_it_is_an_automaton_over_finite_words(self) -> None:
        assert verdicts(FINITE, "a c b") == "??T"
        assert verdicts(FINITE, "b") == "F"

    def test_an_accepting_state_may_have_no_edge(self) -> None:
        text = FINITE.replace("[t] 2", "")
        assert verdicts(text, "a b") == "??"
        assert verdicts(text, "a b c") == "??F"

    def test_acceptance_on_edges_without_alive(self) -> None:
        text = FINITE.replace("[1] 2", "[1] 2 {0}").replace('"done" {0}', "").replace("[t] 2", "[t] 2 {0}")
        assert verdicts(text, "a c b") == "??T"

    def test_other_tools_read_what_we_write(self, spot: Any) -> None:
        tree = loads("toplevel r; r and p q; p sand a b; q or c d;")
        for semantics in Semantics:
            text = AutomatonBackend().translate(tree, semantics).text
            automaton = spot.automaton(text)
            assert spot.is_deterministic(automaton)
            assert spot.are_equivalent(automaton, spot.automaton(automaton.to_str("hoa")))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "begins with HOA"),
            ("digraph {}", "begins with HOA"),
            ("touch owned |", "begins with HOA"),
            (HAND.replace("[1&!0] 0", "[1&!0 0"), "unexpected integer"),
            (HAND.replace("States: 4", "States: 2"), "larger than state count"),
            (HAND.replace("--END--", ""), "unexpected end of file"),
            (HAND.replace("--END--", "--ABORT--"), "no complete automaton"),
            (HAND + HAND, "more than one automaton"),
            (HAND.replace("acc-name", 'event: 7 "{ a: 1 }"\nacc-name'), "no proposition 7"),
            (HAND.replace("acc-name", 'event: 0 "{ a: "\nacc-name'), "expected"),
            (HAND.replace("acc-name", "event: 0\nacc-name"), "event: expects"),
            (HAND.replace("acc-name", 'event: "a" 0\nacc-name'), "event: expects the number"),
            (HAND.replace("acc-name", 'guard: 0 "X >"\nacc-name'), "expected"),
            (HAND.replace("acc-name", "alphabet: word\nacc-name"), "alphabet: expects quotes"),
            (HAND.replace("Inf(0)", "Inf(3)"), "acceptance"),
            ("HOA: v1\0", "zero byte"),
            ("HOA: v7\n" + HAND, "v7"),
        ],
    )
    def test_malformed(self, text: str, message: str) -> None:
        with pytest.raises(LanguageError, match=message) as error:
            AutomatonBackend().read(text)
        assert "\n" not in error.value.message
        assert error.value.line >= 1

    def test_the_place_of_an_error(self) -> None:
        with pytest.raises(LanguageError) as error:
            AutomatonBackend().read(HAND.replace("[1&2] 2", "[1&2 2"))
        assert (error.value.line, error.value.source) == (14, "[1&2 2")


def test_without_spot_the_error_says_what_to_install(tmp_path: Path) -> None:
    program = (
        "import sys\nsys.modules['spot'] = None\nfrom backends.automaton import AutomatonBackend\n"
        "from rvaft.errors import ToolMissing\n"
        f"try:\n    AutomatonBackend().read({HAND!r})\n"
        "except ToolMissing as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert "pip install spottl" in done.stdout
    assert issubclass(ToolMissing, RuntimeError)


def test_a_guard_that_its_pattern_does_not_bind_never_holds() -> None:
    pytest.importorskip("spot")
    tree = loads("toplevel r; r sand a b; a; b;")
    text = AutomatonBackend().translate(tree, Semantics.PROJECTED).text
    odd = text.replace('alphabet: "', 'alphabet: "{ v: V }" "W < 250"\nalphabet: "', 1)
    assert odd != text
    # `v` is not relevant then, and may come at any time
    assert verdicts(odd, [{"v": 1}, {"event": "a"}, {"v": 300}, {"event": "b"}]) == "???T"


def test_an_event_is_an_object() -> None:
    """A word alone would be a variable, which matches whatever comes."""
    tree = loads("toplevel r; r sand a b; a; b;")
    text = AutomatonBackend().translate(tree, Semantics.STRICT).text
    assert 'event: 1 "' in text
    for wrong in ("garbage", "[1]", "1"):
        with pytest.raises(LanguageError, match="an event is an object"):
            AutomatonBackend().read(re.sub(r'event: 1 ".*"', f'event: 1 "{wrong}"', text))


# What a text asks of events.


def one_state(propositions: str, *lines: str) -> str:
    return hoa(propositions, "{0} [t] 0", header="".join(f"{line}\n" for line in lines))


def observed(given: str, **atoms: str) -> set[Observed]:
    return set(AutomatonBackend().observed(given, atoms={name: parse_pattern(one) for name, one in atoms.items()}))


def test_propositions_by_default_by_the_caller_and_by_the_header() -> None:
    given = one_state("alive a b c", 'event: 3 "{ x: _1, y: _1 }"')
    patterns = ('{ event: "a" }', "{v: 1}", "{x: _1, y: _1}")
    assert observed(given, b="{v: 1}", c="{v: 1}") == {Observed(parse_pattern(one)) for one in patterns}


def test_variables_of_relevance_are_its_own() -> None:
    lines = ('alphabet: "{ v: X }" "X > 1"', 'ignore: "{ w: X }"')
    expected = {
        Observed(parse_pattern("{ v: _X }"), renamed(parse_guard("X > 1"), {"X": "_X"})),
        Observed(parse_pattern("{ w: _X }")),
    }
    assert observed(one_state("alive r", "relevant: 1", *lines)) == expected
    assert observed(one_state("alive", *lines)) == set(), "without a proposition for relevance nobody looks"


def test_variables_of_propositions_are_shared_and_their_guards_asked_there() -> None:
    given = one_state("alive a g", 'event: 1 "{ v: X }"', 'guard: 2 "X > 1"')
    pattern = parse_pattern("{v: X}")
    assert observed(given) == {Observed(pattern), Observed(pattern, parse_guard("X > 1"))}


def test_bad_texts() -> None:
    for given in ("", one_state("alive a", 'event: 7 "{ v: X }"'), one_state("alive a", "event: 1 1")):
        with pytest.raises(LanguageError):
            AutomatonBackend().observed(given)
