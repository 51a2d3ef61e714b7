"""Texts for programs that tell first detections: trees and traces for them, what the definition
says, and texts that are wrong.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from random import Random
from typing import Any, TypeAlias

from backends import conformance
from backends.event_columns import EventColumns
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft import RVAFT, RvaftError, Semantics, Verdict
from rvaft.backend import backend
from rvaft.model.assumptions import first_violation
from rvaft.model.values import Json, is_finite
from rvaft.semantics import Reference

Told: TypeAlias = Sequence[int | None]


def first(tree: RVAFT, semantics: Semantics, trace: Sequence[Json]) -> int | None:
    """The number of the first detection, as the definition says."""
    verdicts = [*Reference(tree, semantics).run(trace)]
    return verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in verdicts else None


def cases(
    name: str, header: type[EventColumns], random: Random, trees: int, traces: int, *, limit: int | None = None
) -> Iterator[tuple[str, list[list[Json]], Told]]:
    """The texts of examples and of random trees, with traces that their columns hold, and what the
    definition says of these.
    """
    language, shape = backend(name), Shape(max_nodes=7, variables=0.75, guards=0.5, typed_events=0.8)
    some: list[tuple[RVAFT, list[Any]]] = [
        (one.tree, [*conformance.traces(one, traces, random)]) for one in conformance.examples()
    ]
    for _ in range(trees):
        tree = random_tree(random, shape)
        some.append((tree, [random_trace(random, tree) for _ in range(traces)]))
    for tree, tried in some:
        semantics = random.choice(sorted(language.semantics))
        try:
            made = language.translate(tree, semantics, limit=limit)
        except RvaftError:
            continue
        text, columns = made.text, header.read(made.text)
        kept = [one for one in tried if first_violation(tree, one, made.assumes) is None]
        held = [[*one] for one in kept if all(map(is_finite, one)) and not columns.left_open(one)]
        yield text, held, [first(tree, semantics, one) for one in held]


def all_show(faults: Mapping[str, tuple[str, str]], text: str, tell: Callable[[str], Told]) -> None:
    """Each text that is edited so makes the program tell something else."""
    wanted = tell(text)
    for name, (right, wrong) in faults.items():
        edited = text.replace(right, wrong)
        assert edited != text, name
        assert tell(edited) != wanted, name
