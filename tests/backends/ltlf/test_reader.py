"""The reader on texts written by hand: Spot's operators on finite traces, and the verdict over all
letters and all extensions.
"""

from random import Random

import pytest

from backends.automaton import AutomatonBackend
from backends.ltlf import LtlfBackend
from backends.ltlf.reader import spot
from rvaft.language.parser import parse_pattern
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.values import Json
from tests.backends.texts import SPOT, signs
from tests.tables import rows

BACKEND = LtlfBackend()


def signed(text: str, trace: str | list[Json]) -> str:
    return signs(BACKEND.read(text), trace)


pytestmark = [*SPOT]


@pytest.mark.parametrize(("formula", "word", "expected", "why"), rows(__file__, "verdicts.txt"))
def test_by_hand(formula: str, word: str, expected: str, why: str) -> None:
    assert signed(formula, word) == expected, why


def test_empty_trace_is_unknown() -> None:
    assert [str(BACKEND.read(text).verdict) for text in ("1", "0", "F a")] == ["unknown"] * 3


def test_atoms_of_the_caller() -> None:
    atoms = {"p": ObjectPattern((("v", Literal(1)),)), "q": ObjectPattern((("v", Variable("X")), ("w", Variable("X"))))}
    trace: list[Json] = [{"v": 2}, {"v": 1.0}, {"v": 3, "w": 3}]
    assert list(BACKEND.read("F(p & X[!] q)", atoms=atoms).run(trace)) == ["unknown", "unknown", "true"]


@pytest.mark.parametrize(("lines", "trace", "expected"), rows(__file__, "headers.txt"))
def test_with_a_header(lines: list[str], trace: list[Json], expected: str) -> None:
    assert signed("\n".join(["/* rvaft", *lines[:-1], "*/", lines[-1]]), trace) == expected


def test_states_are_shared_and_tell_futures_apart() -> None:
    monitors = [BACKEND.read("F a & F b") for _ in range(6)] + [BACKEND.read("F b")]
    for monitor, word in zip(monitors, ("", "x", "a", "x a", "b", "a b", ""), strict=True):
        signs(monitor, word)
    states = [monitor.state for monitor in monitors]
    same = [[one == other for other in states] for one in states]
    assert [row.index(True) for row in same] == [0, 0, 2, 2, 4, 5, 6]
    assert hash(states[2]) == hash(states[3])


@pytest.mark.parametrize(("lines", "expected"), rows(__file__, "observed.txt"))
def test_what_is_observed(lines: list[str], expected: list[str]) -> None:
    own = parse_pattern("{v: 1}")
    found = BACKEND.observed("\n".join(["/* rvaft", *lines[:-1], "*/", lines[-1]]), atoms={"c": own, "a": own})
    texts = [pattern_text(one.pattern) + (f" when {guard_text(one.when)}" if one.when else "") for one in found or ()]
    assert sorted(texts) == sorted(expected)


# Random formulas: the verdicts are those of Spot's own translation to automata, run by the reader of these.

ATOMS = ("a", "b")
LETTERS = ("", "a", "b", "ab")
UNARY = ("!", "X", "X[!]", "F", "G")
BINARY = ("&", "|", "U", "R", "W", "M", "->", "<->", "xor")


def random_formula(random: Random, depth: int) -> str:
    if depth == 0 or random.random() < 0.15:
        return random.choice([*ATOMS, *ATOMS, "1", "0", "X[!] 1", "!X[!] 1"])
    if random.random() < 0.4:
        return f"{random.choice(UNARY)}({random_formula(random, depth - 1)})"
    left, right = random_formula(random, depth - 1), random_formula(random, depth - 1)
    return f"({left}) {random.choice(BINARY)} ({right})"


def test_random_formulas() -> None:
    random = Random("formulas")
    atoms = {name: parse_pattern(f"{{{name}: true}}") for name in ATOMS}
    for _ in range(250):
        text = random_formula(random, random.randint(1, 5))
        automaton = spot().translate(
            spot().from_ltlf(spot().formula(text), "alive"), "parity", "deterministic", "complete"
        )
        for _ in range(3):
            word: list[Json] = [dict.fromkeys(random.choice(LETTERS), True) for _ in range(random.randint(1, 6))]
            expected = signs(AutomatonBackend().read(automaton.to_str("hoa"), atoms=atoms), word)
            assert signs(BACKEND.read(text, atoms=atoms), word) == expected, (text, word)
