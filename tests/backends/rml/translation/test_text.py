"""The text of each gate, pinned; and what a reader of the whole text sees."""

import pytest

from backends.rml import RmlBackend
from rvaft.api import loads
from rvaft.model.verdict import Semantics
from tests.tables import rows
from tests.trees.shipped import TREES

GATES = rows(__file__, "gates.txt")


def text(tree: str, semantics: str) -> str:
    return RmlBackend().translate(loads(tree), Semantics(semantics)).text


def equations(tree: str, semantics: str) -> str:
    return text(tree, semantics).strip().rpartition("\n\n")[2]


@pytest.mark.parametrize(("gate", "strict", "scattered"), GATES)
def test_each_gate(gate: str, strict: str, scattered: str) -> None:
    assert equations(f"top {gate};", "strict") == strict
    body = strict.removeprefix("Main = ").removesuffix(";")
    assert equations(f"top {gate};", "projected") == f"Main = relevant >> ({body});"
    assert equations(f"top {gate};", "scattered") == scattered


def test_the_whole_text() -> None:
    assert text("top or a b;", "projected") == (
        "// The attack-fault tree top under the semantics projected.\n\n"
        "a matches { 'event': 'a' };\n"
        "b matches { 'event': 'b' };\n"
        "relevant matches a | b;\n\n"
        "Main = relevant >> ((a \\/ b) all);\n"
    )


def test_vot_over_many_leaves_is_a_counted_shuffle() -> None:
    leaves = [f"a{i}" for i in range(12)]
    found = equations(f"top sand v z; v 6of12 {' '.join(leaves)};", "strict")
    assert found == f"Main = (({' | '.join(f'{leaf}?' for leaf in leaves)}) /\\ ({'any ' * 6}any*)) z all;"


def test_vot_over_compound_children_counts_one_event_of_each() -> None:
    leaves = [f"a{i}" for i in range(12)]
    text_ = text(f"top 6of13 s {' '.join(leaves)}; s sand x y;", "strict")
    assert f"(top_counted >> ({'any ' * 6}any*))" in text_
    assert f"top_counted matches x | {' | '.join(leaves)};" in text_
    assert "((x y)? | a0?" in text_


def test_a_shuffle_never_stands_behind_a_name() -> None:
    """`a (b | c)` is an event type with a pattern for its argument."""
    assert equations("top sand a x; x and b c;", "strict") == "Main = a P1 all;\nP1 = b | c;"


def test_overlapping_events_are_told_apart_by_the_larger_set_first() -> None:
    tree = "event p(x) = { x: x }; event q(y) = { y: y }; top and m n; m on p(1); n on q(1);"
    assert equations(tree, "strict") == "Main = ((m /\\ n) (n \\/ m) all) \\/ (m n all) \\/ (n m all);"


def test_an_at_least_then_something() -> None:
    assert equations("top sand v d; v 1of2 a b;", "strict") == (
        "Main = (a ((d all) \\/ (b S1))) \\/ (b ((d all) \\/ (a S1)));\nS1 = d all;"
    )


def test_remote_inspection() -> None:
    found = text((TREES / "remote_inspection" / "pruned.rvaft").read_text(encoding="utf-8"), "projected")
    assert found.strip().rpartition("\n\n")[2] == (
        "Main = relevant >> { let waypoint, t1, newWp, t2, mBGoal; (ev1(waypoint) \\/ ev2(waypoint)) inspect(waypoint) "
        "ev4_ev5(t1) (((ev6_ev8(newWp, t2, t1) all) /\\ (ev7 all)) \\/ ((move(newWp, t2) /\\ ev7) "
        "((goal(mBGoal) all) /\\ (ev10(newWp) all)))) };"
    )
    for line in (
        "ev4_ev5(t) matches radiation(v, t) with v >= 250;",
        "ev6_ev8(wp, t, t1) matches move(wp, t) with t >= (t1 + 10);",
        "ev7 not matches move('entrance', _);",
        "ev10(wp) not matches goal(wp);",
        "relevant matches move(_, _) | result(_, 'success') | inspect(_) | radiation(_, _) | goal(_);",
    ):
        assert line in found.splitlines()


@pytest.mark.parametrize(
    ("literal", "expected"),
    [
        ("1", "(1 | 1.0)"),
        ("1.5", "1.5"),
        ("1e3", "(1000 | 1000.0)"),
        ("1e-3", "0.001"),
        ("true", "true"),
        ("null", "null"),
        ('"it\'s\\n\\\\"', "'it\\'s\\n\\\\'"),
        ('"1"', "'1'"),
    ],
)
def test_literals_in_patterns(literal: str, expected: str) -> None:
    found = text(f"event e() = {{ v: {literal} }}; top and a; a on e();", "strict")
    assert f"e matches {{ 'v': {expected} }};" in found


@pytest.mark.parametrize(
    ("literal", "expected"),
    [
        ("-1", ["e(number) matches { 'v': number };", "a matches e(-1) | e(-1.0);"]),
        ("-1.5", ["e(number) matches { 'v': number };", "a matches e(-1.5);"]),
        (
            "9007199254740993",
            [
                "e(number) matches { 'v': number };",
                "a matches e(number) with number == ((9007199 * 1000000000) + 254740993);",
            ],
        ),
    ],
)
def test_literals_that_no_pattern_can_hold(literal: str, expected: list[str]) -> None:
    found = text(f"event e() = {{ v: {literal} }}; top and a; a on e();", "strict")
    assert set(expected) <= set(found.splitlines())


@pytest.mark.parametrize(
    "name", ["all", "any", "with", "Main", "été", "A b", "a-b", "1", "_", "matches", "min", "S1", "not_a"]
)
def test_any_name_gives_a_legal_one(name: str) -> None:
    made = RmlBackend().translate(loads(f'top sand "{name}" a b "{name} "; b or c d;'), Semantics.SCATTERED)
    monitor = made.monitor()
    verdicts = [monitor.step({"event": word}).value for word in (name, "a", "c", f"{name} ")]
    assert verdicts == ["unknown", "unknown", "unknown", "true"]


def test_metrics() -> None:
    """Of the text: `states` are its equations, `Main` included."""
    for tree, semantics, symbols, equations_ in [
        ("top and a b c;", "strict", 11, 1),
        ("top 2of3 a b c;", "projected", 36, 1),
        ("top 2of3 a b c;", "scattered", 74, 5),
        ("top sand a x; x and b c;", "strict", 12, 2),
    ]:
        metrics = RmlBackend().translate(loads(tree), Semantics(semantics)).metrics
        assert (metrics.symbols, metrics.states) == (symbols, equations_)
        assert equations(tree, semantics).count(" = ") == equations_


def test_the_limit_does_not_choose_the_form() -> None:
    tree = loads("top 3of6 a b c d e f;")
    texts = {RmlBackend().translate(tree, Semantics.STRICT, limit=limit).text for limit in (60, 120, 20_000)}
    assert texts == {text("top 3of6 a b c d e f;", "strict")}


def test_no_text_needs_what_the_monitor_in_rosmonitoring_lacks() -> None:
    found = equations("top 70of90 " + " ".join(f"e{i}" for i in range(90)) + ";", "strict")
    assert found.count("any") == 70
    assert "{" not in found
