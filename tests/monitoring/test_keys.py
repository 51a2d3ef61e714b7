"""One stream of many: each value of a field is monitored as if it were alone."""

from random import Random
from typing import Any

import pytest

from rvaft import loads, monitor
from rvaft.errors import OptionError, TooLarge
from rvaft.model.verdict import Semantics
from rvaft.monitoring.monitor_set import Bank, Keyed, Watch, columns
from rvaft.monitoring.stream import Field
from tests.trees import shipped


def keyed(text: str, field: str, semantics: Semantics = Semantics.PROJECTED, limit: int = 100) -> Keyed:
    tree = shipped.load(text) if "/" in text else loads(text)
    bank = Bank(columns(tree), lambda part: monitor(part, semantics=semantics), semantics)
    return Keyed(Field.parse(field), Watch("log", bank), limit=limit)


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("seed", range(5))
def test_each_key_gets_the_verdicts_and_matches_of_its_events_alone(seed: int, semantics: Semantics) -> None:
    random = Random(seed)
    traces = dict(shipped.traces("remote_inspection/pruned"))
    left = {name: list(events) for name, events in traces.items()}
    watches = keyed("remote_inspection/pruned", "robot", semantics)
    given: dict[str, list[int]] = {name: [] for name in traces}
    number = 0
    while any(left.values()):
        name = random.choice([name for name, events in left.items() if events])
        number += random.choice([1, 1, 3])
        event = {**left[name].pop(0), "robot": name}
        watch, new = watches.of(event, number)
        assert watch is not None
        assert new is (not given[name])
        given[name].append(number)
        watch.bank.step(event, number)
    for watch in watches:
        assert watch.key is not None
        name = watch.key[0]
        alone = monitor(shipped.load("remote_inspection/pruned"), semantics=semantics)
        *_, last = alone.run(traces[name])
        assert watch.bank.verdicts == (last,)
        explanation, own = watch.bank.explanation(0), alone.explanation
        assert (explanation is None) is (own is None)
        if explanation is not None and own is not None:
            assert explanation.branch == own.branch
            assert explanation.matched == {node: given[name][at - 1] for node, at in own.matched.items()}
        ended = alone.ended
        assert (watch.bank.ended(0) is None) is (ended is None)
        if ended is not None:
            assert watch.bank.since[0] == given[name][ended.event - 1]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (1, 1.0, True),
        (1, True, False),
        (0, False, False),
        ("1", 1, False),
        (None, False, False),
        ([1, 2], [1.0, 2], True),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, True),
        (2**60, float(2**60), True),
    ],
)
def test_values_are_told_apart_as_everywhere(one: Any, other: Any, same: bool) -> None:
    watches = keyed("toplevel a; a;", "k")
    first, _ = watches.of({"k": one}, 1)
    second, new = watches.of({"k": other}, 2)
    assert (first is second) is same
    assert new is not same
    assert len(list(watches)) == (1 if same else 2)


def test_events_without_the_field_are_counted_and_for_nobody() -> None:
    watches = keyed("toplevel a; a;", "robot.id")
    for number, event in enumerate([{"robot": {"id": None}}, {"robot": 1}, {}, {"robot": {}}], 1):
        watch, _ = watches.of(event, number)
        assert (watch is None) is (number > 1)
    assert (watches.without, watches.first_without) == (3, 2)


def test_a_field_whose_name_has_dots_comes_before_the_path() -> None:
    field = Field.parse("a.b")
    assert field.of({"a.b": 1, "a": {"b": 2}}) == (1,)
    assert field.of({"a": {"b": 2}}) == (2,)
    assert field.of({"a": [1]}) is None


@pytest.mark.parametrize("text", ["", ".", "a.", ".a", "a..b"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match="is no field"):
        Field.parse(text)


def test_too_many_values_are_an_error() -> None:
    watches = keyed("toplevel a; a;", "k", limit=2)
    for number in (1, 2, 1):
        watches.of({"k": number}, number)
    with pytest.raises(TooLarge, match="different values of k") as raised:
        watches.of({"k": 3}, 4)
    assert raised.value.limit == 2
