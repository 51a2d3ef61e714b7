"""The logs that tell a story, beside their trees: they are what the script writes, and what it says
happens in them is found.
"""

from typing import Final

import pytest

import rvaft
from rvaft import Semantics, Verdict
from rvaft.semantics import Reference
from tests.trees import logs, shipped

STORIES: Final = [name for name in logs.STORIES if (shipped.TREES / f"{name}.rvaft").exists()]


@pytest.mark.parametrize("name", STORIES)
def test_the_logs_are_what_the_script_writes(name: str) -> None:
    assert str(dict(shipped.traces(name))) == str(
        dict(sorted(logs.STORIES[name]()))
    )  # NaN equals nothing, itself neither


@pytest.mark.parametrize(("kind", "waypoints"), [("fault", logs.FAULTS), ("attack", logs.ATTACKS)])
def test_every_fault_and_attack_of_the_mission_is_found_and_no_other(kind: str, waypoints: tuple[int, ...]) -> None:
    monitor = rvaft.monitor(shipped.load("remote_inspection/mission"), kind=kind, repeat=True)
    found = [monitor.explanation for verdict in monitor.run(logs.mission()) if verdict is Verdict.TRUE]
    assert [one.variables["Waypoint"] for one in found if one is not None and one.kinds == {kind}] == [*waypoints]


FEW: Final = 4
"""So many failures for the twenty of the story: few enough for the reference."""


@pytest.mark.skipif("cloudtrail/takeover" not in STORIES, reason="not there yet")
@pytest.mark.parametrize("semantics", Semantics)
def test_a_takeover_with_fewer_failures_is_found_by_the_reference_too(semantics: Semantics) -> None:
    text = (shipped.TREES / "cloudtrail/takeover.rvaft").read_text(encoding="utf-8")
    assert "times 20 " in text
    tree, stored = rvaft.loads(text.replace("times 20 ", f"times {FEW} ")), shipped.expected("cloudtrail/takeover")
    for name, log in logs.takeovers(FEW):
        verdicts = list(Reference(tree, semantics).run(log))
        assert list(rvaft.monitor(tree, semantics=semantics).run(log)) == verdicts, name
        assert verdicts[-1].symbol == stored[name][semantics]["tree"][-1], name
