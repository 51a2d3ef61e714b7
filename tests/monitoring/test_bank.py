"""The monitors of all columns: the verdicts stored beside the trees, and explanations by the numbers that events have."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from rvaft import loads, monitor
from rvaft.errors import TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.monitor_set import MOST, Bank, Column, Per, columns
from rvaft.monitors import Monitor
from tests.trees import shipped

PRUNED = "remote_inspection/pruned"


def making(semantics: Semantics) -> Callable[[RVAFT], Monitor]:
    return lambda part: monitor(part, semantics=semantics)


def bank_of(tree: RVAFT, per: Per, semantics: Semantics = Semantics.PROJECTED) -> Bank:
    return Bank(columns(tree, per), making(semantics), semantics)


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("name", shipped.names())
def test_every_column_gets_the_verdicts_stored_with_the_tree(name: str, semantics: Semantics) -> None:
    fresh = bank_of(shipped.load(name), Per.BRANCH, semantics)
    for trace, events in shipped.traces(name):
        bank = fresh.fork()
        said = ["" for _ in bank.columns]
        for number, event in enumerate(events, 1):
            bank.step(event, number)
            said = [signs + verdict.symbol for signs, verdict in zip(said, bank.verdicts, strict=True)]
        stored = shipped.expected(name)[trace][semantics]
        assert {column.label: signs for column, signs in zip(bank.columns, said, strict=True)} == stored


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("per", Per)
def test_changes_are_told_once_and_explained_as_a_monitor_alone_does(per: Per, semantics: Semantics) -> None:
    fresh = bank_of(shipped.load(PRUNED), per, semantics)
    for _, events in shipped.traces(PRUNED):
        bank, alone = fresh.fork(), [making(semantics)(column.part) for column in fresh.columns]
        told: dict[int, int] = {}
        for number, event in enumerate(events, 1):
            changed = bank.step(event, number)
            assert not set(changed) & set(told)
            told |= dict.fromkeys(changed, number)
            before = [one.verdict for one in alone]
            assert [one.step(event) for one in alone] == list(bank.verdicts)
            assert list(changed) == [i for i, one in enumerate(alone) if one.verdict is not before[i]]
        assert told == bank.since
        for place, one in enumerate(alone):
            assert bank.explanation(place) == one.explanation
            assert bank.ended(place) == one.ended


@pytest.mark.parametrize("semantics", Semantics)
def test_events_keep_the_numbers_of_the_stream_they_come_from(semantics: Semantics) -> None:
    tree = loads("toplevel t; t or ab c; ab sand a b; a; b; c;")
    bank = bank_of(tree, Per.BRANCH, semantics)
    for number, name in ((7, "a"), (11, "b")):
        bank.step({"event": name}, number)
    assert bank.verdicts[0] is Verdict.TRUE
    for column in (0, 1):
        explanation = bank.explanation(column)
        assert explanation is not None
        assert explanation.matched == {"a": 7, "b": 11}
    assert bank.since[0] == 11
    if semantics is not Semantics.SCATTERED:
        ended = bank.ended(2)
        assert ended is not None
        assert ended.event == 7


@pytest.mark.parametrize("semantics", [Semantics.PROJECTED, Semantics.SCATTERED])
def test_what_concerns_nothing_counts_as_read(semantics: Semantics) -> None:
    bank = bank_of(loads("toplevel t; t sand a b; a; b;"), Per.TREE, semantics)
    for number, name in enumerate(["x", "a", "x", "x", "b"], 1):
        bank.step({"event": name}, number)
        assert bank.serves is (name != "x")
    explanation = bank.explanation(0)
    assert explanation is not None
    assert explanation.matched == {"a": 2, "b": 5}


def test_a_fork_goes_its_own_way() -> None:
    bank = bank_of(loads("toplevel t; t sand a b; a; b;"), Per.TREE, Semantics.STRICT)
    bank.step({"event": "a"}, 3)
    twin = bank.fork()
    assert twin.step({"event": "b"}, 4) == [0]
    assert bank.verdicts == (Verdict.UNKNOWN,)
    assert bank.step({"event": "x"}, 9) == [0]
    assert (bank.verdicts, twin.verdicts) == ((Verdict.FALSE,), (Verdict.TRUE,))
    assert (bank.since, twin.since) == ({0: 9}, {0: 4})


def test_the_columns_have_the_names_of_the_paper() -> None:
    tree = shipped.load(PRUNED)

    def named(per: Per) -> list[tuple[str, str]]:
        return [(column.label, column.title) for column in columns(tree, per)]

    assert named(Per.TREE) == [("tree", "φ")]
    assert named(Per.BRANCH) == [("tree", "φ"), ("1", "φ1"), ("2", "φ2"), ("3", "φ3"), ("4", "φ4")]
    assert named(Per.KIND) == [("tree", "φ"), ("fault", "fault"), ("attack", "attack")]
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
    assert isinstance(columns(tree, Per.TREE)[0], Column)


def test_numbers_rise() -> None:
    tree = shipped.load(PRUNED)
    for _, events in shipped.traces(PRUNED):
        bank = bank_of(tree, Per.TREE, Semantics.SCATTERED)
        for number, event in enumerate(events, 1):
            bank.step(event, 10 * number)
        explanation = bank.explanation(0)
        if explanation is not None:
            numbers = list(explanation.matched.values())
            assert all(one < other for one, other in pairwise(numbers))
            assert all(number % 10 == 0 for number in numbers)
