"""The monitors of all columns: the verdicts stored beside the trees, and explanations by the
numbers that events have.
"""

from collections.abc import Callable

import pytest

from rvaft import loads, monitor
from rvaft.errors import TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor
from rvaft.stream.monitor_set import MOST, MonitorSet, Per, columns
from tests.trees import shipped

PRUNED = "remote_inspection/pruned"


def making(semantics: Semantics) -> Callable[[RVAFT], Monitor]:
    return lambda part: monitor(part, semantics=semantics)


def set_of(tree: RVAFT, per: Per, semantics: Semantics = Semantics.PROJECTED) -> MonitorSet:
    return MonitorSet(columns(tree, per), making(semantics), semantics)


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("per", Per)
def test_changes_are_told_once_and_explained_as_a_monitor_alone_does(per: Per, semantics: Semantics) -> None:
    fresh = set_of(shipped.load(PRUNED), per, semantics)
    for _, events in shipped.traces(PRUNED):
        monitors, alone = fresh.fork(), [making(semantics)(column.part) for column in fresh.columns]
        told: dict[int, int] = {}
        for number, event in enumerate(events, 1):
            changed = monitors.step(event, number)
            assert not set(changed) & set(told)
            told |= dict.fromkeys(changed, number)
            before = [one.verdict for one in alone]
            assert [one.step(event) for one in alone] == list(monitors.verdicts)
            assert list(changed) == [i for i, one in enumerate(alone) if one.verdict is not before[i]]
        assert told == monitors.since
        for place, one in enumerate(alone):
            assert monitors.explanation(place) == one.explanation
            assert monitors.ended(place) == one.ended


@pytest.mark.parametrize("semantics", [Semantics.PROJECTED, Semantics.SCATTERED])
def test_what_concerns_nothing_counts_as_read(semantics: Semantics) -> None:
    monitors = set_of(loads("toplevel t; t sand a b; a; b;"), Per.TREE, semantics)
    for number, name in enumerate(["x", "a", "x", "x", "b"], 1):
        monitors.step({"event": name}, number)
        assert monitors.serves is (name != "x")
    monitors.step({"event": "b"}, 6)  # the verdict is final
    assert monitors.serves is False


def test_the_columns_have_the_names_of_the_paper() -> None:
    tree = shipped.load(PRUNED)

    for per, titles in {
        Per.TREE: {"tree": "φ"},
        Per.BRANCH: {"tree": "φ", "1": "φ1", "2": "φ2", "3": "φ3", "4": "φ4"},
        Per.KIND: {"tree": "φ", "fault": "fault", "attack": "attack"},
    }.items():
        assert {column.label: column.title for column in columns(tree, per)} == titles
    assert [column.label for column in columns(shipped.load("gates/sand"), Per.KIND)] == ["tree"]


def test_a_branch_without_a_feasible_scenario_has_no_column() -> None:
    tree = loads("toplevel t; t or p q; p and a never; never fault when 1 > 2; a; q sand b c; b; c;")
    assert [column.label for column in columns(tree, Per.BRANCH)] == ["tree", "2"]
    assert [column.label for column in columns(tree, Per.KIND)] == ["tree"]


def test_too_many_branches_are_an_error_that_says_what_to_do() -> None:
    names = [f"a{n}" for n in range(MOST + 1)]
    tree = loads(f"toplevel t; t or {' '.join(names)};")
    with pytest.raises(TooLarge) as raised:
        columns(tree, Per.BRANCH)
    assert raised.value.limit == MOST
    assert any("--per kind" in note for note in raised.value.__notes__)
    assert len(columns(tree, Per.TREE)) == 1
