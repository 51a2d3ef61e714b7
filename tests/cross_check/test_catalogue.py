"""What the run without arguments looks at."""

from itertools import product

from cross_check.campaign import catalogue
from rvaft.model.nodes import Causality, Gate
from rvaft.rules import require_valid

ENTRIES = list(catalogue())
NODES = [(entry.tree, node) for entry in ENTRIES for node in entry.tree.top_down()]


def test_every_tree_keeps_the_rules_and_has_a_name_of_its_own() -> None:
    for entry in ENTRIES:
        require_valid(entry.tree)
    assert len({(entry.name, entry.branch, entry.kind) for entry in ENTRIES}) == len(ENTRIES)


def test_every_gate_with_one_to_four_children_without_and_with_its_own_event() -> None:
    shapes = {
        (node.gate, len(node.children), node.threshold, tree.causality if node.on else None)
        for tree, node in NODES
        if node.gate is not None and all(tree.nodes[child].leaf for child in node.children)
    }
    votes = {(Gate.VOT, n, k) for n in (1, 2, 3, 4) for k in range(1, n + 1)}
    expected = votes | {(gate, n, None) for gate in Gate if gate is not Gate.VOT for n in (1, 2, 3, 4)}
    assert {(*shape, causality) for shape in expected for causality in (None, *Causality)} <= shapes


def test_every_ordered_pair_of_gates_is_nested_and_under_every_gate_something_is_shared() -> None:
    nested = {(node.gate, tree.nodes[child].gate) for tree, node in NODES for child in node.children}
    assert set(product(Gate, repeat=2)) <= nested
    assert {entry.tree.nodes[entry.tree.root].gate for entry in ENTRIES if entry.tree.shared} == set(Gate)
    events = [
        (node, [tree.pattern(child) for child in node.children if tree.nodes[child].has_event]) for tree, node in NODES
    ]
    assert {node.gate for node, patterns in events if len(set(patterns)) < len(patterns)} == set(Gate)


def test_branches_kinds_and_guards() -> None:
    assert {entry.branch for entry in ENTRIES} >= {1, 2, 3}
    assert {str(entry.kind) for entry in ENTRIES} >= {"fault", "attack"}
    assert any(entry.tree.ignores for entry in ENTRIES)
    guarded = [node for _, node in NODES if node.when is not None]
    assert any(node.gate for node in guarded)
    assert any(node.leaf and node.on is None for node in guarded)
