"""The number of distinct subformulas is that of the text, as Spot counts it."""

from collections.abc import Mapping
from random import Random
from typing import Any

import pytest

from backends.ltlf.reader import split, spot
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, random_tree
from rvaft.api import loads
from rvaft.errors import TooLarge, TreeError
from rvaft.language.printer import dumps
from rvaft.model.nodes import Gate
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from tests.backends.ltlf.building import BACKEND, flat, needs_spot

BY_HAND = [
    ("top and a b c;", "scattered", "a b c, F of each, all"),
    ("top sand a b;", "strict", "a b, X[!] b, all"),
    ("top sand a b c;", "scattered", "a b c, F c, X[!] F c, b & …, F …, X[!] …, a & …, all"),
    ("top 2of3 a b c;", "scattered", "a b c, F of each, b | c, a & (b | c), b & c, all"),
    ("top and x c; x and a b;", "scattered", "a b c, F of each, all"),
]


@pytest.mark.parametrize(("tree", "semantics", "listed"), BY_HAND)
def test_by_hand(tree: str, semantics: str, listed: str) -> None:
    kinds = listed.split(", ")
    atoms = len(kinds[0].split())
    expected = atoms + sum(atoms if kind == "F of each" else 1 for kind in kinds[1:])
    assert BACKEND.translate(loads(tree), Semantics(semantics)).metrics.subformulas == expected


@needs_spot[0]
@needs_spot[1]
@pytest.mark.parametrize("semantics", list(Semantics))
def test_gates(semantics: Semantics) -> None:
    for size in range(1, 7):
        for gate in Gate:
            for threshold in range(1, size + 1) if gate is Gate.VOT else (None,):
                _compare(flat(gate, size, threshold), semantics)


@needs_spot[0]
@needs_spot[1]
@pytest.mark.parametrize("shape", [PLAIN, VARIABLE_FREE], ids=["plain", "variable-free"])
def test_random_trees(shape: Any) -> None:
    random = Random(f"{shape}")
    for _ in range(60):
        tree = random_tree(random, shape)
        for semantics in Semantics:
            _compare(tree, semantics)


def _compare(tree: RVAFT, semantics: Semantics) -> None:
    try:
        made = BACKEND.translate(tree, semantics, limit=3_000)
    except (TooLarge, TreeError):
        return
    assert made.metrics.subformulas == _by_spot(made.text), f"{semantics}\n{dumps(tree)}\n{made.text}"


def _by_spot(text: str) -> int:
    """The distinct subformulas of the formula, definitions put in where they are used."""
    header, rest = split(text)
    known: dict[str, Any] = {}
    for name, definition in header.definitions.items():
        known[name] = _expanded(spot().formula(definition), known)
    seen: set[int] = set()
    todo = [_expanded(spot().formula(rest.strip()), known)]
    while todo:
        formula = todo.pop()
        if formula.id() not in seen:
            seen.add(formula.id())
            todo.extend(formula)
    return len(seen)


def _expanded(formula: Any, known: Mapping[str, Any]) -> Any:
    inner = [_expanded(operand, known) for operand in formula]
    match formula.kindstr(), inner:
        case "ap", _:
            return known.get(formula.ap_name(), formula)
        case _, []:
            return formula
        case "And" | "Or", _:
            return spot().formula.multop(formula.kind(), inner)
        case _, [one]:
            return spot().formula.unop(formula.kind(), one)
        case _:
            return spot().formula.binop(formula.kind(), *inner)
