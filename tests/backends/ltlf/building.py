"""Trees and monitors for the tests of this backend."""

from collections.abc import Callable
from importlib.util import find_spec

import pytest

from backends.ltlf import LtlfBackend
from rvaft.api import loads
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

BACKEND = LtlfBackend()

needs_spot = [
    pytest.mark.spot,
    pytest.mark.skipif(find_spec("spot") is None, reason="reading LTLf needs Spot (spottl)"),
]


def spot_needed(test: Callable[..., None]) -> Callable[..., None]:
    """The same marks for one test."""
    for mark in needs_spot:
        test = mark(test)
    return test


def flat(gate: Gate, size: int, threshold: int | None = None) -> RVAFT:
    """One gate over leaves e0, e1, …"""
    leaves = tuple(f"e{number}" for number in range(size))
    return RVAFT("top", [Node("top", gate, leaves, threshold), *map(Node, leaves)])


def text_of(tree: str, semantics: str) -> str:
    return BACKEND.translate(loads(tree), Semantics(semantics)).text


def body(text: str) -> list[str]:
    """Definitions and formula, without the lines about events."""
    about = ("/* rvaft", "*/", "atom ", "relevant ", "ignored ")
    return [line for line in text.splitlines() if not line.startswith(about)]


def events(word: str) -> list[Json]:
    """`a b` is two default events."""
    return [{"event": name} for name in word.split()]


def verdicts(text: str, trace: list[Json]) -> str:
    """One sign for each event: T, F or ?."""
    signs = {"true": "T", "false": "F", "unknown": "?"}
    return "".join(signs[verdict] for verdict in BACKEND.read(text).run(trace))
