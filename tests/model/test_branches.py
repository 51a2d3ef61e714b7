"""Branches and restriction, against the enumeration that the reference writes out."""

from dataclasses import replace
from itertools import islice
from random import Random

import pytest

from rvaft import RVAFT, Gate, Kind, Node, TreeError, loads
from rvaft.core.branches import branch, branches, number_of
from rvaft.core.restriction import alternatives, restrict
from rvaft.semantics import branches as listed
from tests.benchmarks.trees import chain

GATES = (Gate.OR, Gate.OR, Gate.OR, Gate.AND, Gate.VOT)


def silly_tree(random: Random, size: int) -> RVAFT:
    """A DAG full of choices and shared nodes; leaves are default events."""
    nodes = []
    for index in range(size):
        later = [f"n{j}" for j in range(index + 1, size)]
        kind = random.choice([None, None, None, *Kind])
        if index < size // 2:
            children = tuple(random.sample(later, min(len(later), random.randint(1, 3))))
            gate = random.choice(GATES)
            threshold = random.randint(1, len(children)) if gate is Gate.VOT else None
            nodes.append(Node(f"n{index}", gate, children, threshold, kind=kind))
        else:
            nodes.append(Node(f"n{index}", kind=kind))
    return RVAFT("n0", nodes)


def choices(tree: RVAFT) -> list[dict[str, str]]:
    return [{n: kept[0] for n, kept in b.items() if tree.nodes[n].gate is Gate.OR} for b in listed(tree)]


def test_branches_are_those_of_the_definition_in_their_order() -> None:
    for seed in range(150):
        tree = silly_tree(Random(seed), 1 + seed % 14)
        found = list(branches(tree))
        assert [dict(b.choices) for b in found] == choices(tree), seed
        assert [b.number for b in found] == list(range(1, len(found) + 1))
        assert all(number_of(tree, b.choices) == b.number for b in found), seed


@pytest.mark.parametrize("kind", Kind)
def test_a_kind_has_exactly_the_branches_that_have_it(kind: Kind) -> None:
    for seed in range(0, 160, 2):
        tree = silly_tree(Random(seed), 1 + seed % 12)
        having = (any(tree.nodes[name].kind is kind for name in b) for b in listed(tree))
        wanted = {frozenset(c.items()) for c, has in zip(choices(tree), having, strict=True) if has}
        if not wanted:
            with pytest.raises(TreeError, match="no branch has the kind"):
                restrict(tree, kind=kind)
            continue
        part = restrict(tree, kind=kind)
        found = {frozenset(branch.items()) for one in alternatives(part) for branch in choices(one)}
        assert found == wanted, seed
        assert part.alphabet == tree.alphabet
        assert wanted <= {frozenset(branch.items()) for branch in choices(part)}


def test_the_or_nearest_the_root_varies_fastest() -> None:
    tree = loads("top or p q; p or a b; q and c;")
    assert [b.formula for b in branches(tree)] == ["a", "c", "b"]


def test_a_long_chain_of_choices() -> None:
    tree = chain(120)
    found = list(branches(tree))
    assert [b.formula for b in found] == [*(f"a{i}" for i in range(120)), "g120"]
    assert branch(tree, 120) == found[119]


def test_paths_without_a_choice_are_no_choices() -> None:
    text = "".join(f"g{i} and a{i} b{i}; a{i} and g{i + 1}; b{i} and g{i + 1};" for i in range(60))
    assert [b.choices for b in branches(loads(f"{text} g60 or x y;"))] == [{"g60": "x"}, {"g60": "y"}]


def test_branches_are_lazy() -> None:
    nodes = [Node("top", Gate.AND, tuple(f"g{i}" for i in range(200)))]
    for i in range(200):
        nodes += [Node(f"g{i}", Gate.OR, (f"a{i}", f"b{i}")), Node(f"a{i}"), Node(f"b{i}")]
    tree = RVAFT("top", nodes)
    assert [b.choices["g1"] for b in islice(branches(tree), 4)] == ["a1", "a1", "b1", "b1"]


@pytest.mark.parametrize("number", [0, -1, 3, 10**9])
def test_a_branch_that_is_not_there(number: int) -> None:
    with pytest.raises(TreeError, match="there is no branch"):
        branch(loads("top or a b;"), number)


def test_a_part_of_a_kind_has_the_nodes_of_all_its_branches() -> None:
    tree = loads("top and p q; p or f a z; q or x b; z or f f2; f fault; x fault; f2 attack;")
    part = restrict(tree, kind="attack")
    assert {name: node.children for name, node in part.nodes.items()} == {
        "top": ("p", "q"),
        "p": ("z",),
        "q": ("x", "b"),
        "z": ("f2",),
        **dict.fromkeys(("x", "b", "f2"), ()),
    }
    part = restrict(tree, kind="fault")
    assert part.nodes == tree.nodes
    assert len(alternatives(part)) > 1
    assert alternatives(tree) == (tree,)


def test_the_part_does_not_equal_the_whole() -> None:
    tree = loads("top or a b;")
    assert restrict(tree) is tree
    assert restrict(tree, branch=1) != RVAFT("top", [replace(tree.nodes["top"], children=("a",)), tree.nodes["a"]])
