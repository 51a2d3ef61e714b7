"""Limits, and depth."""

import pytest

from backends.automaton import AutomatonBackend
from rvaft.api import loads
from rvaft.errors import TooLarge
from rvaft.model.nodes import Causality, EventType, Gate, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

EVENT = EventType("e", ("n",), ObjectPattern((("event", Variable("n")),)))


def leaves(many: int, start: int = 0) -> str:
    return " ".join(f"a{index}" for index in range(start, start + many))


def apart(many: int) -> str:
    """Events that may come together."""
    return " ".join(f"event f{i}() = {{ f{i}: 1 }}; a{i} on f{i}();" for i in range(many))


IDENTICAL = f"event e() = {{ e: 1 }}; {' '.join(f'a{index} on e();' for index in range(120))} r"
SHARED = f"r and {' '.join(f'g{i}' for i in range(40))}; {' '.join(f'g{i} or s a{i};' for i in range(40))}"
STEPS = "steps of the construction, 1000 allowed for each state"


@pytest.mark.parametrize(
    ("tree", "semantics", "limit", "what"),
    [
        *((f"r and {leaves(200)};", semantics, 500, "states of the automaton") for semantics in Semantics),
        (f"{apart(40)} r sand g h; g and {leaves(20)}; h or {leaves(20, 20)};", "strict", 1000, "of the automaton"),
        (f"{apart(5)} r and {leaves(5)};", "scattered", 450, "edges of the automaton, 10 allowed for each state"),
        # Identical leaves make few states, each of very many configurations; work is limited, and not only its result.
        (f"{IDENTICAL} and {leaves(120)};", "strict", 100, STEPS),
        (f"{IDENTICAL} 60of120 {leaves(120)};", "scattered", 100, STEPS),
        (SHARED, "scattered", 1000, "ways to decide choices between parts that share nodes"),
        (f"r and {leaves(7)};", "scattered", 100, "states of the automaton"),
    ],
)
def test_what_is_too_large(tree: str, semantics: str, limit: int, what: str) -> None:
    with pytest.raises(TooLarge, match=what) as error:
        AutomatonBackend().translate(loads(f"toplevel r; {tree}"), Semantics(semantics), limit=limit)
    assert error.value.limit == limit


def test_a_deep_tree_is_refused_before_long() -> None:
    """What a choice costs grows with its depth and the size of the tree, and is counted so."""
    gates = (f"g{n} {'or' if n % 2 else 'and'} g{n + 1} a{n};" for n in range(3000))
    with pytest.raises(TooLarge, match=STEPS):
        AutomatonBackend().translate(loads(f"toplevel g0; {' '.join(gates)}"), Semantics.STRICT)


@pytest.mark.parametrize(
    ("tree", "semantics", "limit", "states"),
    [
        (f"r and {leaves(7)};", "scattered", 200, 129),
        # Every event may be any of 32 or 64 letters; what bites is the number of edges, not how long it takes to find them.
        (f"{apart(5)} r and {leaves(5)};", "strict", None, 408),
        (f"{apart(5)} r and {leaves(5)};", "scattered", None, 407),
        pytest.param(f"{apart(6)} r and {leaves(6)};", "strict", None, 3764, marks=pytest.mark.slow),
        *((f"r and {leaves(10)};", semantics, None, 1025 + (semantics != "scattered")) for semantics in Semantics),
    ],
)
def test_sizes(tree: str, semantics: str, limit: int | None, states: int) -> None:
    metrics = AutomatonBackend().translate(loads(f"toplevel r; {tree}"), Semantics(semantics), limit=limit).metrics
    assert metrics.states == states


def test_the_name_of_a_semantics_will_do() -> None:
    tree = loads("top and a b;")
    for semantics in Semantics:
        named = AutomatonBackend().translate(tree, semantics.value)  # type: ignore[arg-type]
        assert named.text == AutomatonBackend().translate(tree, semantics).text


def chain(depth: int, gate: Gate, *, event: bool, leaf: bool, causality: Causality = Causality.TOP_DOWN) -> RVAFT:
    """A gate below a gate below a gate, with an event on each gate, or a leaf beside each, or neither."""
    nodes = []
    for index in range(depth):
        children = (f"a{index}", f"n{index + 1}") if leaf else (f"n{index + 1}",)
        on = On("e", (Literal(index),)) if event else None
        nodes.append(Node(f"n{index}", gate, children, on=on))
        nodes += [Node(f"a{index}")] if leaf else []
    return RVAFT("n0", [*nodes, Node(f"n{depth}")], [EVENT], causality=causality)


@pytest.mark.parametrize(
    ("tree", "semantics", "states"),
    [
        (chain(5000, Gate.AND, event=False, leaf=False), "strict", 4),
        (chain(5000, Gate.AND, event=False, leaf=False), "projected", 3),
        (chain(5000, Gate.AND, event=False, leaf=False), "scattered", 3),
        (chain(5000, Gate.SAND, event=False, leaf=True), "scattered", 5003),
        (chain(800, Gate.AND, event=True, leaf=False), "strict", 804),
        (chain(800, Gate.AND, event=True, leaf=False, causality=Causality.BOTTOM_UP), "strict", 804),
        (chain(200, Gate.OR, event=True, leaf=True), "strict", 204),
    ],
    ids=str,
)
def test_chains(tree: RVAFT, semantics: str, states: int) -> None:
    assert AutomatonBackend().translate(tree, Semantics(semantics)).metrics.states == states
