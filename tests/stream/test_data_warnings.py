"""What could have been part of a match and was not is counted, however the log is read, and what
`scattered` makes of a ⊥.
"""

import pickle
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft import loads
from rvaft.model.guards import value, variables
from rvaft.model.values import is_number
from rvaft.stream import semantics_hint
from rvaft.stream.data_warnings import MOST, DataWarnings
from rvaft.stream.semantics_hint import SemanticsHint
from rvaft.stream.statistics import EventTypeIndex

EVENTS = "event e(v) = { e: v }; event f(v) = { f: v }; event d(v) = { d: { v: v } };"
"""Two types that the shape of an event decides, and one that it does not."""


def seen(tree: str, events: Sequence[dict[str, Any]]) -> DataWarnings:
    types = EventTypeIndex(loads(tree))
    found = DataWarnings(types)
    for number, event in enumerate(events, 1):
        found.see(event, number, "", types.of(event))
    return found


@pytest.mark.parametrize(
    ("guard", "events", "count", "first"),
    [
        ("X > 1", [{"e": 2}, {"e": "a"}, {"e": None}, {"f": "a"}], 2, 2),
        ("not X > 1", [{"e": []}], 1, 1),
        ("X + 1 > Y", [{"e": "a"}, {"f": 1}], 1, 1),  # whatever Y is
        ("X > Y", [{"e": "a"}, {"e": "b"}, {"f": "a"}], 0, 0),
        ("X > Y", [{"e": "a"}, {"f": 1}, {"f": 2.0}, {"e": 1}], 2, 2),
        ("X > Y", [{"e": {}}], 1, 1),
        ("X == Y or X + Y > 3", [{"e": "a"}, {"f": "a"}], 0, 0),  # the left side decides
        ("X == Y or X > Y", [{"e": "a"}, {"f": 1}], 1, 2),
        ("X == Y", [{"e": "a"}, {"f": 1}, {"e": None}], 0, 0),
        ("1 / X > Y", [{"e": 1}, {"f": 1}, {"e": 0}], 1, 3),
        ("number(X) > Y", [{"f": 1}, {"e": "1"}, {"e": "one"}], 1, 3),
        ("startswith(X, \"a\") and Y == 1", [{"e": "a"}, {"e": 5}, {"f": 1}], 1, 2),
        ("X", [{"e": True}, {"e": 1}], 1, 2),
        ("Z > 1", [{"d": {"v": 1}}, {"d": {"v": "a"}}, {"d": {}}, {"d": {"v": []}}], 2, 2),
    ],
)  # fmt: skip
def test_guards(guard: str, events: list[dict[str, Any]], count: int, first: int) -> None:
    tree = f"{EVENTS} top sand a b c g; a on e(X); b on f(Y); c on d(Z); g when {guard};"
    found = [(one.count, one.first) for one in seen(tree, events).found.values()]
    assert found == ([(count, f"event {first}")] if count else [])


@given(st.lists(st.sampled_from([0, 1, 2.5, "a", "b", True, None]), min_size=1, max_size=6), st.integers(0, 5))
def test_the_guard_of_one_event_is_told_exactly_where_it_is_undefined(values: list[Any], which: int) -> None:
    guards = ("X > 1", "X == 1 or X > 1", "not 1 / X > 1", "X * 2 > 1 and X != 2.5", "number(X) > 0", "min(X, 1) < 1")
    tree = loads(f"{EVENTS} top or a b; a on e(X) when {guards[which]}; b;")
    guard = tree.nodes["a"].when
    assert guard is not None
    assert variables(guard) == ("X",)
    wrong = [number for number, one in enumerate(values, 1) if not isinstance(value(guard, {"X": one}), bool)]
    found = list(
        seen(f"{EVENTS} top or a b; a on e(X) when {guards[which]}; b;", [{"e": one} for one in values]).found.values()
    )
    assert [(one.count, one.first) for one in found] == ([(len(wrong), f"event {wrong[0]}")] if wrong else [])
    assert all(not is_number(values[number - 1]) or which == 2 for number in wrong)


def test_of_very_many_guards_the_first_are_told() -> None:
    leaves = "".join(f"a{n} on e(X{n}) when X{n} > {n};" for n in range(MOST + 5))
    found = seen(f"{EVENTS} top or {' '.join(f'a{n}' for n in range(MOST + 5))}; {leaves}", [{"e": "a"}])
    assert [len(list(found.lines)), list(found.lines)[-1]] == [MOST + 1, "5 more warnings"]


def test_an_ignored_event_needs_no_time_and_a_guard_of_an_ignore_counts() -> None:
    tree = f"{EVENTS} time t as s; top or a b; a on e(X); b; ignore e(V) when V < 0;"
    found = seen(tree, [{"e": -1}, {"e": "x", "t": 5}, {"z": 1}])
    assert [*found.lines] == [
        'undefined guard in 1 event: V < 0 of an ignore, where V is a string ("x") (first: event 2)'
    ]


def test_counts_are_pickled_and_added() -> None:
    tree = f"{EVENTS} top or a b; a on e(X) when X > 1; b;"
    one, other = seen(tree, [{"e": "a"}]), seen(tree, [{"e": 2}, {"e": "b"}, {"e": "c"}])
    again: DataWarnings = pickle.loads(pickle.dumps(one))
    again.attach(EventTypeIndex(loads(tree)))
    again.merge(other)
    assert [*again.lines] == ['undefined guard in 3 events: X > 1 of a, where X is a string ("a") (first: event 1)']


@pytest.mark.parametrize(
    ("name", "bound", "said"), [("ROOM", 3, "event 4"), ("LIMIT", 1, "event 1"), ("SECONDS", -1.0, "event 1")]
)
def test_looking_back_is_bounded(name: str, bound: float, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(semantics_hint, name, bound)
    found = SemanticsHint(loads("event e(v) = { e: v }; top sand a b; a on e(X); b on e(Y) when Y == X - 5;"))
    for number in range(1, 9):
        found.keep(1, number, {"e": number})
    found.look(1, "")
    assert str(found.line).endswith(f"they were tried up to {said} only, where it took too long")
