"""Coverage held against the partial matches of the reference."""

from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from itertools import islice
from random import Random
from typing import Any

import pytest

from rvaft import RVAFT, TreeError, Verdict, loads
from rvaft.core.fields_to_read import TreeReads
from rvaft.coverage import BranchCoverage, Coverage
from rvaft.model.nodes import Side
from rvaft.readers.json_lines import read
from rvaft.semantics import Reference, branches
from rvaft.semantics.events import observe
from rvaft.semantics.reference import Partial, relevant
from tests.cli.runs import lines
from tests.core.trees import is_plain
from tests.engine.checking import in_time, small_valid_trees
from tests.engine.dense import SHAPES, WILD, trace_of, tree_of
from tests.semantics.cases import CASES, Case
from tests.tables import part_and_whole, sampled

ALL = [*SHAPES, *WILD]
SEMANTICS = ["strict", "projected", "scattered"]
Events = list[dict[str, Any]]


def cases(shape: str, semantics: str, count: int) -> Iterator[tuple[RVAFT, Events, Coverage]]:
    """Random trees with a trace each that goes deep into some branch of many; none breaks a rule
    that the reference knows nothing of.
    """
    random = Random(f"coverage {shape} {semantics}")
    for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), count):
        events = trace_of(random, tree, shape, semantics)
        with suppress(TreeError):
            yield tree, events, Coverage(tree, semantics)


class Expected:
    """What the definition says of one branch and one log."""

    def __init__(self, tree: RVAFT, events: Events, semantics: str, branch: int) -> None:
        self.reference = Reference(tree, semantics, branch=branch)
        self.needed = min(len(scenario.occurrences) for scenario in self.reference.scenarios)
        self.prefixes = [list(self.reference._partials.values())]
        self.detected_at = 0
        for number, event in enumerate(events, 1):
            if self.reference.step(event) is Verdict.TRUE:
                self.detected_at = number
                break
            self.prefixes.append(list(self.reference._partials.values()))
        best = min(self.lacking(partial) for partials in self.prefixes for partial in partials)
        self.reached = self.needed - (0 if self.detected_at else best)

    def lacking(self, partial: Partial) -> int:
        return len(self.reference.scenarios[partial.scenario].occurrences) - len(partial.assigned)

    def best(self, prefix: int) -> list[Partial]:
        """The partial matches after a prefix from which the branch was as near as it ever was."""
        return [p for p in self.prefixes[prefix] if self.lacking(p) == self.needed - self.reached]

    def awaited(self, prefix: int) -> set[str]:
        """What may come next in those, in any scenario that they are part of."""
        sets = {partial.assigned for partial in self.best(prefix)}
        found: set[str] = set()
        for partial in self.prefixes[prefix]:
            scenario = self.reference.scenarios[partial.scenario]
            if partial.assigned in sets:
                left = scenario.occurrences - partial.assigned
                before = scenario.orders[partial.order]
                found |= {scenario.observing[name].name for name in left if before[name] <= partial.assigned}
        return found


def check(found: BranchCoverage, expected: Expected, semantics: str, *, plain: bool = True) -> None:
    assert (found.needed, found.reached) == (expected.needed, expected.reached)
    assert 0 <= found.reached <= found.needed
    assert (found.detected == 1) == bool(expected.detected_at)
    assert found.detected <= (found.reached == found.needed)
    waits = any(clause.side is Side.AFTER for _, clause, _ in expected.reference.tree.absences)
    assert found.reached < found.needed or found.detected or waits
    if expected.detected_at:
        assert (found.event, found.awaited) == (expected.detected_at, ())
        return
    prefix = found.event or 0
    assert expected.best(prefix), "after its last event the match was there"
    awaited = {one.node for one in found.awaited}
    assert awaited or waits
    assert awaited <= expected.awaited(prefix)
    if semantics != "scattered" and found.reached:
        assert not any(expected.best(earlier) for earlier in range(prefix)), "it was the first to come so far"
        assert awaited == expected.awaited(prefix) or not plain  # of several plain trees those that came farthest wait


