"""The normal form of a tree has the scenarios that the reference enumerates: occurrences, precedence, guards."""

from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import combinations, islice
from random import Random
from typing import TypeAlias

import pytest

from rvaft.analysis.normal_form import NormalForm, Op, normal_form
from rvaft.analysis.plain_trees import is_plain
from rvaft.core.branches import branches, restrict
from rvaft.model.guards import Operation, Operator, variables
from rvaft.model.nodes import Gate, Node
from rvaft.model.patterns import Literal
from rvaft.model.tree import RVAFT
from rvaft.semantics import feasible_scenarios
from tests.core.trees import random_tree, small_trees

Meaning: TypeAlias = tuple[frozenset[str], frozenset[tuple[str, str]], frozenset[str]]
"""Occurrences, pairs of them of which the first comes first, nodes with a guard over variables."""


def of_reference(tree: RVAFT) -> set[Meaning]:
    return {
        (
            scenario.occurrences,
            frozenset((a, b) for b, earlier in scenario.before.items() for a in earlier),
            frozenset(node.name for node in scenario.nodes if node.when is not None and variables(node.when)),
        )
        for scenario in feasible_scenarios(tree)
    }


def resolved(form: NormalForm) -> Iterator[NormalForm]:
    """All ways to make the choices, the part nearest the root first."""
    for number in reversed(form.kept()):
        part = form.parts[number]
        if part.op in (Op.ONE, Op.AT_LEAST):
            for size in [1] if part.op is Op.ONE else range(part.need, len(part.parts) + 1):
                for chosen in combinations(part.parts, size):
                    yield from resolved(form.resolve(number, chosen))
            return
    yield form


def of_form(form: NormalForm) -> set[Meaning]:
    found = set()
    for scenario in resolved(form):
        inside: dict[int, frozenset[str]] = {}
        pairs: set[tuple[str, str]] = set()
        kept = scenario.kept()
        for number in kept:
            part = scenario.parts[number]
            below = [inside[inner] for inner in part.parts]
            inside[number] = frozenset([part.node]) if part.op is Op.EVENT else frozenset().union(*below)
            if part.op is Op.SEQUENCE:
                pairs |= {(a, b) for early, late in combinations(below, 2) for a in early for b in late}
        events = inside[scenario.root]
        for middle in events:
            into, out = ([a for a, b in pairs if b == middle], [b for a, b in pairs if a == middle])
            pairs |= {(a, b) for a in into for b in out}
        if not any(a == b for a, b in pairs):
            conditions = {scenario.parts[number].node for number in kept if scenario.parts[number].op is Op.CONDITION}
            found.add((events, frozenset(pairs), frozenset(conditions)))
    return found


def check(tree: RVAFT) -> None:
    if not is_plain(tree):  # of such a tree the plain ones have a normal form
        return
    form = normal_form(tree)
    assert of_form(form) == of_reference(tree), (tree, tree.nodes)
    assert all(inner < number for number, part in enumerate(form.parts) for inner in part.parts)
    conditions = Counter(part.node for part in form.parts if part.op is Op.CONDITION)
    assert all(count == 1 for count in conditions.values())


@pytest.mark.parametrize(("most", "count"), [(3, 400), pytest.param(4, 4_000, marks=pytest.mark.slow)])
def test_all_small_trees_and_random_graphs(most: int, count: int) -> None:
    random = Random(most)
    for size in range(1, most + 1):
        for tree in islice(small_trees(size), 0, None, 5 if size == 4 else 1):
            check(tree)
    for tree in (random_tree(random) for _ in range(count)):
        check(tree)


def test_choices_leave_the_branch() -> None:
    random = Random(3)
    trees = (tree for tree in iter(partial(random_tree, random), None) if is_plain(tree) and feasible_scenarios(tree))
    for tree in islice(trees, 100):
        for branch in islice(branches(tree), 5):
            assert of_form(normal_form(tree, branch.choices)) == of_reference(restrict(tree, branch=branch.number))


def test_as_written_keeps_constant_guards_and_thresholds() -> None:
    random = Random(4)
    for tree in [random_tree(random, constants=0.6) for _ in range(100)]:
        form = normal_form(tree, as_written=True)
        assert [part.node for part in form.parts if part.op is Op.CONDITION] == [
            node.name for node in tree.bottom_up() if node.when is not None
        ]
        votes = [part for part in form.parts if part.op is Op.AT_LEAST]
        assert len(votes) == sum(node.gate is Gate.VOT for node in tree.top_down())


def test_what_a_false_guard_makes_impossible_is_gone() -> None:
    false = Operation(Operator.LT, (Literal(2), Literal(1)))
    nodes = [Node("top", Gate.VOT, ("a", "b", "c"), 2), Node("a", when=false), Node("b"), Node("c")]
    form = normal_form(RVAFT("top", nodes))
    assert form.parts[form.root].op is Op.ALL
    assert len(form.kept()) == 3
    nodes[2] = Node("b", when=false)
    assert not normal_form(RVAFT("top", nodes)).feasible
