"""Traces that go deep into a tree."""

from random import Random
from typing import Any

from rvaft.engine import Engine
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from tests.engine.dense import SHAPES, dense_trace


def living_trace(random: Random, tree: RVAFT, shape: str, semantics: str, length: int = 9) -> list[dict[str, Any]]:
    """A trace for a dense tree that avoids ⊥ for as long as it easily can, and ends with detection if it comes there."""
    trace: list[dict[str, Any]] = []
    monitor = Engine(tree, semantics)
    while len(trace) < length and not monitor.verdict.final:
        for event in dense_trace(random, SHAPES[shape], 6):
            ahead = monitor.fork()
            if ahead.step(event) is not Verdict.FALSE:
                break
        trace.append(event)
        monitor = ahead
    return trace
