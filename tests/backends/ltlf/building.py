"""Trees and monitors for the tests of this backend."""

from importlib.util import find_spec
from typing import Final

import pytest

from backends.ltlf import LtlfBackend
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

BACKEND: Final = LtlfBackend()
needs_spot: Final = pytest.mark.skipif(find_spec("spot") is None, reason="reading LTLf needs Spot (spottl)")


def flat(gate: Gate, size: int, threshold: int | None = None) -> RVAFT:
    """One gate over leaves e0, e1, …"""
    leaves = tuple(f"e{number}" for number in range(size))
    return RVAFT("top", [Node("top", gate, leaves, threshold), *map(Node, leaves)])


def events(word: str) -> list[Json]:
    """`a b` is two default events."""
    return [{"event": name} for name in word.split()]


def verdicts(text: str, trace: list[Json]) -> str:
    """One sign for each event: T, F or ?."""
    signs = {"true": "T", "false": "F", "unknown": "?"}
    return "".join(signs[verdict] for verdict in BACKEND.read(text).run(trace))
