"""Sizes in distinct subformulas, as Spot counts them too; limits, depth, hostile trees, and what happens without Spot."""

import contextlib
import sys
from random import Random
from time import process_time
from typing import Any

import pytest

from backends.ltlf.reader import split, spot
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, random_tree
from rvaft.api import loads
from rvaft.errors import TooLarge, ToolMissing, TreeError
from rvaft.language.printer import dumps
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from tests.backends.ltlf.building import BACKEND, events, flat, needs_spot


def subformulas(tree: RVAFT, semantics: Semantics) -> int:
    found = BACKEND.translate(tree, semantics).metrics.subformulas
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("tree", "semantics", "listed"),
    [
        ("top and a b c;", "scattered", "a b c, Fa, Fb, Fc, all"),
        ("top sand a b;", "strict", "a b, X[!]b, all"),
        ("top sand a b c;", "scattered", "a b c, Fc, X[!]Fc, b&…, F…, X[!]…, a&…, all"),
        ("top 2of3 a b c;", "scattered", "a b c, Fa, Fb, Fc, b|c, a&(b|c), b&c, all"),
        ("top and x c; x and a b;", "scattered", "a b c, Fa, Fb, Fc, all"),
        ("top or x y; x and a b; y and b a;", "scattered", "a b, Fa, Fb, all"),
    ],
)
def test_by_hand(tree: str, semantics: str, listed: str) -> None:
    assert subformulas(loads(tree), Semantics(semantics)) == len(listed.split())


