"""The reader on texts written by hand: Spot's operators on finite traces, and the verdict over all letters and all extensions."""

from importlib import import_module
from random import Random
from typing import Any

import pytest

from backends.ltlf.reader import spot
from rvaft.backend import Observed
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.values import Json
from tests.backends.ltlf.building import BACKEND, events, needs_spot, verdicts
from tests.tables import rows

pytestmark = [pytest.mark.spot, needs_spot]

CASES = rows(__file__, "verdicts.txt")


@pytest.mark.parametrize(("formula", "word", "expected", "why"), CASES)
def test_by_hand(formula: str, word: str, expected: str, why: str) -> None:
    assert verdicts(formula, events(word)) == expected, why


def test_empty_trace_is_unknown() -> None:
    assert [str(BACKEND.read(text).verdict) for text in ("1", "0", "F a")] == ["unknown"] * 3


def test_atoms_of_the_caller() -> None:
    atoms = {"p": ObjectPattern((("v", Literal(1)),)), "q": ObjectPattern((("v", Variable("X")), ("w", Variable("X"))))}
    trace: list[Json] = [{"v": 2}, {"v": 1.0}, {"v": 3, "w": 3}]
    assert list(BACKEND.read("F(p & X[!] q)", atoms=atoms).run(trace)) == ["unknown", "unknown", "true"]


GUARDED = "atom p := {p: X} when X < Y;atom q := {q: Y} when X < Y;F p & F q"
BOUND = "atom d := {d: Y};atom p := {p: X};atom c := {c: 1};atom q := {q: Y} when X < Y;d & X[!]((p | c) & X[!] !q)"
RELEVANCE = (
    "atom p := {p: X};relevant rel := {p: X} when X > 0;ignored rel := {p: X, off: true};"
    "!rel U (rel & p & X[!](!rel U (rel & p)))"
)
DEFINED = "one := a & X[!] b;two := one | c;F(two & X[!] X[!] two)"
WITH_HEADER: list[tuple[str, list[Json], str]] = [
    # header and formula, events, verdicts: variables are rigid
    (
        "atom p := {p: X};atom q := {q: X} when X > 1;F(p & X[!] F q)",
        [{"p": 1}, {"q": 1}, {"p": 2}, {"q": 3}, {"q": 2}],
        "????T",
    ),
    ("atom p := {p: X};atom q := {q: X} when X > 1;(p & X[!] q)", [{"p": 1}, {"q": 2}], "?F"),
    # guards wait for their variables
    (GUARDED, [{"p": 5}, {"q": 4}, {"q": "b"}, {"q": True}, {"p": 3}], "????T"),
    (GUARDED, [{"q": 4}, {"p": 5}, {"p": "a"}], "???"),
    # an assignment that has bound more may violate less
    (BOUND, [{"d": 3}, {"p": 5, "c": 1}, {"q": 3}], "??T"),
    (BOUND, [{"d": 3}, {"p": 2, "c": 1}, {"q": 3}], "??F"),
    # relevance has its own variables
    (RELEVANCE, [{"p": 0}, {"p": 1}, {"p": 2, "off": True}, {"p": "s"}, {"p": 1}], "????T"),
    (RELEVANCE, [{"p": 1}, {"p": 2}], "?F"),
    # definitions are expanded
    (DEFINED, events("a b c"), "??T"),
    (DEFINED, events("c x c"), "??T"),
    (DEFINED, events("c c x"), "???"),
]


@pytest.mark.parametrize(("lines", "trace", "expected"), WITH_HEADER)
def test_with_a_header(lines: str, trace: list[Json], expected: str) -> None:
    *header, formula = lines.split(";")
    assert verdicts("\n".join(["/* rvaft", *header, "*/", formula]), trace) == expected


def test_other_comments_are_comments() -> None:
    assert verdicts("/* any text: a := b */ F /* here too */ a", events("a")) == "T"


