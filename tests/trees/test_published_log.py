"""The published log of the remote inspection robot: verdicts and explanations, held against the reference too.

Its events have `location` where the paper's have `waypoint`, and it tells by `inspected` that the robot has arrived. So the
shipped tree sees only readings and goals in it; a tree in the words of the log says what happened.
"""

from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest

import rvaft
from rvaft import Ended, Pending, Verdict, loads
from rvaft.coverage import Coverage
from rvaft.export import fired_text
from rvaft.model.tree import RVAFT
from rvaft.monitoring.reader import read
from rvaft.monitors import Awaited
from rvaft.semantics import Reference
from tests.cli.runs import PRUNED
from tests.engine.checking import check_explanation

LOG: Final = Path(__file__).parents[3] / "shared" / "corpus" / "remote_inspection" / "log_rvaft.txt"
SEMANTICS: Final = ("strict", "projected", "scattered")

pytestmark = pytest.mark.skipif(not LOG.exists(), reason="the published log is not there")

IN_ITS_WORDS: Final = """
event move(wp, t)     = { topic: "/command", name: "move", location: wp, time: t };
event inspect(wp)     = { topic: "/command", name: "inspect", location: wp };
event arrived(wp)     = { topic: "inspected", location: wp, data: true };
event radiation(v, t) = { topic: "/radiation_sensor_plugin/sensor_0", value: v, time: t };
event goal(x)         = { topic: "/move_base/goal", goal: { target_pose: { pose: { position: { x: x } } } } };
ignore radiation(V, _) when V < 250;

toplevel damaged;
damaged or   ev1 ev2;
ev1     and  ev3                on move(From, _);
ev2     and  ev3                on arrived(From);
ev3     sand next ev4 ev5 ev6   on inspect(At);
next                            when At == From + 1;
ev4                             on radiation(Value, T1);
ev5                             when Value >= 250;
ev6     or   ev8 ev9            on move(NewWp, T2);
ev8     fault                   when T2 >= T1 + 10;
ev9     and  ev10 attack        on goal(X)            label "Sent far to the west";
ev10                            when X < -5;
"""


@cache
def events() -> list[dict[str, Any]]:
    return list(read(LOG))


def shipped() -> RVAFT:
    return rvaft.load(PRUNED)


def adapted() -> RVAFT:
    return loads(IN_ITS_WORDS)


@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("tree", [shipped, adapted], ids=lambda tree: tree.__name__)
@pytest.mark.parametrize("kind", [None, "fault", "attack"])
def test_every_verdict_is_that_of_the_reference(tree: Any, semantics: str, kind: str | None) -> None:
    engine = rvaft.monitor(tree(), semantics=semantics, kind=kind)
    reference = Reference(tree(), semantics, kind=kind)
    for event in events():
        assert engine.step(event) is reference.step(event)
    if engine.verdict is Verdict.TRUE:
        assert engine.explanation is not None
        prefix = events()[: max(engine.explanation.matched.values())]
        check_explanation(tree(), prefix, semantics, engine.explanation, kind=kind)


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_the_shipped_tree_sees_a_reading_before_any_command(semantics: str) -> None:
    """Under `strict` and `projected` that ends all hope; under `scattered` the commands it waits for never come."""
    monitor = rvaft.monitor(shipped(), semantics=semantics)
    list(monitor.run(events()))
    move, result = Awaited("ev1", "move(Waypoint, _)"), Awaited("ev2", 'result(Waypoint, "success")')
    waited = tuple(Pending(number, (move if number % 2 else result,), {}) for number in (1, 2, 3, 4))
    assert monitor.explanation is None
    if semantics == "scattered":
        assert (monitor.verdict, monitor.ended, monitor.pending()) == (Verdict.UNKNOWN, None, waited)
    else:
        assert (monitor.verdict, monitor.ended) == (Verdict.FALSE, Ended(1, waited))


def test_in_the_words_of_the_log_the_first_event_ends_it_under_strict() -> None:
    monitor = rvaft.monitor(adapted(), semantics="strict")
    list(monitor.run(events()))
    assert monitor.ended is not None
    assert monitor.ended.event == 1


def test_under_projected_a_goal_comes_where_an_inspection_was_expected() -> None:
    monitor = rvaft.monitor(adapted(), semantics="projected")
    list(monitor.run(events()))
    inspect = (Awaited("ev3", "inspect(At)"),)
    assert monitor.ended == Ended(168, (Pending(1, inspect, {"From": 0}), Pending(3, inspect, {"From": 0})))


FIRED = """\
● damaged OR
● ├─ ev1 AND  on move(From, _)  event 166, time 656.922, topic /command
● │  └─ ev3 SAND →  on inspect(At)  event 212, time 700.193, topic /command
● │     ├─ next  when At == From + 1
● │     ├─ ev4  on radiation(Value, T1)  event 262, time 743.002, topic /radiation_sensor_plugin/sensor_0
● │     ├─ ev5  when Value >= 250
● │     └─ ev6 OR  on move(NewWp, T2)  event 290, time 768.456, topic /command
● │        ├─ ev8  [fault]  when T2 >= T1 + 10
  │        └─ ev9 AND  [attack]  on goal(X)  "Sent far to the west"
  │           └─ ev10  when X < -5
  └─ ev2 AND  on arrived(From)
     └─ ev3 (see above)

branch 1: fault
From = 0
At = 1
Value = 286.0
T1 = 743.002
NewWp = 3
T2 = 768.456
"""


def test_under_scattered_the_robot_stayed_too_long() -> None:
    monitor = rvaft.monitor(adapted(), semantics="scattered")
    list(monitor.run(events()))
    explanation = monitor.explanation
    assert explanation is not None
    assert explanation.branch == 1
    assert dict(explanation.matched) == {"ev1": 166, "ev3": 212, "ev4": 262, "ev6": 290}
    assert fired_text(adapted(), explanation, dict(enumerate(events(), 1))) == FIRED


def test_the_attack_comes_with_the_last_goal() -> None:
    monitor = rvaft.monitor(adapted(), semantics="scattered", kind="attack")
    verdicts = list(monitor.run(events()))
    assert verdicts.index(Verdict.TRUE) + 1 == 343
    assert monitor.explanation is not None
    assert (monitor.explanation.branch, monitor.explanation.matched["ev9"]) == (3, 343)
    assert monitor.explanation.variables["X"] == -8.18


@pytest.mark.parametrize(
    ("semantics", "reached"),
    [
        ("strict", [(0, 4, None), (0, 4, None), (0, 5, None), (0, 5, None)]),
        ("projected", [(1, 4, 166), (0, 4, None), (1, 5, 166), (0, 5, None)]),
        ("scattered", [(4, 4, 290), (4, 4, 290), (5, 5, 343), (5, 5, 343)]),
    ],
)
def test_how_far_its_branches_came(semantics: str, reached: list[tuple[int, int, int | None]]) -> None:
    coverage = Coverage(adapted(), semantics)
    coverage.add("log", events())
    report = coverage.report()
    assert [(branch.reached, branch.needed, branch.event) for branch in report.branches] == reached
    assert report.unseen == ()
