"""Hold an engine against the reference: verdicts after every event, and explanations."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

from rvaft.core.restriction import restrict
from rvaft.engine import Engine
from rvaft.errors import TreeError
from rvaft.model.nodes import Kind, Side
from rvaft.model.tree import RVAFT
from rvaft.model.values import is_finite, key
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Explanation
from rvaft.semantics import Reference, ReferenceScenario, branches, feasible_scenarios
from rvaft.semantics.events import time_of
from rvaft.semantics.reference import Partial, TraceStep, decided, guards_hold, observed, relevant, unbroken
from rvaft.semantics.scenarios import of_branch, resolutions, scenario_choices, several

Trace = Sequence[dict[str, Any]]


_ORDERS, _EVENTS = 12, 10


def small_and_valid(tree: RVAFT, most: int = 80) -> bool:
    """Whether the reference takes the tree, and quickly."""
    if len(list(islice(resolutions(tree, scenario_choices), most + 1))) > most:
        return False
    try:
        scenarios = Reference(tree).scenarios
    except TreeError:
        return False
    return all(len(one.orders) <= _ORDERS and len(one.occurrences) <= _EVENTS for one in scenarios)


def small_valid_trees(make: Callable[[], RVAFT]) -> Iterator[RVAFT]:
    """The trees that are made one after the other, but for those that are not small and valid; without end."""
    while True:
        tree = make()
        if small_and_valid(tree):
            yield tree


def compare(
    tree: RVAFT, trace: Trace, semantics: str, *, branch: int | None = None, kind: str | None = None
) -> Engine | None:
    """The engine after the trace, having said what the reference says; None where there is nothing to compare."""
    try:
        reference = Reference(tree, semantics, branch=branch, kind=kind)
    except TreeError:
        return None
    engine = Engine(restrict(tree, branch=branch, kind=kind), semantics)
    for position, event in enumerate(trace, 1):
        expected, found = reference.step(event), engine.step(event)
        assert found == expected, f"{semantics}, branch {branch}, kind {kind}: {found} after {list(trace[:position])}"
        if found.final:
            break
    if engine.verdict is Verdict.TRUE:
        check_explanation(tree, trace[:position], semantics, engine.explanation, branch=branch, kind=kind)
    else:
        assert engine.explanation is None
    return engine


def check_explanation(
    tree: RVAFT,
    prefix: Trace,
    semantics: str,
    explanation: Explanation | None,
    *,
    branch: int | None = None,
    kind: str | None = None,
) -> None:
    """Clause: the explanation gives one match, of the lowest-numbered branch that has one."""
    assert explanation is not None
    assert explanation.branch is not None
    assert explanation.branch == _lowest(tree, prefix, semantics, branch, kind)
    positions = [one.event for one in explanation.matched]
    assert positions == sorted(set(positions))
    assert _allowed(tree, prefix, semantics, positions)
    chosen = branches(tree)[explanation.branch - 1]
    scenarios = [scenario for scenario in feasible_scenarios(tree) if of_branch(scenario, chosen)]
    assert any(_is_match(scenario, explanation, prefix) for scenario in scenarios)


def _lowest(tree: RVAFT, prefix: Trace, semantics: str, branch: int | None, kind: str | None) -> int | None:
    for number, candidate in enumerate(branches(tree), 1):
        has_kind = kind is None or any(tree.nodes[name].kind is Kind(kind) for name in candidate)
        if has_kind and branch in (None, number):
            try:
                verdicts = list(Reference(tree, semantics, branch=number).run(prefix))
            except TreeError:
                continue
            if verdicts[-1] is Verdict.TRUE:
                return number
    return None


def in_time(tree: RVAFT, prefix: Trace) -> list[int]:
    """The positions of the events that are not late."""
    late = None if tree.time is None else tree.time.late
    found, greatest = list[int](), None
    for position, event in enumerate(prefix, 1):
        time = time_of(tree.time, event)
        if late is None or time is None or greatest is None or greatest - time <= late:
            found.append(position)
        greatest = time if greatest is None else greatest if time is None else max(time, greatest)
    return found


def _allowed(tree: RVAFT, prefix: Trace, semantics: str, positions: list[int]) -> bool:
    punctual = in_time(tree, prefix)
    mattering = [position for position in punctual if relevant(tree, prefix[position - 1])]
    match Semantics(semantics):
        case Semantics.STRICT:
            every = list(range(1, len(prefix) + 1))
            allowed, last = every[: len(positions)] == positions and set(positions) <= set(punctual), every
        case Semantics.PROJECTED:
            allowed, last = positions == mattering[: len(positions)], mattering
        case Semantics.CONSECUTIVE:
            first = mattering.index(positions[0]) if positions[0] in mattering else 0
            allowed, last = positions == mattering[first : first + len(positions)], mattering
        case Semantics.SCATTERED:
            allowed, last = set(positions) <= set(punctual), [len(prefix)]
    waits = any(clause.side is Side.AFTER for _, clause, _ in tree.absences)
    return allowed and (waits or positions[-1] == last[-1])


def matched_occurrences(tree: RVAFT, explanation: Explanation) -> dict[str, int]:
    """The positions of a match by the names that the reference gives to occurrences."""
    return {several(tree, tree.nodes[one.node])[one.occurrence - 1]: one.event for one in explanation.matched}


def _is_match(scenario: ReferenceScenario, explanation: Explanation, prefix: Trace) -> bool:
    matched = matched_occurrences(scenario.tree, explanation)
    if scenario.occurrences != set(matched):
        return False
    bindings: list[Any] = [{}]
    for name, position in matched.items():
        bindings = [more for one in bindings for more in observed(scenario, name, prefix[position - 1], one)]
    told = [one for one in bindings if _written(one) == _written(explanation.variables)]
    orders = (all(matched[a] < matched[b] for b in order for a in order[b]) for order in scenario.orders)
    times = {name: time_of(scenario.tree.time, prefix[position - 1]) for name, position in matched.items()}
    places = {name: position - 1 for name, position in matched.items()}
    whole = [Partial(0, 0, scenario.occurrences, one, times, places) for one in told]
    punctual = in_time(scenario.tree, prefix)
    past = [
        TraceStep(event, time_of(scenario.tree.time, event), position not in punctual)
        for position, event in enumerate(prefix, 1)
    ]
    holding = (
        guards_hold(scenario, one) and unbroken(scenario, one, past) and decided(scenario, one, past) for one in whole
    )
    kinds = frozenset(node.kind for node in scenario.nodes if node.kind is not None)
    return any(orders) and any(holding) and kinds == explanation.kinds


def _written(binding: Mapping[str, Any]) -> dict[str, Any]:
    return {name: key(value) for name, value in binding.items() if is_finite(value) and "#" not in name}
