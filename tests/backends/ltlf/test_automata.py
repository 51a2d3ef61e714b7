"""Random formulas: the verdicts of the reader are those that Spot's own translation to automata gives."""

from importlib import import_module
from random import Random
from typing import Any

import pytest

from backends.ltlf.reader import spot
from tests.backends.ltlf.building import needs_spot, verdicts

pytestmark = needs_spot

ATOMS = ("a", "b")
LETTERS = [frozenset(letter) for letter in ("", "a", "b", "ab")]
UNARY = ("!", "X", "X[!]", "F", "G")
BINARY = ("&", "|", "U", "R", "W", "M", "->", "<->", "xor")
HEADER = "/* rvaft\natom a := {a: true}\natom b := {b: true}\n*/\n"


def random_formula(random: Random, depth: int) -> str:
    if depth == 0 or random.random() < 0.15:
        return random.choice([*ATOMS, *ATOMS, "1", "0", "X[!] 1", "!X[!] 1"])
    if random.random() < 0.4:
        return f"{random.choice(UNARY)}({random_formula(random, depth - 1)})"
    left, right = random_formula(random, depth - 1), random_formula(random, depth - 1)
    return f"({left}) {random.choice(BINARY)} ({right})"


def by_spot(text: str, words: list[list[frozenset[str]]]) -> list[str]:
    """One sign for each letter, by a deterministic automaton for the formula and the end of the trace (`alive` turns false for ever)."""
    module = spot()
    buddy: Any = import_module("buddy")  # comes with Spot, and is found once Spot is loaded
    automaton = module.translate(module.from_ltlf(module.formula(text), "alive"), "parity", "deterministic", "complete")
    numbers = {name: automaton.register_ap(name) for name in (*ATOMS, "alive")}

    def edge(state: int, letter: frozenset[str]) -> tuple[int, Any]:
        cube = buddy.bddtrue
        for name, number in numbers.items():
            cube = buddy.bdd_and(cube, buddy.bdd_ithvar(number) if name in letter else buddy.bdd_nithvar(number))
        edges = [edge for edge in automaton.out(state) if buddy.bdd_and(cube, edge.cond) != buddy.bddfalse]
        assert len(edges) == 1
        return edges[0].dst, edges[0].acc

    def ends_well(state: int) -> bool:
        marks: dict[int, Any] = {}
        while state not in marks:
            after, marks[state] = edge(state, frozenset())
            state = after
        union = module.mark_t([])
        for mark in list(marks.values())[list(marks).index(state) :]:
            union |= mark
        return bool(automaton.acc().accepting(union))

    moves = {
        (state, letter): edge(state, letter | {"alive"})[0]
        for state in range(automaton.num_states())
        for letter in LETTERS
    }

    def sign(state: int) -> str:
        seen, todo = {state}, [state]
        while todo:
            current = todo.pop()
            fresh = {moves[current, letter] for letter in LETTERS} - seen
            seen |= fresh
            todo.extend(fresh)
        futures = {ends_well(one) for one in seen}
        return "?" if len(futures) == 2 else "T" if futures == {True} else "F"

    found = []
    for word in words:
        state, signs = automaton.get_init_state_number(), ""
        for letter in word:
            state = moves[state, letter]
            signs += sign(state)
        found.append(signs)
    return found


@pytest.mark.parametrize("seed", range(60))
def test_random_formulas(seed: int) -> None:
    random = Random(seed)
    text = random_formula(random, random.randint(1, 4))
    words = [[random.choice(LETTERS) for _ in range(random.randint(1, 6))] for _ in range(8)]
    expected = by_spot(text, words)
    for word, signs in zip(words, expected, strict=True):
        assert verdicts(HEADER + text, [dict.fromkeys(letter, True) for letter in word]) == signs, (text, word)
