"""Minimal cut sets and sequences against enumerations."""

from itertools import permutations

import pytest
from hypothesis import given, settings

import rvaft
from rvaft.model.nodes import Kind
from rvaft.risk.cut_sets import CutSet, CutSets, Sequenced
from rvaft.risk.model import of_tree
from tests.risk.forms import form, minimal_sets, static_texts


@given(static_texts())
@settings(max_examples=80)
def test_static_trees_equal_an_enumeration(text: str) -> None:
    tree = form(text)
    expected = minimal_sets(tree)
    found = CutSets(tree)
    listed = [frozenset(one.leaves) for one in found.listed()]
    assert set(listed) == expected
    assert len(listed) == found.count == len(expected)
    assert found.complete
    cut = CutSets(tree, order=1)
    assert {frozenset(one.leaves) for one in cut} == {one for one in expected if len(one) <= 1}
    assert not (cut.complete and any(len(one) > 1 for one in expected))


def orders(one: Sequenced) -> set[tuple[str, ...]]:
    if one.orders:
        return set(one.orders)
    return {word for word in permutations(one.events) if all(word.index(a) < word.index(b) for a, b in one.before)}


SEQUENCES = [
    ("t sand a b;", {("a", "b")}),
    ("t or g c; g sand a b;", {("a", "b"), ("c",)}),
    ("t sand g c; g or a b;", {("a", "c"), ("b", "c")}),
    ("t sand a g; g and b c;", {("a", "b", "c"), ("a", "c", "b")}),
    ("t sand_rl a b;", {("b", "a")}),
    (
        "t and g h; g sand a b; h sand c d;",
        {w for w in permutations("abcd") if w.index("a") < w.index("b") and w.index("c") < w.index("d")},
    ),
]


@pytest.mark.parametrize(("text", "words"), SEQUENCES)
def test_sequences_are_those_that_the_monitor_detects(text: str, words: set[tuple[str, ...]]) -> None:
    tree = rvaft.loads(text)
    found = {word for one in CutSets(of_tree(tree)) for word in merged(one)}
    assert found == words
    for word in found:
        watching = rvaft.monitor(tree, semantics="scattered")
        assert [watching.step({"event": name}).final for name in word][-1]


def merged(one: CutSet) -> set[tuple[str, ...]]:
    kept = [orders(part) for part in one.sequences]
    return {
        word
        for word in permutations(one.leaves)
        if all(tuple(name for name in word if name in {*next(iter(some))}) in some for some in kept)
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t pand a b;", {("a", "b")}),
        ("t pand x y; x or a b; y or b c;", {("b",), ("a", "c")}),
        ("t por a b;", {("a",)}),
        ("t pand x y; x or a b; y and a c;", {("a", "c"), ("c", "a")}),
        ("t csp a b; b dorm=0 lambda=1;", {("a", "b")}),
        (
            "t and p q; p wsp a s; q wsp b s; s lambda=1 dorm=0;",
            {("a", "b", "s"), ("a", "s", "b"), ("b", "a", "s"), ("b", "s", "a")},
        ),
    ],
)
def test_sequences_of_galileo(text: str, words: set[tuple[str, ...]]) -> None:
    assert {word for one in CutSets(form(text, galileo=True)) for word in merged(one)} == words


def test_kinds_and_probable_sets() -> None:
    tree = form(
        "t or g h c; g and a b; h and b d; a attack prob=.5; b fault prob=.5; c fault prob=.1; d attack prob=.9;"
    )
    found = CutSets(tree)
    assert found.by_kind() == {frozenset(Kind): 2, frozenset([Kind.FAULT]): 1}
    best = found.most_probable(2, {name: leaf.numbers.chance or 0 for name, leaf in tree.leaves.items()})
    assert [(set(one.leaves), round(p, 9)) for one, p in best] == [({"b", "d"}, 0.45), ({"a", "b"}, 0.25)]


def test_many_sets_are_counted_and_not_listed() -> None:
    pairs = 40
    text = f"t and {' '.join(f'g{n}' for n in range(pairs))}; " + " ".join(f"g{n} or a{n} b{n};" for n in range(pairs))
    found = CutSets(form(text))
    assert found.count == 2**pairs
    assert len(found.listed(3)) == 3
    assert CutSets(form(text), order=5).count == 0
