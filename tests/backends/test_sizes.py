"""Sizes, and what is too large: of every backend, in two tables; how LTLf grows, as Spot counts
too; deep trees, impossible ones.
"""

from contextlib import suppress
from random import Random
from time import process_time
from typing import Any, Final

import pytest

from backends.ltlf.reader import split, spot
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, random_tree
from rvaft import RVAFT, Causality, Gate, Node, Semantics, TooLarge, TreeError, dumps, loads
from rvaft.backend import backend
from rvaft.core.build import build
from rvaft.core.property import parts_below
from rvaft.core.time_order import order_ends
from tests.backends.texts import flat, needs_spot, signs, tree
from tests.tables import rows, sampled


@pytest.mark.parametrize(("name", "text", "semantics", "limit", "what"), sampled(rows(__file__, "limits.txt"), 11))
def test_what_is_too_large(name: str, text: str, semantics: str, limit: int | None, what: str) -> None:
    made, start = tree(text), process_time()
    with pytest.raises(TooLarge) as error:
        backend(name).translate(made, Semantics(semantics), limit=limit)
    assert error.value.what.startswith(what)
    assert error.value.limit == (limit or backend(name).default_limit)
    assert process_time() - start < 5


SIX: Final = """
time t as s; event px(p) = { x: p }; event py(p) = { y: p };
r 2of3 a b c when X <= X within 0 s; a on px(X) times 3; b and d e; d on px(X); e on py(X); c on py(_);
"""
NINE: Final = """
time t as s; r 2of3 a b c within 3 s; a 2of3 d e f within 2 s; b 2of3 f g h within 1 s; c 2of3 d g h within 1 s;
d times 3; e times 3; f times 3; g times 3;
"""


@pytest.mark.slow
@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("text", [SIX, NINE])
@pytest.mark.parametrize("name", ["automaton", "ltlf"])
def test_small_trees_end_within_the_default_limit(name: str, text: str, semantics: Semantics) -> None:
    start = process_time()
    with suppress(TooLarge):
        assert len(backend(name).translate(loads(text), semantics).text) < 12_000_000
    assert process_time() - start < 20


@pytest.mark.ci
@needs_spot
def test_an_event_that_takes_too_many_steps_is_too_large() -> None:
    specification, start = backend("ltlf").translate(loads(NINE), Semantics.SCATTERED), process_time()
    with pytest.raises(TooLarge, match="steps for one event of an LTLf formula"):
        list(specification.monitor().run([{"event": name, "t": 0} for name in "def"]))
    assert process_time() - start < 10


@pytest.mark.parametrize(("name", "text", "semantics", "limit", "sizes"), sampled(rows(__file__, "sizes.txt"), 3))
def test_sizes(name: str, text: str, semantics: str, limit: int | None, sizes: dict[str, int | None]) -> None:
    made, start = tree(text), process_time()
    metrics = backend(name).translate(made, Semantics(semantics), limit=limit).metrics
    assert {size: getattr(metrics, size) for size in sizes} == sizes
    assert process_time() - start < 5


@pytest.mark.parametrize("name", ["ltlf", "rml"])
def test_an_impossible_tree_is_an_error(name: str) -> None:
    nodes = [Node("t", Gate.SAND, ("a", "b")), Node("a", Gate.AND, ("s",)), Node("b", Gate.AND, ("s",)), Node("s")]
    for semantics in Semantics:
        with pytest.raises(TreeError, match="feasible"):
            backend(name).translate(RVAFT("t", nodes), semantics)


