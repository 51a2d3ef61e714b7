"""When parts that share occurrences may be translated as if they did not (`scattered` only).

A shared part is then written once for each use, and the uses may be matched by different events. That is harmless when matches can be
moved: what is matchable from one position is matchable from every earlier one, so the latest match serves all uses that have the
same continuation, and the earliest all that have the same start. Dropping any of the three conditions has a counterexample; with both
continuation and start different, `and (sand x s) (sand s y)` would accept s y x s.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, TypeAlias

import networkx as nx

from backends.ltlf.parts import Op, Part
from backends.ltlf.shape import Shape, rivals_apart

Context: TypeAlias = tuple[int, ...]
MANY: Final[Context] = (-1,)
"""Stands for contexts that differ."""


def separable(shape: Shape, root: int) -> bool:
    """Whether the parts below this one, shared ones among them, may be translated one by one."""
    kept = _kept(shape.rows, root)
    return (
        all(rivals_apart(shape, part) for part in kept if shape.rows[part].op in (Op.ALL, Op.AT_LEAST))
        and same_continuation_or_start(shape.rows, kept)
        and always_feasible(shape, kept)
    )


def same_continuation_or_start(rows: Sequence[Part], kept: Sequence[int]) -> bool:
    """Whether for every part all its uses are followed by the same, or all are preceded by the same."""
    after: dict[int, Context] = {kept[-1]: ()}
    before: dict[int, Context] = {kept[-1]: ()}
    for number in reversed(kept):
        if after[number] == MANY and before[number] == MANY:
            return False
        part = rows[number]
        for index, inner in enumerate(part.parts):
            first, last = index == 0, index == len(part.parts) - 1
            in_sequence = part.op is Op.SEQUENCE
            _use(after, inner, after[number] if last or not in_sequence else (number, index))
            _use(before, inner, before[number] if first or not in_sequence else (number, index))
    return True


def _use(contexts: dict[int, Context], part: int, context: Context) -> None:
    contexts[part] = context if contexts.get(part, context) == context else MANY


def always_feasible(shape: Shape, kept: Sequence[int]) -> bool:
    """Whether no scenario can be cyclic: not even the precedences of all scenarios together are."""
    graph = nx.DiGraph()
    for number in kept:
        parts = [part for part in shape.rows[number].parts if shape.events[part]]
        if not shape.rows[number].parts:
            graph.add_edge(("begin", number), ("end", number))
        for part in parts:
            graph.add_edge(("begin", number), ("begin", part))
            graph.add_edge(("end", part), ("end", number))
        if shape.rows[number].op is Op.SEQUENCE:
            for earlier, later in pairwise(parts):
                graph.add_edge(("end", earlier), ("begin", later))
    acyclic: bool = nx.is_directed_acyclic_graph(graph)
    return acyclic


def _kept(rows: Sequence[Part], root: int) -> list[int]:
    seen = {root}
    for number in range(root, -1, -1):
        if number in seen:
            seen.update(rows[number].parts)
    return sorted(seen)
