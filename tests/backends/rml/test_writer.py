"""The texts are pinned; what some trees mean that only this language finds hard; what is refused."""

from random import Random

import pytest

from backends.rml import RmlBackend
from cross_check.generate.traces import random_trace
from rvaft.analysis.branches import restrict
from rvaft.api import loads
from rvaft.errors import NotExpressible
from rvaft.model.verdict import Semantics
from tests.backends.texts import agreeing, signs, tree
from tests.tables import rows
from tests.trees.shipped import TREES

RML = RmlBackend()
STRICT, PROJECTED, SCATTERED = Semantics


def text(described: str, semantics: str = "strict") -> str:
    return RML.translate(tree(described), Semantics(semantics)).text


def equations(described: str, semantics: str = "strict") -> str:
    return text(described, semantics).strip().rpartition("\n\n")[2]


# -- texts -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gate", "strict", "scattered"), rows(__file__, "gates.txt"))
def test_each_gate(gate: str, strict: str, scattered: str) -> None:
    assert equations(f"top {gate};") == strict
    body = strict.removeprefix("Main = ").removesuffix(";")
    assert equations(f"top {gate};", "projected") == f"Main = relevant >> ({body});"
    assert equations(f"top {gate};", "scattered") == scattered


OVERLAPPING = "event p(x) = { x: x }; event q(y) = { y: y }; top and m n; m on p(1); n on q(1);"
PINNED = [
    ("a VOT over many leaves is a counted shuffle", "top sand v z; v 6of12 [a# ]*12;",
     f"Main = (({' | '.join(f'a{n}?' for n in range(12))}) /\\ ({'any ' * 6}any*)) z all;"),
    ("`a (b | c)` is an event type with a pattern for its argument", "top sand a x; x and b c;",
     "Main = a P1 all;\nP1 = b | c;"),
    ("the larger set first", OVERLAPPING, "Main = ((m /\\ n) (n \\/ m) all) \\/ (m n all) \\/ (n m all);"),
    ("at least, then something", "top sand v d; v 1of2 a b;",
     "Main = (a ((d all) \\/ (b S1))) \\/ (b ((d all) \\/ (a S1)));\nS1 = d all;"),
]  # fmt: skip


@pytest.mark.parametrize(("why", "described", "expected"), PINNED, ids=[row[0] for row in PINNED])
def test_equations(why: str, described: str, expected: str) -> None:
    assert equations(described) == expected


def test_the_whole_text() -> None:
    assert text("top or a b;", "projected") == (
        "// The attack-fault tree top under the semantics projected.\n\n"
        "a matches { 'event': 'a' };\n"
        "b matches { 'event': 'b' };\n"
        "relevant matches a | b;\n\n"
        "Main = relevant >> ((a \\/ b) all);\n"
    )


INSPECTION = (TREES / "remote_inspection" / "pruned.rvaft").read_text(encoding="utf-8")
LITERAL = "event e() = {{ v: {} }}; top and a; a on e();"
HIDDEN = "e(number) matches { 'v': number };"
LINES = [
    ("top 6of13 s [a# ]*12; s sand x y;", [f"top_counted matches x | {' | '.join(f'a{n}' for n in range(12))};"]),
    *((LITERAL.format(literal), [f"e matches {{ 'v': {written} }};"]) for literal, written in [
        ("1", "(1 | 1.0)"), ("1.5", "1.5"), ("1e3", "(1000 | 1000.0)"), ("1e-3", "0.001"), ("true", "true"),
        ("null", "null"), ('"it\'s\\n\\\\"', "'it\\'s\\n\\\\'"), ('"1"', "'1'"),
    ]),
    (LITERAL.format("-1"), [HIDDEN, "a matches e(-1) | e(-1.0);"]),
    (LITERAL.format("-1.5"), [HIDDEN, "a matches e(-1.5);"]),
    (LITERAL.format("9007199254740993"),
     [HIDDEN, "a matches e(number) with number == ((9007199 * 1000000000) + 254740993);"]),
    (INSPECTION, [
        "ev4_ev5(t) matches radiation(v, t) with v >= 250;", "ev6_ev8(wp, t, t1) matches move(wp, t) with t >= (t1 + 10);",
        "ev7 not matches move('entrance', _);", "ev10(wp) not matches goal(wp);",
        "relevant matches move(_, _) | result(_, 'success') | inspect(_) | radiation(_, _) | goal(_);",
        ("Main = relevant >> { let waypoint, t1, newWp, t2, mBGoal; (ev1(waypoint) \\/ ev2(waypoint)) inspect(waypoint) "
        "ev4_ev5(t1) (((ev6_ev8(newWp, t2, t1) all) /\\ (ev7 all)) \\/ ((move(newWp, t2) /\\ ev7) "
        "((goal(mBGoal) all) /\\ (ev10(newWp) all)))) };"),
    ]),
]  # fmt: skip


