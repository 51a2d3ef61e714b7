"""Large and deep trees: every rule answers, without recursion and without enumerating anything."""

import pytest

from rvaft.model.guards import Operation, Operator
from rvaft.model.nodes import EventType, Gate, Node, On
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.rules import check_tree

EVENT = EventType("at", ("k", "v"), ObjectPattern((("kind", Variable("k")), ("value", Variable("v")))))


@pytest.mark.parametrize("gate", [Gate.AND, Gate.OR, Gate.SAND, Gate.SAND_RL])
def test_a_chain_of_five_thousand_gates(gate: Gate) -> None:
    nodes = [Node("g5000")]
    for index in range(5000):
        nodes += [Node(f"g{index}", gate, (f"g{index + 1}", f"l{index}")), Node(f"l{index}")]
    assert check_tree(RVAFT("g0", nodes)) == []


def _wide(gate: Gate, count: int, *, same: bool, guarded: bool = False) -> RVAFT:
    nodes = [Node("top", gate, tuple(f"n{i}" for i in range(count)))]
    for index in range(count):
        on = On("at", (Literal("same" if same else f"k{index}"), Variable(f"V{index}") if guarded else Anything()))
        when = Operation(Operator.GT, (Variable(f"V{index}"), Literal(index))) if guarded else None
        nodes.append(Node(f"n{index}", on=on, when=when))
    return RVAFT("top", nodes, [EVENT])


def test_ten_thousand_leaves_told_apart_by_a_field() -> None:
    assert check_tree(_wide(Gate.AND, 10_000, same=False)) == []


def test_ten_thousand_leaves_with_one_event_in_sequence_or_as_alternatives() -> None:
    assert check_tree(_wide(Gate.SAND, 10_000, same=True)) == []
    assert check_tree(_wide(Gate.OR, 10_000, same=True)) == []


def test_two_thousand_guards() -> None:
    assert check_tree(_wide(Gate.SAND, 2_000, same=False, guarded=True)) == []


def test_scenarios_are_not_enumerated() -> None:
    """2 to the 200 branches, with guards on a common variable in each of them."""
    nodes = [
        Node("top", Gate.SAND, ("first", *(f"o{i}" for i in range(200)))),
        Node("first", on=On("at", (Literal(0), Variable("V")))),
    ]
    for index in range(200):
        nodes += [Node(f"o{index}", Gate.OR, (f"a{index}", f"b{index}")), Node(f"b{index}")]
        nodes.append(Node(f"a{index}", when=Operation(Operator.GT, (Variable("V"), Literal(index)))))
    assert check_tree(RVAFT("top", nodes, [EVENT])) == []
