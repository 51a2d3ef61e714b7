"""Random formulas: the verdicts of the reader are those that Spot's own automata and the plain definition of LTLf give."""

from itertools import product
from random import Random
from typing import Any

import pytest

from tests.backends.ltlf.building import BACKEND, needs_spot

pytestmark = needs_spot

ATOMS = ("a", "b")
UNARY = ("!", "X", "X[!]", "F", "G")
BINARY = ("&", "|", "U", "R", "W", "M", "->", "<->", "xor")
HEADER = "/* rvaft\natom a := {a: true}\natom b := {b: true}\n*/\n"
LETTERS = [frozenset(letter) for letter in ("", "a", "b", "ab")]


def random_formula(random: Random, depth: int) -> str:
    if depth == 0 or random.random() < 0.15:
        return random.choice([*ATOMS, *ATOMS, "1", "0", "X[!] 1", "!X[!] 1"])
    if random.random() < 0.4:
        return f"{random.choice(UNARY)}({random_formula(random, depth - 1)})"
    left, right = random_formula(random, depth - 1), random_formula(random, depth - 1)
    return f"({left}) {random.choice(BINARY)} ({right})"


def satisfied(formula: Any, word: list[frozenset[str]], at: int) -> bool:
    """The definition of LTLf, word by word."""
    here = [satisfied(part, word, at) for part in formula] if formula.kindstr() not in {"X", "strong_X"} else []
    rest = range(at, len(word))
    parts = list(formula)

    def later(part: int, position: int) -> bool:
        return satisfied(parts[part], word, position)

    def until(stay: int, stop: list[int]) -> bool:
        return any(all(later(p, j) for p in stop) and all(later(stay, i) for i in range(at, j)) for j in rest)

    match formula.kindstr():
        case "tt":
            return True
        case "ff":
            return False
        case "ap":
            return formula.ap_name() in word[at]
        case "Not":
            return not here[0]
        case "And":
            return all(here)
        case "Or":
            return any(here)
        case "Implies":
            return not here[0] or here[1]
        case "Equiv":
            return here[0] == here[1]
        case "Xor":
            return here[0] != here[1]
        case "X":
            return at + 1 == len(word) or later(0, at + 1)
        case "strong_X":
            return at + 1 < len(word) and later(0, at + 1)
        case "F":
            return any(later(0, j) for j in rest)
        case "G":
            return all(later(0, j) for j in rest)
        case "U":
            return until(0, [1])
        case "W":
            return until(0, [1]) or all(later(0, j) for j in rest)
        case "M":
            return until(1, [0, 1])
        case "R":
            return until(1, [0, 1]) or all(later(1, j) for j in rest)
    raise AssertionError(formula.kindstr())


def run(text: str, word: list[frozenset[str]]) -> str:
    signs = {"true": "T", "false": "F", "unknown": "?"}
    return "".join(signs[v] for v in BACKEND.read(HEADER + text).run(dict.fromkeys(x, True) for x in word))


@pytest.mark.parametrize("seed", range(60))
def test_random_formulas(seed: int) -> None:
    from tests.backends.ltlf.automata import Automaton, spot

    random = Random(seed)
    text = random_formula(random, random.randint(1, 4))
    automaton = Automaton(text, ATOMS)
    for _ in range(8):
        word = [random.choice(LETTERS) for _ in range(random.randint(1, 6))]
        found = run(text, word)
        assert found == automaton.verdicts(word), (text, word)
        if found[-1] != "?":  # by the definition too, on the word and all its extensions by up to two letters
            ends = [list(end) for length in range(3) for end in product(LETTERS, repeat=length)]
            answers = {satisfied(spot.formula(text), word + end, 0) for end in ends}
            assert answers == {found[-1] == "T"}, (text, word)
