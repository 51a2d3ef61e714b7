"""Limits, depth, and that translating needs no tool."""

import subprocess
import sys

import pytest

from backends.automaton import AutomatonBackend
from rvaft.api import loads
from rvaft.errors import TooLarge
from rvaft.model.nodes import Causality, EventType, Gate, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

EVENT = EventType("e", ("n",), ObjectPattern((("event", Variable("n")),)))


def leaves(many: int) -> str:
    return " ".join(f"a{index}" for index in range(many))


@pytest.mark.parametrize("semantics", list(Semantics))
def test_too_many_states(semantics: Semantics) -> None:
    tree = loads(f"toplevel r; r and {leaves(200)};")
    with pytest.raises(TooLarge, match="states of the automaton") as error:
        AutomatonBackend().translate(tree, semantics, limit=500)
    assert error.value.limit == 500


def test_too_many_edges() -> None:
    fields = " ".join(f"event f{i}() = {{ f{i}: 1 }}; a{i} on f{i}();" for i in range(40))
    tree = loads(
        f"{fields} toplevel r; r sand g h; g and {leaves(20)}; h or {' '.join(f'a{i}' for i in range(20, 40))};"
    )
    with pytest.raises(TooLarge, match="of the automaton") as error:
        AutomatonBackend().translate(tree, Semantics.STRICT, limit=1000)
    assert error.value.limit == 1000


OVERLAPPING = f"{' '.join(f'event f{i}() = {{ f{i}: 1 }};' for i in range(6))} top and {leaves(6)}; " + " ".join(
    f"a{i} on f{i}();" for i in range(6)
)


@pytest.mark.parametrize(
    ("semantics", "states"), [pytest.param(Semantics.STRICT, 3764, marks=pytest.mark.slow), (Semantics.SCATTERED, 3763)]
)
def test_overlapping_events_within_the_default_limit(semantics: Semantics, states: int) -> None:
    """Every event may be any of 64 letters; what bites is the number of edges, not how long it takes to find them."""
    assert AutomatonBackend().translate(loads(OVERLAPPING), semantics).metrics.states == states
    with pytest.raises(TooLarge, match="edges of the automaton, 10 allowed for each state") as error:
        AutomatonBackend().translate(loads(OVERLAPPING), semantics, limit=4000)
    assert error.value.limit == 4000


@pytest.mark.parametrize(("gate", "semantics"), [("and", Semantics.STRICT), ("60of120", Semantics.SCATTERED)])
def test_work_is_limited_and_not_only_its_result(gate: str, semantics: Semantics) -> None:
    """Identical leaves make few states, each of very many configurations."""
    on = " ".join(f"a{index} on e();" for index in range(120))
    tree = loads(f"event e() = {{ e: 1 }}; toplevel r; r {gate} {leaves(120)}; {on}")
    with pytest.raises(TooLarge, match="steps of the construction, 1000 allowed for each state"):
        AutomatonBackend().translate(tree, semantics, limit=100)


def test_the_name_of_a_semantics_will_do() -> None:
    tree = loads("top and a b;")
    for semantics in Semantics:
        named = AutomatonBackend().translate(tree, semantics.value)  # type: ignore[arg-type]
        assert named.text == AutomatonBackend().translate(tree, semantics).text


def test_too_many_choices_between_shared_parts() -> None:
    gates = " ".join(f"g{i} or s a{i};" for i in range(40))
    tree = loads(f"toplevel r; r and {' '.join(f'g{i}' for i in range(40))}; {gates}")
    with pytest.raises(TooLarge, match="choices"):
        AutomatonBackend().translate(tree, Semantics.SCATTERED, limit=1000)


def test_the_limit_can_be_raised() -> None:
    tree = loads(f"toplevel r; r and {leaves(7)};")
    with pytest.raises(TooLarge):
        AutomatonBackend().translate(tree, Semantics.SCATTERED, limit=100)
    assert AutomatonBackend().translate(tree, Semantics.SCATTERED, limit=200).metrics.states == 129


def chain(depth: int, gate: Gate, *, event: bool, leaf: bool, causality: Causality = Causality.TOP_DOWN) -> RVAFT:
    """A gate below a gate below a gate, with an event on each gate, or a leaf beside each, or neither."""
    nodes = []
    for index in range(depth):
        children = (f"a{index}", f"n{index + 1}") if leaf else (f"n{index + 1}",)
        on = On("e", (Literal(index),)) if event else None
        nodes.append(Node(f"n{index}", gate, children, on=on))
        nodes += [Node(f"a{index}")] if leaf else []
    return RVAFT("n0", [*nodes, Node(f"n{depth}")], [EVENT], causality=causality)


@pytest.mark.parametrize("semantics", list(Semantics))
def test_a_chain_of_gates(semantics: Semantics) -> None:
    metrics = AutomatonBackend().translate(chain(5000, Gate.AND, event=False, leaf=False), semantics).metrics
    assert metrics.states == (4 if semantics is Semantics.STRICT else 3)


def test_a_chain_of_sequences() -> None:
    metrics = AutomatonBackend().translate(chain(5000, Gate.SAND, event=False, leaf=True), Semantics.SCATTERED).metrics
    assert metrics.states == 5001 + 2


@pytest.mark.parametrize("causality", list(Causality))
def test_a_chain_of_gates_with_events(causality: Causality) -> None:
    tree = chain(800, Gate.AND, event=True, leaf=False, causality=causality)
    assert AutomatonBackend().translate(tree, Semantics.STRICT).metrics.states == 801 + 3


def test_a_chain_of_alternatives_after_events() -> None:
    tree = chain(200, Gate.OR, event=True, leaf=True)
    assert AutomatonBackend().translate(tree, Semantics.STRICT).metrics.states == 201 + 3


def test_translating_does_not_import_spot() -> None:
    program = (
        "import sys\nfrom rvaft import loads\nfrom backends.automaton import AutomatonBackend\n"
        "AutomatonBackend().translate(loads('toplevel r; r and a b;'), 'projected')\n"
        "assert not {'spot', 'buddy', 'sympy', 'rich', 'hypothesis'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