@pytest.mark.parametrize(("described", "expected"), LINES)
def test_lines(described: str, expected: list[str]) -> None:
    assert set(expected) <= set(text(described, "projected").splitlines())


def test_the_limit_does_not_choose_the_form() -> None:
    made = loads("top 3of6 a b c d e f;")
    assert {RML.translate(made, STRICT, limit=limit).text for limit in (60, 120, 20_000)} == {
        text("top 3of6 a b c d e f;")
    }


def test_no_text_needs_what_the_monitor_in_rosmonitoring_lacks() -> None:
    found = equations("top 70of90 [e# ]*90;")
    assert found.count("any") == 70
    assert "{" not in found


# -- meaning -----------------------------------------------------------------------------------------------------------


IGNORING = 'event x(p) = { x: p }; ignore x(V) when V > "1"; top sand a b; a on x(_);'
ORDERED = 'event x(p) = { x: p }; top or a b; a; b on x(V) when V > "1";'
BOUND = "event n(v) = {{ v: v }}; top sand a b{c}; a on n(X); b on n({Y}){when};"
MEANT = [
    ("an `ignore` matters under projected alone", IGNORING, [STRICT, SCATTERED]),
    ("a variable of one event is no obstacle under scattered",
     "event n(v, w) = { v: v, w: w }; top sand a b; a on n(X, X) when X > 1; b on n(Y, _);", [SCATTERED]),
    ("which of two events binds X is open until later; each partial match has registers of its own",
     "event p(v) = { x: v }; event q(v) = { y: v }; top and m n g; m on p(X); n on q(Y); g and c when X < Y + 0;",
     [STRICT, PROJECTED]),
]  # fmt: skip


@pytest.mark.parametrize(("why", "described", "semantics"), MEANT, ids=[row[0] for row in MEANT])
def test_more_by_hand(why: str, described: str, semantics: list[Semantics]) -> None:
    for one in semantics:
        random, made = Random(3), tree(described)
        assert agreeing(RML, made, one, (random_trace(random, made) for _ in range(40))) == 40


def test_what_no_scenario_can_keep_is_not_tried() -> None:
    """There are 2^30 ways to resolve the gate, and four that keep possible children alone."""
    possible = "event x(p) = { x: p }; top and v v2; v 2of30 [e# ]*3 [f# ]*27; v2 or v; [f# on x(_) when 1 < 0; ]*27"
    for semantics in Semantics:
        assert signs(RML.translate(tree(possible), semantics, limit=20).monitor(), "e2 e0") == "?T"


# -- refusals ----------------------------------------------------------------------------------------------------------

STRINGS = "RML cannot order strings"
REFUSED = [
    (IGNORING, None, PROJECTED, STRINGS, ("ignore",)),
    (ORDERED, 1, PROJECTED, STRINGS, ("b",)),  # by a guard outside the part
    (BOUND.format(c="", Y="Y", when=' when Y < "b"'), None, STRICT, STRINGS, ("b",)),
    (BOUND.format(c="", Y="Y", when=' when not ("b" <= Y)'), None, STRICT, STRINGS, ("b",)),
    (BOUND.format(c=" c", Y="X", when="") + " c on n(Y);", None, SCATTERED, "any event may be skipped", ("a", "b")),
]


@pytest.mark.parametrize(("described", "branch", "semantics", "words", "nodes"), REFUSED)
def test_refusals(described: str, branch: int | None, semantics: Semantics, words: str, nodes: tuple[str, ...]) -> None:
    part = restrict(loads(described), branch=branch)
    with pytest.raises(NotExpressible, match=words) as caught:
        RML.translate(part, semantics)
    assert caught.value.nodes == nodes
    if branch:
        assert agreeing(RML, part, STRICT, (random_trace(Random(seed), part) for seed in range(10))) == 10