MALFORMED = [
    ("a & (b U", 1, 9, "unexpected end of formula"),
    ("a &\n  & b", 2, 3, "unexpected"),
    ("", 1, 1, "no formula"),
    ("/* rvaft\n*/\n", 3, 1, "no formula"),
    ("/* rvaft\natom a := {x: 1}", 1, 1, "not closed"),
    ("/* rvaft\natom a = {x: 1}\n*/ a", 2, 1, "a line of the header"),
    ("/* rvaft\natom a := {x: 1\n*/ a", 2, 16, "too early"),
    ("/* rvaft\natom a := {x: X} when X >\n*/ a", 2, 26, "too early"),
    ("/* rvaft\natom a := {x: 1}\natom a := {x: 2}\n*/ a", 3, 6, "twice"),
    ("/* rvaft\nr := s\ns := a\n*/ r", 2, 6, "before it is defined"),
    ("/* rvaft\ns := a | | b\n*/ s", 2, 10, "unexpected"),
    ("{a;b}[]->c", 1, 1, "no operator"),
    ("a b", 1, 3, "unexpected"),
    ("\x00", 1, 1, "no formula"),
]


@pytest.mark.parametrize(("text", "line", "column", "message"), MALFORMED)
def test_malformed(text: str, line: int, column: int, message: str) -> None:
    with pytest.raises(LanguageError) as raised:
        BACKEND.read(text)
    assert (raised.value.line, raised.value.column) == (line, column)
    assert message in raised.value.message
    assert "\n" not in raised.value.message


def test_states_are_shared_and_tell_futures_apart() -> None:
    one, two = BACKEND.read("F a & F b"), BACKEND.read("F a & F b")
    assert one.state == two.state
    one.step({"event": "a"})
    assert one.state != two.state
    two.step({"event": "x"})
    two.step({"event": "a"})
    assert one.state == two.state
    assert hash(one.state) == hash(two.state)
    other = BACKEND.read("F b")
    assert other.state != one.state
    two.step({"event": "b"})
    assert two.state != one.state


def test_atoms_by_default_by_the_caller_and_by_the_header() -> None:
    text = "/* rvaft\natom a := {x: _1, y: _1}\natom unused := {z: 1}\nd := F b\n*/\na & d & c"
    own = parse_pattern("{v: 1}")
    expected = [
        Observed(ObjectPattern((("event", Literal("b")),))),
        Observed(parse_pattern("{x: _1, y: _1}")),
        Observed(own),
    ]
    found = BACKEND.observed(text, atoms={"c": own, "a": own})
    assert set(found) == set(expected)
    assert len(found) == 3


def test_variables_of_relevance_are_its_own() -> None:
    text = (
        "/* rvaft\nrelevant rel := {v: X} when X > 1 when X < 5\nrelevant rel := {w: X} when Y > 1\n"
        "ignored rel := {v: X, w: _X}\n*/\nF rel"
    )
    x = Variable("_X")
    both = (Operation(Operator.GT, (x, Literal(1))), Operation(Operator.LT, (x, Literal(5))))
    assert BACKEND.observed(text) == (
        Observed(ObjectPattern((("v", x),)), Operation(Operator.AND, both)),
        Observed(ObjectPattern((("v", Variable("__X")), ("w", x)))),
    )


def test_variables_of_atoms_are_shared() -> None:
    text = "/* rvaft\natom a := {v: X} when X > 1\n*/\nF a"
    assert BACKEND.observed(text) == (Observed(parse_pattern("{v: X}"), parse_guard("X > 1")),)


def test_bad_texts_observe_nothing() -> None:
    for text in ("", "a &", "/* rvaft\natom a := \n*/\na"):
        with pytest.raises(LanguageError):
            BACKEND.observed(text)


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
        for word, signs in zip(words, by_spot(text, words), strict=True):
            assert verdicts(HEADER + text, [dict.fromkeys(letter, True) for letter in word]) == signs, (text, word)
