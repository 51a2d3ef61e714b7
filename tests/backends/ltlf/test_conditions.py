"""Where the compositional forms are used and where not, each with the trace that tells the two apart."""

from collections.abc import Sequence
from itertools import product

import pytest

from backends.ltlf.composition import (
    Shape,
    always_feasible,
    disjoint_events,
    entangled,
    may_overlap,
    overlaps,
    rivals_apart,
    same_continuation_or_start,
    separable,
    shape_of,
)
from backends.ltlf.parts import parts_of, simplified
from rvaft.api import loads
from rvaft.language.parser import parse_pattern
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.ltlf.building import BACKEND, body, events, needs_spot, text_of, verdicts

E = "event e(p) = {e: p};"


def shape(text: str) -> Shape:
    tree = loads(text)
    patterns: dict[str, Pattern] = {}
    for name in tree.occurrences:
        pattern = tree.pattern(name)
        assert pattern is not None
        patterns[name] = pattern
    return shape_of(simplified(parts_of(tree), monotone=True), patterns)


def whole(text: str) -> tuple[Shape, int, Sequence[int]]:
    found = shape(text)
    return found, found.root, range(found.root + 1)


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [
        ("{a: 1}", "{a: 1.0}", True),
        ("{a: 1}", "{a: true}", False),
        ("{a: 1}", "{b: 1}", True),
        ("{a: X}", "{a: {b: 1}}", True),
        ("{a: 1}", "{a: {b: 1}}", False),
        ("{a: [1, _]}", "{a: [_, 2]}", True),
        ("{a: [1]}", "{a: [1, 2]}", False),
        ("{a: [1]}", "{a: {b: 1}}", False),
        ("{a: _}", "{a: null}", True),
        ("{a: X, b: X}", "{a: 1, b: 2}", True),  # conservative
    ],
)
def test_overlap_of_patterns(left: str, right: str, expected: bool) -> None:
    one, other = parse_pattern(left), parse_pattern(right)
    assert may_overlap(one, other) is expected
    assert may_overlap(other, one) is expected
    assert overlaps([one, other]) == ([0b10, 0b01] if expected else [0, 0])


def test_equal_patterns_overlap() -> None:
    assert overlaps([parse_pattern("{a: 1}")] * 3) == [0b110, 0b101, 0b011]


def test_events_served_by_one_event() -> None:
    apart, root, _ = whole("t and a b;")
    assert rivals_apart(apart, root)
    assert disjoint_events(apart, root)
    rivals, root, _ = whole(f"{E} t and a b; a on e(1); b on e(_);")
    assert not rivals_apart(rivals, root)
    assert not disjoint_events(rivals, root)
    ordered = "t and g c; g sand a b; a on e(1); b on e(1); c on e(2);"
    assert rivals_apart(*whole(f"{E} {ordered}")[:2])


def test_shared_occurrences() -> None:
    found, root, _ = whole("t and a b; a or x s; b or y s;")
    assert entangled(found, root)
    found, root, _ = whole("t or a b; a and x s; b and y s;")
    assert not entangled(found, root)


def test_same_continuation_or_start() -> None:
    good, _, kept = whole("t and a b; a sand x s; b or s y;")  # nothing follows either use
    assert same_continuation_or_start(good.rows, kept)
    good, _, kept = whole("t and a b; a sand s x; b sand s y;")  # nothing precedes either use
    assert same_continuation_or_start(good.rows, kept)
    bad, root, kept = whole("t and a b; a sand x s; b sand s y;")
    assert not same_continuation_or_start(bad.rows, kept)
    assert not separable(bad, root)


def test_infeasible_scenarios() -> None:
    found, root, kept = whole("t sand a b; a or x s; b or y s;")
    assert not always_feasible(found, kept)
    assert not separable(found, root)


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


@pytest.mark.parametrize(("tree", "semantics", "expected"), FORMS)
def test_form(tree: str, semantics: str, expected: list[str]) -> None:
    assert body(text_of(tree, semantics)) == expected


@pytest.mark.parametrize("tree", [tree for tree, _, _ in FORMS] + ["t sand a b; a or x s; b or y s;"])
@pytest.mark.parametrize("semantics", list(Semantics))
@needs_spot[0]
@needs_spot[1]
def test_every_short_word(tree: str, semantics: Semantics) -> None:
    """The trees with the counterexamples, on every word of up to four events."""
    made = loads(tree)
    letters: list[Json] = [{"e": 1}, {"e": 2}] if "event e" in tree else events("b s x y z")
    specification = BACKEND.translate(made, semantics)
    for word in product([*letters, {}], repeat=4):
        expected = list(Reference(made, semantics).run(word))
        assert list(specification.monitor().run(word)) == expected, word


class TestOneEventForOne:
    """What the formulas of the literature get wrong."""

    pytestmark = needs_spot

    def test_one_event_serves_one_occurrence(self) -> None:
        tree = f"{E} t and a b; a on e(1); b on e(_);"
        assert verdicts(text_of(tree, "scattered"), [{"e": 1}, {"e": 2}]) == "?T"
        assert verdicts("/* rvaft\natom a := {e: 1}\natom b := {e: _}\n*/\nF a & F b", [{"e": 1}]) == "T"

    def test_one_occurrence_for_all_uses(self) -> None:
        tree = "t and a b; a sand x s; b sand s y;"
        assert verdicts(text_of(tree, "scattered"), events("s y x s y")) == "????T"

    def test_at_least_k(self) -> None:
        tree = "t sand v d; v 2of3 a b c;"
        assert verdicts(text_of(tree, "strict"), events("a b c d")) == "???T"
        assert verdicts(text_of(tree, "strict"), events("a b d")) == "??T"
        assert verdicts(text_of(tree, "strict"), events("a d")) == "?F"


def test_what_another_part_contains_anyway_is_not_asked_twice() -> None:
    assert body(text_of("t and b s; s sand a b c;", "strict")) == ["a & X[!](b & X[!] c)"]
    assert body(text_of("t and b s; s or b c;", "scattered")) != body(text_of("t and s; s or b c;", "scattered"))
