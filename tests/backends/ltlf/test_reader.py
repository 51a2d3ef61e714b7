"""The reader on texts written by hand: Spot's operators on finite traces, and the verdict over all letters and all extensions."""

import pytest

from rvaft.backend import Observed
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.values import Json
from tests.backends.ltlf.building import BACKEND, events, needs_spot, verdicts

pytestmark = needs_spot

CASES = [
    # formula, word, verdicts, why
    ("a", "a", "T", "only the first position counts"),
    ("a", "b a", "FF", "and a verdict stays"),
    ("1", "x", "T", "unknown only before the first event"),
    ("0", "x", "F", ""),
    ("F a", "x x a x", "??TT", ""),
    ("G a", "a a x a", "??FF", "true never: an extension may violate it"),
    ("a U b", "a a b", "??T", ""),
    ("a U b", "a x b", "?FF", ""),
    ("a W b", "a a x", "??F", ""),
    ("a W b", "a b x", "?TT", ""),
    ("b R a", "a a x", "??F", ""),
    ("a R a", "a x", "TT", ""),
    ("a M a", "a x", "TT", "strong release: both at once"),
    ("b M a", "a a a", "???", "it may still be released"),
    ("b M a", "x", "F", ""),
    ("X[!] a", "x a", "?T", "strong next"),
    ("X[!] a", "x x", "?F", ""),
    ("X a", "x a", "?T", "weak next: accepted at the end, but not on every extension"),
    ("X a", "x x", "?F", ""),
    ("X[!] 1", "x x", "?T", "there is a second event"),
    ("!X[!] 1", "x x", "?F", "the first event is the last"),
    ("X 0", "x x", "?F", "the same"),
    ("F(a & !X[!] 1)", "a x a", "???", "the last event is an a: never settled"),
    ("F(a & X 0) | X[!] X[!] 1", "x x x", "??T", "or there are three events"),
    ("G(a -> X[!] b)", "a b a x", "???F", "an obligation that the end of the trace would break"),
    ("G(a -> F b) & F a", "a b", "??", ""),
    ("F a & G !a", "x", "F", "a contradiction that no single operator shows"),
    ("(a U b) & G !b", "a", "F", ""),
    ("F a | G !a", "x", "T", "a tautology"),
    ("F a <-> F a", "x", "T", ""),
    ("F a xor F b", "x a x b", "???F", "both: no longer exactly one"),
    ("(F a -> F b)", "x b", "?T", ""),
    ("a <-> b", "a", "F", "letters are of the events, not of the formula"),
    ("X[2] a", "x x a", "??T", "Spot's abbreviation for X X a"),
    ("X[2!] a", "x x a", "??T", ""),
    ("F G a", "a x a", "???", ""),
    ("G F a", "a x", "??", ""),
    ("G F a & F G !a", "x", "F", "on finite traces both ask about the last event"),
    ("G(X[!] 1)", "x", "F", "no trace goes on for ever"),
    ("F(!X[!] 1)", "x", "T", "every trace has a last event"),
    ("!(F a) U b", "x b", "??", "G !a looks beyond the b"),
    ("!a U b", "x b", "?T", ""),
]


@pytest.mark.parametrize(("formula", "word", "expected", "why"), CASES)
def test_by_hand(formula: str, word: str, expected: str, why: str) -> None:
    assert verdicts(formula, events(word)) == expected, why


def test_empty_trace_is_unknown() -> None:
    assert [str(BACKEND.read(text).verdict) for text in ("1", "0", "F a")] == ["unknown"] * 3


def test_atoms_of_the_caller() -> None:
    atoms = {"p": ObjectPattern((("v", Literal(1)),)), "q": ObjectPattern((("v", Variable("X")), ("w", Variable("X"))))}
    trace: list[Json] = [{"v": 2}, {"v": 1.0}, {"v": 3, "w": 3}]
    assert list(BACKEND.read("F(p & X[!] q)", atoms=atoms).run(trace)) == ["unknown", "unknown", "true"]


def test_variables_are_rigid() -> None:
    text = "/* rvaft\natom p := {p: X}\natom q := {q: X} when X > 1\n*/\nF(p & X[!] F q)"
    assert verdicts(text, [{"p": 1}, {"q": 1}, {"p": 2}, {"q": 3}, {"q": 2}]) == "????T"
    assert verdicts(text.replace("F(", "(").replace("F q", "q"), [{"p": 1}, {"q": 2}]) == "?F"


def test_guards_wait_for_their_variables() -> None:
    text = "/* rvaft\natom p := {p: X} when X < Y\natom q := {q: Y} when X < Y\n*/\nF p & F q"
    assert verdicts(text, [{"p": 5}, {"q": 4}, {"q": "b"}, {"q": True}, {"p": 3}]) == "????T"
    assert verdicts(text, [{"q": 4}, {"p": 5}, {"p": "a"}]) == "???"


def test_an_assignment_that_has_bound_more_may_violate_less() -> None:
    atoms = ("d := {d: Y}", "p := {p: X}", "c := {c: 1}", "q := {q: Y} when X < Y")
    text = "/* rvaft\n" + "".join(f"atom {atom}\n" for atom in atoms) + "*/\nd & X[!]((p | c) & X[!] !q)"
    assert verdicts(text, [{"d": 3}, {"p": 5, "c": 1}, {"q": 3}]) == "??T"
    assert verdicts(text, [{"d": 3}, {"p": 2, "c": 1}, {"q": 3}]) == "??F"


def test_relevance_has_its_own_variables() -> None:
    header = "/* rvaft\natom p := {p: X}\nrelevant rel := {p: X} when X > 0\nignored rel := {p: X, off: true}\n*/\n"
    text = header + "!rel U (rel & p & X[!](!rel U (rel & p)))"
    assert verdicts(text, [{"p": 0}, {"p": 1}, {"p": 2, "off": True}, {"p": "s"}, {"p": 1}]) == "????T"
    assert verdicts(text, [{"p": 1}, {"p": 2}]) == "?F"


def test_definitions_are_expanded() -> None:
    text = "/* rvaft\none := a & X[!] b\ntwo := one | c\n*/\nF(two & X[!] X[!] two)"
    assert verdicts(text, events("a b c")) == "??T"
    assert verdicts(text, events("c x c")) == "??T"
    assert verdicts(text, events("c c x")) == "???"


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