@pytest.mark.parametrize("size", [3, 6, 20])
def test_growth_of_ltlf(size: int) -> None:
    def sizes(gate: Gate, k: int | None = None) -> list[int]:
        made = [backend("ltlf").translate(flat(gate, size, k), semantics).metrics for semantics in Semantics]
        return [metrics.subformulas or 0 for metrics in made]

    for k in {None, 2, size // 2, size - 1} - {1}:
        strict, projected, consecutive, scattered = sizes(Gate.VOT if k else Gate.AND, k)
        assert scattered == (k * (2 * (size - k) + 3) if k else 2 * size + 1)
        assert max(strict, projected, consecutive) <= 10 * size * size
    strict, projected, consecutive, scattered = sizes(Gate.SAND)
    assert strict <= 3 * size
    assert max(projected, consecutive) <= 5 * size + 2
    assert scattered <= 4 * size


@pytest.mark.spot
@needs_spot
@pytest.mark.parametrize("semantics", list(Semantics))
def test_spot_counts_the_same_subformulas(semantics: Semantics) -> None:
    """For every gate, and for random trees."""
    random = Random(f"sizes {semantics}")
    gates = [flat(gate, size) for gate in Gate if gate is not Gate.VOT for size in range(1, 5)]
    gates += [flat(Gate.VOT, size, k) for size in range(1, 5) for k in range(1, size + 1)]
    for made in gates + [random_tree(random, shape) for shape in (PLAIN, VARIABLE_FREE) for _ in range(25)]:
        try:
            specification = backend("ltlf").translate(made, semantics, limit=3_000)
        except (TooLarge, TreeError):
            continue
        header, end = split(specification.text)
        known: dict[str, Any] = {}
        for name, definition in header.definitions.items():
            known[name] = expanded(spot().formula(definition), known)
        seen: set[int] = set()
        todo = [expanded(spot().formula(specification.text[end:].strip()), known)]
        while todo:
            formula = todo.pop()
            if formula.id() not in seen:
                seen.add(formula.id())
                todo.extend(formula)
        assert specification.metrics.subformulas == len(seen), f"{semantics}\n{dumps(made)}\n{specification.text}"


def expanded(formula: Any, known: dict[str, Any]) -> Any:
    """Definitions put in where they are used."""
    if formula.kindstr() == "ap":
        return known.get(formula.ap_name(), formula)
    inner = [expanded(operand, known) for operand in formula]
    if formula.kindstr() in {"And", "Or"}:
        return spot().formula.multop(formula.kind(), inner)
    made = spot().formula.unop if len(inner) == 1 else spot().formula.binop
    return made(formula.kind(), *inner) if inner else formula


@pytest.mark.spot
@needs_spot
@pytest.mark.parametrize("semantics", sampled(zip(Semantics), 2))
def test_deep_and_large_trees_run(semantics: Semantics) -> None:
    specification = backend("ltlf").translate(tree("toplevel g0; [g# sand g#' l#; ]*1100"), semantics)
    assert (specification.metrics.subformulas or 0) < 6_600
    word = " ".join(["g1100", *(f"l{i}" for i in reversed(range(1_100)))])
    assert signs(specification.monitor(), word) == "?" * 1_100 + "T"
    size = (
        8 if semantics is Semantics.CONSECUTIVE else 12
    )  # there every set of events that may have begun is told apart
    for gate, threshold, needed in ((Gate.AND, None, size), (Gate.VOT, 6, 6), (Gate.SAND, None, size)):
        for name in ("ltlf", "rml") if semantics.ends else ("ltlf",):
            monitor = backend(name).translate(flat(gate, size, threshold), semantics).monitor()
            assert signs(monitor, " ".join(f"e{i}" for i in range(size))) == "?" * (needed - 1) + "T" * (
                size + 1 - needed
            )


@pytest.mark.parametrize(
    ("text", "sizes"),
    [
        ("[g# pand p# g#'; p# sand a# b#; ]*1000", [5001]),
        ("[g# pand g#' a#; ]*1000 g1000 and x y;", [3004] * 2),
        ("[g# pand a# g#'; ]*1000 g1000 and x y;", [3004] * 2),
    ],
)
def test_the_order_of_ends_in_a_chain_takes_little_time(text: str, sizes: list[int]) -> None:
    made, start = tree(f"toplevel g0; {text}"), process_time()
    assert [len(parts_below(one.root)) for one in order_ends(build(made)).alternatives] == sizes
    assert process_time() - start < 5


@pytest.mark.parametrize("gate", [Gate.AND, Gate.SAND, Gate.SAND_RL, Gate.OR])
def test_a_chain_of_gates_in_rml(gate: Gate) -> None:
    nodes = [Node(f"g{i}", gate, (f"g{i + 1}", f"a{i}") if i % 50 == 0 else (f"g{i + 1}",)) for i in range(1_500)]
    ends = [Node(f"a{i}") for i in range(0, 1_500, 50)]
    for causality in Causality:
        made = RVAFT("g0", [*nodes, *ends, Node("g1500")], causality=causality)
        for semantics in (Semantics.STRICT, Semantics.PROJECTED):
            assert "Main" in backend("rml").translate(made, semantics).text
