"""The texts are pinned; what some trees mean that only this language finds hard; what is refused."""

from itertools import product
from random import Random

import pytest

from backends.rml import RmlBackend
from cross_check.generate.traces import random_trace
from rvaft.api import loads
from rvaft.core.restriction import restrict
from rvaft.errors import NotExpressible
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.texts import agreeing, signs, tree
from tests.tables import rows
from tests.trees.shipped import TREES

RML = RmlBackend()


def text(described: str, semantics: str = "strict") -> str:
    return RML.translate(tree(described), Semantics(semantics)).text


def equations(described: str, semantics: str = "strict") -> str:
    return text(described, semantics).strip().rpartition("\n\n")[2]


@pytest.mark.parametrize(("gate", "strict", "scattered"), rows(__file__, "gates.txt"))
def test_each_gate(gate: str, strict: str, scattered: str) -> None:
    assert equations(f"top {gate};") == strict
    body = strict.removeprefix("Main = ").removesuffix(";")
    assert equations(f"top {gate};", "projected") == f"Main = relevant >> ({body});"
    assert equations(f"top {gate};", "scattered") == scattered


ABSENT = 'event e(n, u) = { event: n, u: u }; a on e("a", _); b on e("b", _); toplevel top; top sand a b without '
ABSENCES = [
    ('e("c", _);', r"S1 = (a S2) \/ (any S1); S2 = (b all) \/ (top_absent S1) \/ (any S2);"),
    ('e("c", _) before;', r"S1 = (a S2) \/ (top_absent S3) \/ (any S1); S2 = (b all) \/ (any S2); S3 = any S3;"),
    ('e("c", V) when V > 1;', r"S1 = (a S2) \/ (any S1); S2 = (b all) \/ (top_absent_top S1) \/ (any S2);"),
    ('e("a", _);', r"S1 = (a S2) \/ (any S1); S2 = (b all) \/ (any S2);"),
]
"""Absent events between `a` and `b`, or before them, and the equations."""


def absent_words() -> list[list[Json]]:
    """Words of four letters, of which `d` is a `c` with a greater number."""
    return [
        [{"event": "c", "u": 2} if letter == "d" else {"event": letter, "u": 1} for letter in word]
        for word in product("abcdx", repeat=4)
    ]


@pytest.mark.parametrize(("clause", "written"), ABSENCES)
def test_absent_events(clause: str, written: str) -> None:
    made, words = loads(ABSENT + clause), absent_words()
    text = RML.translate(made, Semantics.SCATTERED).text
    wanted = [[*Reference(made, Semantics.SCATTERED).run(word)] for word in words]
    assert [[*RML.read(text).run(word)] for word in words] == wanted
    assert text.partition("Main = ")[2].split() == ["S1;", *written.split()]


@pytest.mark.parametrize(
    ("clause", "old", "new"),
    [
        ('e("c", _);', r"(top_absent S1) \/ ", ""),
        ('e("c", _);', "(top_absent S1)", "(top_absent S2)"),
        ('e("c", _);', "e('c', _)", "e('d', _)"),
        ('e("c", _) before;', "(top_absent S3)", "(top_absent S1)"),
        ('e("c", _) before;', r"(b all) \/ (any S2)", r"(b all) \/ (top_absent S3) \/ (any S2)"),
        ('e("c", V) when V > 1;', "top_absent_top S1", "top_absent_top S2"),
    ],
)
def test_a_fault_in_absent_events_is_found(clause: str, old: str, new: str) -> None:
    made, words = loads(ABSENT + clause), absent_words()
    text = RML.translate(made, Semantics.SCATTERED).text
    assert old in text
    wanted = [[*Reference(made, Semantics.SCATTERED).run(word)] for word in words]
    assert [[*RML.read(text.replace(old, new)).run(word)] for word in words] != wanted


@pytest.mark.parametrize(("why", "described", "expected"), rows(__file__, "equations.txt"))
def test_equations(why: str, described: str, expected: str) -> None:
    assert equations(described) == expected, why


def test_what_a_failed_beginning_leaves_is_followed() -> None:
    """Under `consecutive`: after `a b a`, another `b` goes on from the second `a`."""
    made = text('event e(n) = { event: n }; top sand a b a2 c; a2 on e("a");', "consecutive").splitlines()
    assert made[-5:] == [
        "Main = relevant >> S1;",
        "S1 = (a S2) \\/ (any S1);",
        "S2 = (a S2) \\/ (b S3) \\/ (any S1);",
        "S3 = (a S4) \\/ (any S1);",
        "S4 = (c all) \\/ (a S2) \\/ (b S3) \\/ (any S1);",
    ]


