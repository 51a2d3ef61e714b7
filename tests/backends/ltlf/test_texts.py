"""The texts: the formula of each gate, where compositional forms give way to a sum, names, strings, guards."""

from itertools import product

import pytest

from rvaft.api import loads
from rvaft.errors import TreeError
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.ltlf.building import BACKEND, body, events, spot_needed, text_of, verdicts

E = "event e(p) = {e: p};"

PINNED: list[tuple[str, str, list[str]]] = [
    ("t or a b;", "strict", ["a | b"]),
    ("t or a b;", "projected", ["!rel U (rel & (a | b))"]),
    ("t or a b;", "scattered", ["F a | F b"]),
    ("t and a b;", "strict", ["s1 := a | b", "s1 & X[!] s1 & !(a & X[!] a) & !(b & X[!] b)"]),
    (
        "t and a b;",
        "projected",
        [
            "s1 := a | b",
            "!rel U (rel & s1 & X[!](!rel U (rel & s1)) & !(a & X[!](!rel U (rel & a))) & !(b & X[!](!rel U (rel & b))))",
        ],
    ),
    ("t and a b;", "scattered", ["F a & F b"]),
    (
        "t and a b c;",
        "strict",
        [
            "s1 := a | b | c",
            "s2 := X[!] a",
            "s3 := X[!] b",
            "s4 := X[!] c",
            "s1 & X[!](s1 & X[!] s1) & !((a & X[!](a | s2)) | X[!](a & s2)) & !((b & X[!](b | s3)) | X[!](b & s3)) & !((c & X[!](c | s4)) | X[!](c & s4))",
        ],
    ),
    ("t sand a b;", "strict", ["a & X[!] b"]),
    ("t sand a b;", "projected", ["!rel U (rel & a & X[!](!rel U (rel & b)))"]),
    ("t sand a b;", "scattered", ["F(a & X[!] F b)"]),
    ("t sand_rl a b;", "strict", ["b & X[!] a"]),
    ("t sand_rl a b;", "projected", ["!rel U (rel & b & X[!](!rel U (rel & a)))"]),
    ("t sand_rl a b;", "scattered", ["F(b & X[!] F a)"]),
    ("t 2of3 a b c;", "strict", ["s1 := a | b | c", "s1 & X[!] s1 & !(a & X[!] a) & !(b & X[!] b) & !(c & X[!] c)"]),
    ("t 2of3 a b c;", "scattered", ["s1 := F b", "s2 := F c", "(F a & (s1 | s2)) | (s1 & s2)"]),
    (
        "t sand v d; v 2of3 a b c;",
        "strict",
        [
            "s1 := a | b | c",
            "s2 := s1 & X[!](s1 & X[!] d)",
            "s3 := X[!] a",
            "s4 := a & s3",
            "s5 := X[!] b",
            "s6 := b & s5",
            "s7 := X[!] c",
            "s8 := c & s7",
            "(s2 & !s4 & !s6 & !s8) | (s1 & X[!] s2 & !((a & X[!](a | s3)) | X[!] s4) & !((b & X[!](b | s5)) | X[!] s6) & !((c & X[!](c | s7)) | X[!] s8))",
        ],
    ),
    (
        "t sand v d; v 2of3 a b c;",
        "scattered",
        ["s1 := X[!] F d", "s2 := F(b & s1)", "s3 := F(c & s1)", "(F(a & s1) & (s2 | s3)) | (s2 & s3)"],
    ),
    (
        "t and g c; g sand a b on e(); event e() = {e: 1};",
        "strict",
        [
            "s1 := X[!] b",
            "s2 := X[!](a & s1)",
            "(c & X[!](g & s2)) | (g & X[!]((c & s2) | (a & X[!]((c & s1) | (b & X[!] c)))))",
        ],
    ),
    (
        "t and g c; g sand a b on e(); event e() = {e: 1};",
        "scattered",
        [
            "s1 := X[!] F b",
            "s2 := X[!] F(a & s1)",
            "F((g & X[!] F((a & X[!] F((b & X[!] F c) | (c & s1))) | (c & s2))) | (c & X[!] F(g & s2)))",
        ],
    ),
    ("causality bottom_up; t or g; g sand a b on e(); event e() = {e: 1};", "strict", ["a & X[!](b & X[!] g)"]),
]

FORMS = [
    # where a condition holds the compositional form, else a sum over what may come next
    ("t and a b; a sand x s; b or s y;", "scattered", ["s1 := F s", "F(x & X[!] s1) & (s1 | F y)"]),
    ("t and a b; a sand x s; b sand s y;", "scattered", ["F(x & X[!] F(s & X[!] F y))"]),
    (f"{E} t and a b; a on e(1); b on e(_);", "scattered", ["F((a & X[!] F b) | (b & X[!] F a))"]),
    (f"{E} t and a b c; a on e(1); b on e(1); c on e(2);", "scattered", ["F(a & X[!] F a) & F c"]),
    (f"{E} t sand a b; a on e(1); b on e(_);", "scattered", ["F(a & X[!] F b)"]),
    (
        "t and a b; a or x z;",
        "strict",
        ["s1 := x | z", "s2 := s1 | b", "s2 & X[!] s2 & !(s1 & X[!] s1) & !(b & X[!] b)"],
    ),
    ("t and a b; a sand x z;", "strict", ["s1 := X[!] z", "(b & X[!](x & s1)) | (x & X[!]((b & s1) | (z & X[!] b)))"]),
]


