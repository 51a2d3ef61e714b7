"""Sizes in distinct subformulas, limits, depth, and what happens without Spot."""

import sys

import pytest

from rvaft.api import loads
from rvaft.errors import TooLarge, ToolMissing
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from tests.backends.ltlf.building import BACKEND, events, flat, needs_spot


def subformulas(tree: RVAFT, semantics: Semantics) -> int:
    found = BACKEND.translate(tree, semantics).metrics.subformulas
    assert found is not None
    return found


@pytest.mark.parametrize("size", [3, 6, 9, 12, 30])
def test_and_scattered_is_linear(size: int) -> None:
    assert subformulas(flat(Gate.AND, size), Semantics.SCATTERED) == 2 * size + 1


@pytest.mark.parametrize("size", [3, 6, 9, 12])
def test_sand_is_linear(size: int) -> None:
    assert subformulas(flat(Gate.SAND, size), Semantics.STRICT) <= 3 * size
    assert subformulas(flat(Gate.SAND, size), Semantics.SCATTERED) <= 4 * size
    assert subformulas(flat(Gate.SAND, size), Semantics.PROJECTED) <= 5 * size + 2


def test_vot_scattered() -> None:
    for k, n in ((2, 3), (6, 12), (11, 12), (10, 20)):
        assert subformulas(flat(Gate.VOT, n, k), Semantics.SCATTERED) == k * (2 * (n - k) + 3)


@pytest.mark.parametrize("gate", [Gate.AND, Gate.VOT])
@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_windows_are_quadratic(gate: Gate, semantics: Semantics) -> None:
    for size in (4, 8, 16, 32):
        tree = flat(gate, size, size // 2 if gate is Gate.VOT else None)
        assert subformulas(tree, semantics) <= 10 * size * size


def test_what_follows_is_shared() -> None:
    tree = loads("t sand v z; v 6of12 a b c d e f g h i j k l; z and p q r;")
    assert subformulas(tree, Semantics.SCATTERED) < 200
    assert subformulas(tree, Semantics.STRICT) < 2_000


def test_symbols_count_the_property() -> None:
    metrics = BACKEND.translate(flat(Gate.AND, 2), Semantics.SCATTERED).metrics
    assert metrics.symbols == len(["F", "e0", "&", "F", "e1"])
    assert (metrics.states, metrics.edges) == (None, None)
    metrics = BACKEND.translate(loads("t and a b;"), Semantics.STRICT).metrics
    assert metrics.symbols == len(
        [
            "s1",
            "=",
            "a",
            "|",
            "b",
            "s1",
            "&",
            "X[!]",
            "s1",
            "&",
            "!",
            "(",
            "a",
            "&",
            "X[!]",
            "a",
            ")",
            "&",
            "!",
            "(",
            "b",
            "&",
            "X[!]",
            "b",
            ")",
        ]
    )


def test_limit() -> None:
    compound = "t and " + " ".join(f"g{i}" for i in range(12)) + ";"
    compound += "".join(f"g{i} sand a{i} b{i};" for i in range(12))
    for semantics in (Semantics.STRICT, Semantics.PROJECTED):
        with pytest.raises(TooLarge) as raised:
            BACKEND.translate(loads(compound), semantics, limit=2_000)
        assert raised.value.limit == 2_000
    assert subformulas(loads(compound), Semantics.SCATTERED) < 100
    with pytest.raises(TooLarge):
        BACKEND.translate(flat(Gate.AND, 12), Semantics.SCATTERED, limit=24)


def chain(gate: Gate, depth: int) -> RVAFT:
    nodes = [Node(f"g{i}", gate, (f"g{i + 1}", f"l{i}")) for i in range(depth)]
    return RVAFT("g0", [*nodes, *(Node(f"l{i}") for i in range(depth)), Node(f"g{depth}")])


@pytest.mark.parametrize("semantics", list(Semantics))
def test_deep_chain_translates(semantics: Semantics) -> None:
    made = BACKEND.translate(chain(Gate.SAND, 5_000), semantics)
    assert made.metrics.subformulas is not None
    assert made.metrics.subformulas < 30_000


@pytest.mark.parametrize("semantics", list(Semantics))
@needs_spot[0]
@needs_spot[1]
def test_deep_chain_runs(semantics: Semantics) -> None:
    depth = 5_000
    specification = BACKEND.translate(chain(Gate.SAND, depth), semantics)
    word = " ".join([f"g{depth}", *(f"l{i}" for i in reversed(range(depth)))])
    found = list(specification.monitor().run(events(word)))
    assert found == ["unknown"] * depth + ["true"]


@pytest.mark.parametrize("semantics", list(Semantics))
@needs_spot[0]
@needs_spot[1]
def test_twelve_leaves_run(semantics: Semantics) -> None:
    word = events(" ".join(f"e{i}" for i in range(12)))
    for gate, threshold, needed in ((Gate.AND, None, 12), (Gate.VOT, 6, 6), (Gate.SAND, None, 12)):
        found = list(BACKEND.translate(flat(gate, 12, threshold), semantics).monitor().run(word))
        assert found == ["unknown"] * (needed - 1) + ["true"] * (13 - needed)


def test_without_spot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "spot", None)
    specification = BACKEND.translate(flat(Gate.AND, 3), Semantics.STRICT)
    assert specification.metrics.subformulas
    with pytest.raises(ToolMissing, match="pip install spottl"):
        BACKEND.read("F never_read_before").step({})
