"""Backends, trees and verdicts as words, for the tests of all backends."""

import re
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from typing import Any, Final

import pytest

from backends.c.library import compiler
from backends.conformance.requirements import asks_of_strings
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, Shape
from cross_check.participants import detected, detections
from rvaft import RVAFT, Backend, Gate, Monitor, Node, NotExpressible, Semantics, TooLarge, Verdict, dumps, loads
from rvaft.core.overlaps import overlaps
from rvaft.model.assumptions import first_violation
from rvaft.model.guards import variables
from rvaft.model.nodes import Side, Without
from rvaft.model.values import Json, is_finite
from rvaft.monitors import DetectionMonitor
from rvaft.semantics import Reference

needs_spot: Final = pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot (spottl)")
needs_compiler: Final = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
SPOT: Final = (pytest.mark.spot, needs_spot)

SHAPES = {
    "plain": PLAIN,
    "variable-free": VARIABLE_FREE,
    "shared": Shape(max_nodes=7, sharing=0.5),
    "read-once": Shape(sharing=0, typed_events=0.1, variables=0, guards=0.1, ignores=0.1, max_nodes=11),
    "variables": Shape(max_nodes=7, variables=1, guards=0.5, typed_events=0.9),
    "shared variables": Shape(max_nodes=6, sharing=0.4, variables=1, guards=0.4, typed_events=0.8),
}


def _without_durations(tree: RVAFT, semantics: Semantics) -> bool:
    return all(clause.duration is None for _, clause, _ in tree.absences)


def _of_ltlf(tree: RVAFT, semantics: Semantics) -> bool:
    """Between two events, with guards over variables of one kind; under `strict` nothing is there."""

    def is_written(clause: Without) -> bool:
        own = tree.own_variables(clause)
        mixed = not own.issuperset(clause.variables) and own.intersection(variables(clause.when))
        return clause.side is Side.DURING and not mixed

    written = semantics is Semantics.STRICT or all(is_written(clause) for _, clause, _ in tree.absences)
    return written and _without_durations(tree, semantics)


def _of_automata(tree: RVAFT, semantics: Semantics) -> bool:
    unguarded = semantics is Semantics.STRICT or all(clause.when is None for _, clause, _ in tree.absences)
    return unguarded and _of_ltlf(tree, semantics)


def _of_eql(tree: RVAFT, semantics: Semantics) -> bool:
    """The root's own, between events with other patterns."""
    return all(
        clause.side is Side.DURING
        and clause.when is None
        and (node == tree.root or (tree.nodes[node].leaf and tree.nodes[node].times == 1))
        and not any(overlaps(pattern, other) for name in tree.occurrences if (other := tree.pattern(name)) is not None)
        for node, clause, pattern in tree.absences
    )


def _of_match_recognize(tree: RVAFT, semantics: Semantics) -> bool:
    return semantics is Semantics.SCATTERED and all(clause.side is Side.DURING for _, clause, _ in tree.absences)


def _of_rml(tree: RVAFT, semantics: Semantics) -> bool:
    """Without variables that the clause shares; under `strict` nothing is there."""
    alone = all(tree.own_variables(clause).issuperset(clause.variables) for _, clause, _ in tree.absences)
    written = semantics is Semantics.STRICT or (semantics is Semantics.SCATTERED and alone)
    return written and _without_durations(tree, semantics)


def _of_c(tree: RVAFT, semantics: Semantics) -> bool:
    """But `before`, where an event of the match may be the absent one."""
    return all(clause.side is not Side.BEFORE for _, clause, _ in tree.absences)


def _all(tree: RVAFT, semantics: Semantics) -> bool:
    return True


ABSENCES: Final[dict[str, Callable[[RVAFT, Semantics], bool]]] = {
    "automaton": _of_automata,
    "c": _of_c,
    "eql": _of_eql,
    "ltlf": _of_ltlf,
    "match-recognize": _of_match_recognize,
    "mtl": _without_durations,
    "rml": _of_rml,
    **dict.fromkeys(("kql", "sql", "sql-duckdb", "sql-table", "sql-table-duckdb"), _all),
}
"""The trees whose absent events a backend must write, if it could write the tree without them."""


def writes_absence(name: str, tree: RVAFT, semantics: Semantics) -> bool:
    """Whether a backend must write a tree if it could write it without its absent events."""
    return not tree.absences or (name in ABSENCES and ABSENCES[name](tree, semantics))


def readable(*names: str) -> list[Any]:
    """Names of backends as parameters, with marks for the programs that reading needs."""
    marks = {"automaton": SPOT, "ltlf": SPOT, "c": (needs_compiler,)}
    return [pytest.param(name, marks=marks.get(name, ())) for name in names]


def events(word: str | Iterable[Json]) -> list[Json]:
    """`a b` is two default events."""
    return [{"event": name} for name in word.split()] if isinstance(word, str) else [*word]


def signs(monitor: Monitor, trace: str | Iterable[Json]) -> str:
    """One sign for each event: T, F or ?."""
    return "".join({"true": "T", "false": "F", "unknown": "?"}[verdict.value] for verdict in monitor.run(events(trace)))


def written(tree: str) -> str:
    """`[a# b#' ]*3` is written three times, with its number for `#`, the next one for `#'`, and
    that after it for `#''`.
    """

    def repeated(found: re.Match[str]) -> str:
        numbers = (("#''", n + 2, "#'", n + 1, "#", n) for n in range(int(found[2])))
        return "".join(
            found[1].replace(a, str(x)).replace(b, str(y)).replace(c, str(z)) for a, x, b, y, c, z in numbers
        )

    return re.sub(r"\[([^]]*#[^]]*)\]\*(\d+)", repeated, tree)


def tree(text: str) -> RVAFT:
    """A tree with what is written several times."""
    return loads(written(text))


def flat(gate: Gate, size: int, threshold: int | None = None) -> RVAFT:
    """One gate over leaves e0, e1, …"""
    leaves = tuple(f"e{number}" for number in range(size))
    return RVAFT("top", [Node("top", gate, leaves, threshold), *map(Node, leaves)])


def agreeing(translator: Backend, made: RVAFT, semantics: Semantics, traces: Iterable[list[Json]]) -> int:
    """How many traces have the verdicts of the reference after every prefix; a refusal has a reason."""
    try:
        specification = translator.translate(made, semantics, limit=5_000)
    except TooLarge:
        return 0
    except NotExpressible:
        if Verdict.FALSE not in translator.verdicts or not writes_absence(translator.name, made, semantics):
            return 0  # what it must express the examples say
        assert translator.name in ("rml", "c")
        text = dumps(made)
        own = any(node.own_values for node in made.nodes.values())
        assert own or made.variables or made.time is not None or "[...," in text or asks_of_strings(made, semantics), (
            text
        )
        return 0
    monitor = specification.monitor()
    wanted = [one for one in traces if not translator.json_alone or all(map(is_finite, one))]
    wanted = [one for one in wanted if first_violation(made, one, specification.assumes) is None]
    if monitor.left_open is not None:
        wanted = [one for one in wanted if not monitor.left_open(one)]
    if isinstance(monitor, DetectionMonitor):
        answers = [*map(detected, wanted, monitor.first_detections(wanted))]
    else:
        answers = [tuple(monitor.fork().run(one)) for one in wanted]
    for trace, found in zip(wanted, answers, strict=True):
        expected = (*Reference(made, semantics).run(trace),)
        if isinstance(monitor, DetectionMonitor):
            expected = detections(expected)
        assert found == expected, f"{semantics}\n{dumps(made)}\n{specification.text}\n{trace}"
    return len(wanted)