@pytest.mark.parametrize("size", [3, 6, 12, 30])
def test_growth(size: int) -> None:
    both = (Semantics.STRICT, Semantics.PROJECTED)
    assert subformulas(flat(Gate.AND, size), Semantics.SCATTERED) == 2 * size + 1
    for k in {2, size // 2, size - 1} - {1}:
        assert subformulas(flat(Gate.VOT, size, k), Semantics.SCATTERED) == k * (2 * (size - k) + 3)
        assert all(subformulas(flat(Gate.VOT, size, k), semantics) <= 10 * size * size for semantics in both)
    assert all(subformulas(flat(Gate.AND, size), semantics) <= 10 * size * size for semantics in both)
    assert subformulas(flat(Gate.SAND, size), Semantics.STRICT) <= 3 * size
    assert subformulas(flat(Gate.SAND, size), Semantics.SCATTERED) <= 4 * size
    assert subformulas(flat(Gate.SAND, size), Semantics.PROJECTED) <= 5 * size + 2


def test_what_follows_is_shared() -> None:
    tree = loads("t sand v z; v 6of12 a b c d e f g h i j k l; z and p q r;")
    assert subformulas(tree, Semantics.SCATTERED) < 200
    assert subformulas(tree, Semantics.STRICT) < 2_000


@pytest.mark.parametrize(
    ("semantics", "symbols"),
    [
        ("scattered", "F a & F b"),
        ("strict", "s1 = a | b s1 & X[!] s1 & ! ( a & X[!] a ) & ! ( b & X[!] b )"),
    ],
)
def test_symbols_count_the_property(semantics: str, symbols: str) -> None:
    metrics = BACKEND.translate(loads("t and a b;"), Semantics(semantics)).metrics
    assert (metrics.symbols, metrics.states, metrics.edges) == (len(symbols.split()), None, None)


@pytest.mark.spot
@needs_spot
@pytest.mark.parametrize("semantics", list(Semantics))
def test_spot_counts_the_same(semantics: Semantics) -> None:
    """For every gate, and for random trees."""
    for size in range(1, 5):
        for gate in Gate:
            for threshold in range(1, size + 1) if gate is Gate.VOT else (None,):
                counted_alike(flat(gate, size, threshold), semantics)
    random = Random(f"sizes {semantics}")
    for shape in (PLAIN, VARIABLE_FREE):
        for _ in range(40):
            counted_alike(random_tree(random, shape), semantics)


def counted_alike(tree: RVAFT, semantics: Semantics) -> None:
    try:
        made = BACKEND.translate(tree, semantics, limit=3_000)
    except (TooLarge, TreeError):
        return
    header, end = split(made.text)
    known: dict[str, Any] = {}
    for name, definition in header.definitions.items():
        known[name] = expanded(spot().formula(definition), known)
    seen: set[int] = set()
    todo = [expanded(spot().formula(made.text[end:].strip()), known)]
    while todo:
        formula = todo.pop()
        if formula.id() not in seen:
            seen.add(formula.id())
            todo.extend(formula)
    assert made.metrics.subformulas == len(seen), f"{semantics}\n{dumps(tree)}\n{made.text}"


def expanded(formula: Any, known: dict[str, Any]) -> Any:
    """Definitions put in where they are used."""
    inner = [expanded(operand, known) for operand in formula]
    if formula.kindstr() == "ap" or not inner:
        return known.get(formula.ap_name(), formula) if formula.kindstr() == "ap" else formula
    if formula.kindstr() in {"And", "Or"}:
        return spot().formula.multop(formula.kind(), inner)
    return (spot().formula.unop if len(inner) == 1 else spot().formula.binop)(formula.kind(), *inner)


def test_limit() -> None:
    gates = [f"g{i} sand a{i} b{i};" for i in range(12)]
    compound = loads(f"t and {' '.join(gate.split()[0] for gate in gates)}; {' '.join(gates)}")
    for semantics in (Semantics.STRICT, Semantics.PROJECTED):
        with pytest.raises(TooLarge) as raised:
            BACKEND.translate(compound, semantics, limit=2_000)
        assert raised.value.limit == 2_000
    assert subformulas(compound, Semantics.SCATTERED) < 100
    with pytest.raises(TooLarge):
        BACKEND.translate(flat(Gate.AND, 12), Semantics.SCATTERED, limit=24)


LEAVES = [f"e{number}" for number in range(400)]
HOSTILE = {
    "alike": "event e(p) = {e: p}; t 200of400 LEAVES; " + "".join(f"{leaf} on e(1);" for leaf in LEAVES),
    "rivals": "".join(f"event {leaf}() = {{{leaf}: _}}; {leaf} on {leaf}();" for leaf in LEAVES) + "t 2of400 LEAVES;",
    "apart": "t 200of400 LEAVES;",
    "guarded": "event e(p) = {e: p}; t and v g; v 200of400 LEAVES; g and x y; e0 and y x; x on e(X); y when X > 1;",
    "shared": "t and v w; v 200of400 LEAVES; w 200of400 LEAVES;",
}


@pytest.mark.parametrize("tree", HOSTILE)
@pytest.mark.parametrize("semantics", list(Semantics))
def test_limits_count_the_work(tree: str, semantics: Semantics) -> None:
    made = loads(HOSTILE[tree].replace("LEAVES", " ".join(LEAVES)))
    start = process_time()
    with contextlib.suppress(TooLarge):
        BACKEND.translate(made, semantics, limit=20_000)
    assert process_time() - start < 10


@pytest.mark.spot
@needs_spot
@pytest.mark.parametrize("semantics", list(Semantics))
def test_large_trees_run(semantics: Semantics) -> None:
    depth = 5_000
    nodes = [Node(f"g{i}", Gate.SAND, (f"g{i + 1}", f"l{i}")) for i in range(depth)]
    chain = RVAFT("g0", [*nodes, *(Node(f"l{i}") for i in range(depth)), Node(f"g{depth}")])
    word = " ".join([f"g{depth}", *(f"l{i}" for i in reversed(range(depth)))])
    specification = BACKEND.translate(chain, semantics)
    assert specification.metrics.subformulas is not None
    assert specification.metrics.subformulas < 30_000
    assert list(specification.monitor().run(events(word))) == ["unknown"] * depth + ["true"]
    word = " ".join(f"e{i}" for i in range(12))
    for gate, threshold, needed in ((Gate.AND, None, 12), (Gate.VOT, 6, 6), (Gate.SAND, None, 12)):
        found = list(BACKEND.translate(flat(gate, 12, threshold), semantics).monitor().run(events(word)))
        assert found == ["unknown"] * (needed - 1) + ["true"] * (13 - needed)


def test_without_spot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "spot", None)
    assert BACKEND.translate(flat(Gate.AND, 3), Semantics.STRICT).metrics.subformulas
    with pytest.raises(ToolMissing, match="pip install spottl"):
        BACKEND.read("F never_read_before").step({})