def test_the_whole_text() -> None:
    assert text("top or a b;", "projected") == (
        "// The attack-fault tree top under the semantics projected.\n\n"
        "a matches { 'event': 'a' };\n"
        "b matches { 'event': 'b' };\n"
        "relevant matches a | b;\n\n"
        "Main = relevant >> ((a \\/ b) all);\n"
    )


@pytest.mark.parametrize(("described", "expected"), rows(__file__, "lines.txt"))
def test_lines(described: str, expected: list[str]) -> None:
    inspection = (TREES / "remote_inspection" / "pruned.rvaft").read_text(encoding="utf-8")
    assert set(expected) <= set(text(described.replace("INSPECTION", inspection), "projected").splitlines())


def test_the_limit_does_not_choose_the_form() -> None:
    made = loads("top 3of6 a b c d e f;")
    assert {RML.translate(made, Semantics.STRICT, limit=limit).text for limit in (60, 120, 20_000)} == {
        text("top 3of6 a b c d e f;")
    }


def test_no_text_needs_what_the_monitor_in_rosmonitoring_lacks() -> None:
    found = equations("top 70of90 [e# ]*90;")
    assert found.count("any") == 70
    assert "{" not in found


@pytest.mark.parametrize(("why", "described", "semantics"), rows(__file__, "meant.txt"))
def test_more_by_hand(why: str, described: str, semantics: list[str]) -> None:
    for one in semantics:
        random, made = Random(3), tree(described)
        traces = [random_trace(random, made) for _ in range(40)]
        assert agreeing(RML, made, Semantics(one), traces) == 40, why


@pytest.mark.parametrize("guard", ["X + 1 != Y", "Y != abs(X)", "not (X / 2 == Y)", "X + 1 in (2, true) or Y == false"])
def test_a_calculated_number_beside_a_value_of_any_type(guard: str) -> None:
    made = loads(f"event e(x, y) = {{ x: x, y: y }}; top sand a b; a on e(X, Y) when {guard}; b;")
    values: list[Json] = [0, 1, 2, "a", "2", True, False, None, []]
    written = RmlBackend().translate(made, Semantics.STRICT)
    found = set()
    for x, y in product(values, repeat=2):
        trace: list[Json] = [{"x": x, "y": y}, {"event": "b"}]
        expected = signs(Reference(made, Semantics.STRICT), trace)
        assert signs(written.monitor(), trace) == expected, (guard, x, y)
        found.add(expected)
    assert len(found) == 2


def test_what_no_scenario_can_keep_is_not_tried() -> None:
    """There are 2^30 ways to resolve the gate, and four that keep possible children alone."""
    possible = "event x(p) = { x: p }; top and v v2; v 2of30 [e# ]*3 [f# ]*27; v2 or v; [f# on x(_) when 1 < 0; ]*27"
    for semantics in Semantics:
        assert signs(RML.translate(tree(possible), semantics, limit=20).monitor(), "e2 e0") == "?T"


# -- refusals ----------------------------------------------------------------------------------------------------------


WINDOW = (
    "time t as ms; event e(k: text, t: integer) = { ev: 1, k: k, t: t }; assume types, present, exact; "
    'top sand p c; p and a b within 2 s; a on e("a", _); b on e("b", T); c on e("c", _);'
)


@pytest.mark.parametrize("semantics", ["strict", "projected"])
@pytest.mark.parametrize("bound", [2000, 1999, 2001])
def test_windows_over_integer_times(semantics: str, bound: int) -> None:
    """A window one unit off shows."""
    windowed, random = loads(WINDOW), Random("window")
    made = RML.translate(windowed, Semantics(semantics))
    assert made.assumes == windowed.assumes
    text = made.text.replace("<= 2000", f"<= {bound}")
    assert text.count(f" <= {bound}") > 0
    same = True
    for _ in range(150):
        start = random.choice([0, 7])
        times = [start, start + random.choice([1999, 2000, 2001, -2000, -2001]), start]
        trace: list[Json] = [
            {"ev": 1, "k": k, "t": t} for k, t in zip(random.choice(["abc", "bac", "acb"]), times, strict=True)
        ]
        monitor = RML.read(text)
        same &= [monitor.step(event) for event in trace] == [*Reference(windowed, Semantics(semantics)).run(trace)]
    assert same is (bound == 2000)


@pytest.mark.parametrize(("described", "branch", "semantics", "words", "nodes"), rows(__file__, "refused.txt"))
def test_refusals(described: str, branch: int | None, semantics: str, words: str, nodes: list[str]) -> None:
    part = restrict(loads(described), branch=branch)
    with pytest.raises(NotExpressible, match=words) as caught:
        RML.translate(part, Semantics(semantics))
    assert caught.value.nodes == tuple(nodes)
    if branch:
        assert agreeing(RML, part, Semantics.STRICT, (random_trace(Random(seed), part) for seed in range(10))) == 10