@pytest.mark.parametrize(("tree", "semantics", "expected"), PINNED + FORMS)
def test_form(tree: str, semantics: str, expected: list[str]) -> None:
    assert body(text_of(tree, semantics)) == expected


@pytest.mark.parametrize("tree", [tree for tree, _, _ in FORMS] + ["t sand a b; a or x s; b or y s;"])
@pytest.mark.parametrize("semantics", list(Semantics))
@spot_needed
def test_every_short_word(tree: str, semantics: Semantics) -> None:
    """The trees with the counterexamples, on every word of up to four events."""
    made = loads(tree)
    letters: list[Json] = [{"e": 1}, {"e": 2}] if "event e" in tree else events("b s x y z")
    specification = BACKEND.translate(made, semantics)
    for word in product([*letters, {}], repeat=4):
        expected = list(Reference(made, semantics).run(word))
        assert list(specification.monitor().run(word)) == expected, word


def test_what_another_part_contains_anyway_is_not_asked_twice() -> None:
    assert body(text_of("t and b s; s sand a b c;", "strict")) == ["a & X[!](b & X[!] c)"]
    assert body(text_of("t and b s; s or b c;", "scattered")) != body(text_of("t and s; s or b c;", "scattered"))


def test_whole_text() -> None:
    tree = """
        event reading(v) = { topic: "/sensor", value: v };
        ignore reading(V) when V < 0;
        t sand a b;
        a on reading(Value);
        b on reading(_) when Value >= 250;
    """
    assert text_of(tree, "projected").splitlines() == [
        "/* rvaft",
        'atom a := { topic: "/sensor", value: Value } when Value >= 250',
        'atom b := { topic: "/sensor", value: _ }',
        'relevant rel := { topic: "/sensor", value: Value }',
        'relevant rel := { topic: "/sensor", value: _ }',
        'ignored rel := { topic: "/sensor", value: V } when V < 0',
        "*/",
        "!rel U (rel & a & X[!](!rel U (rel & b)))",
    ]


REMOTE = """
    event move(w, t) = { name: "move", waypoint: w, time: t };
    event radiation(v, t) = { topic: "/radiation", value: v, time: t };
    event goal(w) = { goal: w };
    t sand reading high out;
    reading on radiation(Value, T1);
    high when Value >= 250;
    out sand leave ends on move(Wp, T2);
    leave when Wp != "entrance";
    ends or late changed;
    late fault when T2 >= T1 + 10;
    changed and altered attack on goal(Goal);
    altered when Wp != Goal;
"""


def test_names_are_legal_and_different() -> None:
    wanted = ["a", "A", "x y", "x_y", "true", "xor", "1st", "é", "F", "a_2", "s1", "rel"]
    leaves = tuple(wanted)
    text = BACKEND.translate(
        RVAFT("top", [Node("top", Gate.SAND, leaves), *map(Node, leaves)]), Semantics.PROJECTED
    ).text
    given = [line.split()[1] for line in text.splitlines() if line.startswith("atom ")]
    assert len(set(given)) == len(wanted)
    assert all(name.isascii() and name == name.lower() and not name[0].isdigit() for name in given)


@spot_needed
def test_names_and_strings_that_could_end_the_comment() -> None:
    tree = 't sand "Ärger" "X" "s1" "s 1" rel; "Ärger" on e("*/ 1 /*"); event e(p) = { "*/": p, "when": "when" };'
    for semantics in Semantics:
        text = BACKEND.translate(loads(tree), semantics).text
        assert text.count("*/") == text.count("/*") == 1
        start: list[Json] = [{"*/": "*/ 1 /*", "when": "when"}]
        trace = [*start, *({"event": name} for name in ("X", "s1", "s 1", "rel"))]
        assert verdicts(text, trace) == "????T"


def test_guards_stand_at_every_event_that_binds_one_of_their_variables() -> None:
    text = text_of(REMOTE, "strict")
    lines = [line.removeprefix("atom ").split(" := ") for line in text.splitlines() if line.startswith("atom ")]
    atoms = {name: what.split(" when ")[1:] for name, what in lines}
    assert atoms == {
        "reading": ["Value >= 250", "T2 >= T1 + 10"],
        "out": ['Wp != "entrance"', "T2 >= T1 + 10"],
        "reading_2": ["Value >= 250"],
        "out_2": ['Wp != "entrance"', "Wp != Goal"],
        "changed": ["Wp != Goal"],
    }
    assert body(text) == ["(reading & X[!] out) | (reading_2 & X[!](out_2 & X[!] changed))"]


def test_gates_do_not_travel() -> None:
    text = text_of("t and left right; left or a b; right 1of2 c d;", "projected")
    assert "left" not in text
    assert "right" not in text


def test_no_feasible_scenario() -> None:
    nodes = [Node("t", Gate.SAND, ("a", "b")), Node("a", Gate.AND, ("s",)), Node("b", Gate.AND, ("s",)), Node("s")]
    for semantics in Semantics:
        with pytest.raises(TreeError, match="no-scenario"):
            BACKEND.translate(RVAFT("t", nodes), semantics)