WINDOW = "time t as s; top sand a b c within 1 s; a times 2;"
LATE = WINDOW.replace("as s", "as s late 2 s")
HOPELESS = [
    Case(f"no time could complete it: {semantics} {trace}", tree, semantics, trace, "")
    for semantics in ("consecutive", "scattered")
    for tree, trace in ((WINDOW, "a@1 a b@9"), (WINDOW, "a@1 a@5 b@2"), (LATE, "a@1 a@1 z@9 b@9 z@20"))
]
"""A monitor takes such partial matches for lost at once, or forgets them; here they count."""


@pytest.mark.parametrize("case", sampled([*CASES, *HOPELESS], 3), ids=lambda case: case.name)
def test_the_hand_written_cases(case: Case) -> None:
    with suppress(TreeError):
        tree = loads(case.tree)
        coverage = Coverage(tree, case.semantics)
        coverage.add("log", case.events)
        written, quickly = (Coverage(tree, case.semantics) for _ in range(2))
        written.add("log", read(BytesIO(log := lines(case.events).encode()), reads=TreeReads(tree)))
        quickly.add("log", BytesIO(log))
        assert quickly.report() == written.report()
        for found in coverage.report().branches:
            expected = Expected(tree, case.events, case.semantics, found.number)
            check(found, expected, case.semantics, plain=is_plain(tree))


@pytest.mark.parametrize("shape", sampled(ALL, 4))
@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("count", part_and_whole(5, 12))
def test_how_far_is_what_the_definition_says(shape: str, semantics: str, count: int) -> None:
    compared = reached = 0
    for number, (tree, events, coverage) in enumerate(cases(shape, semantics, 40)):
        if number >= count and reached:
            break
        coverage.add("log", events)
        report = coverage.report()
        assert len(report.branches) + len(report.infeasible) == len(branches(tree))
        for infeasible in report.infeasible:
            with pytest.raises(TreeError):
                Reference(tree, semantics, branch=infeasible)
        for found in report.branches:
            expected = Expected(tree, events, semantics, found.number)
            check(found, expected, semantics, plain=is_plain(tree))
            compared += 1
            reached += 0 < found.reached < found.needed
        check_nodes(tree, events, semantics, coverage)
    assert compared
    assert reached


def check_nodes(tree: RVAFT, events: Events, semantics: str, coverage: Coverage) -> None:
    """A node is seen when an event in time, under `projected` a relevant one, fits it."""
    report = coverage.report()
    reached = set().union(*(branches(tree)[branch.number - 1] for branch in report.branches))
    punctual = [events[position - 1] for position in in_time(tree, events)]
    counted = [event for event in punctual if semantics != "projected" or relevant(tree, event)]
    unseen = {node.node for node in report.unseen}
    for name in tree.order:
        node = tree.nodes[name]
        if node.has_event and name in reached:
            fits = any(observe(tree, node, event, {}) for event in counted)
            assert fits or name in unseen
            assert node.when is not None or fits != (name in unseen)
    assert report.seen + len(report.unseen) == report.nodes == len(reached & set(tree.occurrences))


@pytest.mark.ci
@pytest.mark.parametrize("semantics", SEMANTICS)
def test_of_several_logs_the_best_counts(semantics: str) -> None:
    """And the first of the best is named."""
    better = 0
    for shape in ("plain", "variables", "shared thresholds"):
        random = Random(f"several {shape}")
        for tree, events, together in cases(shape, semantics, 6):
            logs = [events[: random.randint(0, len(events))], events[:2][::-1], events, events]
            apart = [Coverage(tree, semantics) for _ in logs]
            for number, log in enumerate(logs):
                together.add(f"log {number}", log)
                apart[number].add(f"log {number}", log)
            singles = zip(*(one.report().branches for one in apart), strict=True)
            for found, single in zip(together.report().branches, singles, strict=True):
                best = max(single, key=lambda one: one.reached)  # the first of the largest
                assert (found.reached, found.log, found.event) == (best.reached, best.log, best.event)
                assert found.detected == sum(one.detected for one in single)
                better += best.log not in (None, "log 0")
    assert better
