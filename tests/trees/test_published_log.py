"""The published log of the remote inspection robot: verdicts and explanations, held against the reference too.

Its events have `location` where the paper's have `waypoint`, and it tells by `inspected` that the
robot has arrived. So the shipped tree sees only readings and goals in it; a tree in the words of
the log says what happened.
"""

from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest

import rvaft
from rvaft import RVAFT, Awaited, Ended, Monitor, Pending, Verdict
from rvaft.coverage import Coverage
from rvaft.export.drawing import fired_text
from rvaft.readers.json_lines import read
from rvaft.semantics import Reference
from tests.cli.runs import PRUNED
from tests.engine.checking import check_explanation

HERE: Final = Path(__file__).parent
LOG: Final = HERE.parents[2] / "shared" / "corpus" / "remote_inspection" / "log_rvaft.txt"
SEMANTICS: Final = ("strict", "projected", "scattered")

pytestmark = pytest.mark.skipif(not LOG.exists(), reason="the published log is not there")

SHIPPED: Final = rvaft.load(PRUNED)
ADAPTED: Final = rvaft.load(HERE / "published_log.rvaft")


@cache
def events() -> list[dict[str, Any]]:
    return list(read(LOG))


def watched(tree: RVAFT, semantics: str, kind: str | None = None) -> Monitor:
    """A monitor that has read the log."""
    monitor = rvaft.monitor(tree, semantics=semantics, kind=kind)
    list(monitor.run(events()))
    return monitor


@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("tree", [SHIPPED, ADAPTED], ids=["shipped", "adapted"])
@pytest.mark.parametrize("kind", [None, "fault", "attack"])
def test_every_verdict_is_that_of_the_reference(tree: RVAFT, semantics: str, kind: str | None) -> None:
    engine = rvaft.monitor(tree, semantics=semantics, kind=kind)
    assert list(engine.run(events())) == list(Reference(tree, semantics, kind=kind).run(events()))
    if engine.verdict is Verdict.TRUE:
        assert engine.explanation is not None
        prefix = events()[: max(one.event for one in engine.explanation.matched)]
        check_explanation(tree, prefix, semantics, engine.explanation, kind=kind)


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_the_shipped_tree_sees_a_reading_before_any_command(semantics: str) -> None:
    """Under `strict` and `projected` that ends all hope; under `scattered` the commands it waits for never come."""
    monitor = watched(SHIPPED, semantics)
    move, result = Awaited("ev1", "move(Waypoint, _)"), Awaited("ev2", 'result(Waypoint, "success")')
    waited = tuple(Pending(number, (move if number % 2 else result,), {}) for number in (1, 2, 3, 4))
    assert monitor.explanation is None
    if semantics == "scattered":
        assert (monitor.verdict, monitor.ended, monitor.pending()) == (Verdict.UNKNOWN, None, waited)
    else:
        assert (monitor.verdict, monitor.ended) == (Verdict.FALSE, Ended(1, waited))


def test_in_the_words_of_the_log_strict_ends_at_once_and_projected_where_a_goal_comes_instead_of_an_inspection() -> (
    None
):
    first = watched(ADAPTED, "strict").ended
    assert first is not None
    assert first.event == 1
    inspect = (Awaited("ev3", "inspect(At)"),)
    pending = Pending(1, inspect, {"From": 0}), Pending(3, inspect, {"From": 0})
    assert watched(ADAPTED, "projected").ended == Ended(168, pending)


def test_under_scattered_the_robot_stayed_too_long() -> None:
    explanation = watched(ADAPTED, "scattered").explanation
    assert explanation is not None
    assert explanation.branch == 1
    fired = (HERE / "published_log.txt").read_text(encoding="utf-8")
    assert explanation.events == {"ev1": [166], "ev3": [212], "ev4": [262], "ev6": [290]}
    assert fired_text(ADAPTED, explanation, dict(enumerate(events(), 1))) == fired


def test_the_attack_comes_with_the_last_goal() -> None:
    explanation = watched(ADAPTED, "scattered", "attack").explanation
    assert explanation is not None
    assert (explanation.branch, explanation.events["ev9"], explanation.variables["X"]) == (3, [343], -8.18)


@pytest.mark.parametrize(
    ("semantics", "reached"),
    [
        ("strict", [(0, 4, None), (0, 4, None), (0, 5, None), (0, 5, None)]),
        ("projected", [(1, 4, 166), (0, 4, None), (1, 5, 166), (0, 5, None)]),
        ("scattered", [(4, 4, 290), (4, 4, 290), (5, 5, 343), (5, 5, 343)]),
    ],
)
def test_how_far_its_branches_came(semantics: str, reached: list[tuple[int, int, int | None]]) -> None:
    coverage = Coverage(ADAPTED, semantics)
    coverage.add("log", events())
    report = coverage.report()
    assert [(branch.reached, branch.needed, branch.event) for branch in report.branches] == reached
    assert report.unseen == ()
