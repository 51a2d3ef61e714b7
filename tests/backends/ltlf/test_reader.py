"""The reader on texts written by hand: Spot's operators on finite traces, and the verdict over all letters and all extensions."""

from collections.abc import Hashable
from importlib import import_module
from random import Random
from typing import Any

import pytest

from backends.ltlf import LtlfBackend
from backends.ltlf.reader import spot
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_pattern
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.values import Json
from tests.backends.texts import SPOT, events, signs
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


def test_other_comments_are_comments() -> None:
    assert signed("/* any text: a := b */ F /* here too */ a", "a") == "T"


@pytest.mark.parametrize(("text", "line", "column", "message"), rows(__file__, "malformed.txt"))
def test_malformed(text: str, line: int, column: int, message: str) -> None:
    for read in (BACKEND.read, BACKEND.observed):
        with pytest.raises(LanguageError) as raised:
            read(text)
    assert (raised.value.line, raised.value.column) == (line, column)
    assert message in raised.value.message
    assert "\n" not in raised.value.message


def test_states_are_shared_and_tell_futures_apart() -> None:
    def after(text: str, word: str) -> Hashable:
        monitor = BACKEND.read(text)
        list(monitor.run(events(word)))
        return monitor.state

    both = "F a & F b"
    states = [after(both, word) for word in ("", "x", "a", "x a", "b", "a b")] + [after("F b", "")]
    same = [[one == other for other in states] for one in states]
    assert [row.index(True) for row in same] == [0, 0, 2, 2, 4, 5, 6]
    assert hash(states[2]) == hash(states[3])


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        # atoms by default, by the caller (c is { v: 1 }), and by the header; what is not used asks nothing
        (
            ["atom a := {x: _1, y: _1}", "atom unused := {z: 1}", "d := F b", "a & d & c"],
            ['{ event: "b" }', "{ x: _1, y: _1 }", "{ v: 1 }"],
        ),
        # variables of relevance are its own, those of atoms are shared
        (
            [
                "relevant r := {v: X} when X > 1 when X < 5",
                "relevant r := {w: X} when Y > 1",
                "ignored r := {v: X, w: _X}",
                "F r",
            ],
            ["{ v: _X } when _X > 1 and _X < 5", "{ v: __X, w: _X }"],
        ),
        (["atom a := {v: X} when X > 1", "F a"], ["{ v: X } when X > 1"]),
    ],
)
def test_what_is_observed(lines: list[str], expected: list[str]) -> None:
    own = parse_pattern("{v: 1}")
    found = BACKEND.observed("\n".join(["/* rvaft", *lines[:-1], "*/", lines[-1]]), atoms={"c": own, "a": own})
    texts = [pattern_text(one.pattern) + (f" when {guard_text(one.when)}" if one.when else "") for one in found]
    assert sorted(texts) == sorted(expected)


# Random formulas: the verdicts are those that Spot's own translation to automata gives.

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


def test_random_formulas() -> None:
    random = Random("formulas")
    for _ in range(250):
        text = random_formula(random, random.randint(1, 5))
        words = [[random.choice(LETTERS) for _ in range(random.randint(1, 6))] for _ in range(3)]
        for word, expected in zip(words, by_spot(text, words), strict=True):
            assert signed(HEADER + text, [dict.fromkeys(letter, True) for letter in word]) == expected, (text, word)
