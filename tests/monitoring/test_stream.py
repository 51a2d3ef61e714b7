"""Events put in order within a window."""

import pickle
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft.errors import OptionError
from rvaft.monitoring.stream import Backwards, Field, Key, Ordering

numbers = st.integers(-20, 20) | st.floats(-20, 20)


def events(times: Sequence[Any]) -> list[tuple[int, dict[str, Any]]]:
    """An event for each time, the first one number 1; None stands for an event without a time."""
    return [(n, {"n": n} if time is None else {"n": n, "time": time}) for n, time in enumerate(times, 1)]


def ordered(trace: Sequence[tuple[int, dict[str, Any]]], ordering: Ordering) -> list[int]:
    numbers = {id(event): number for number, event in trace}
    given = [event for _, one in trace if (event := ordering.add(one)) is not None]
    return [numbers[id(event)] for event in (*given, *ordering.rest())]


def given_order(times: Sequence[Any], window: int) -> tuple[list[int], Ordering]:
    ordering = Ordering("time", window=window)
    return ordered(events(times), ordering), ordering


def by_hand(times: Sequence[Any], window: int) -> tuple[list[int], list[int]]:
    """Which events come in which order, and which are late: look for the smallest of those waiting, again and again."""
    waiting: list[tuple[float, int]] = []
    order: list[int] = []
    late: list[int] = []
    said = [float("-inf")]
    filled: list[float] = []
    for number, time in enumerate(times, 1):
        filled.append(time if time is not None else filled[-1] if filled else float("-inf"))
        if time is not None and time < max(said):
            late.append(number)
        waiting.append((filled[-1], number))
        if len(waiting) > window:
            first = min(waiting)
            waiting.remove(first)
            said.append(first[0])
            order.append(first[1])
    return order + [number for _, number in sorted(waiting)], late


@given(st.lists(numbers | st.none(), max_size=40), st.integers(0, 12))
def test_the_smallest_of_those_that_wait_comes_first(times: list[float | None], window: int) -> None:
    expected, late = by_hand(times, window)
    order, met = given_order(times, window)
    assert order == expected
    assert (met.late, met.first_late) == (len(late), late[0] if late else 0)
    without = [number for number, time in enumerate(times, 1) if time is None]
    assert (met.without, met.first_without) == (len(without), without[0] if without else 0)


@given(st.lists(numbers, max_size=60), st.integers(0, 10), st.randoms(use_true_random=False))
def test_within_the_window_it_is_a_stable_sort(times: list[float], window: int, random: Random) -> None:
    times.sort()
    # Nobody stands more than `window` places behind its own: whoever is behind by as much as that comes next.
    came: list[float] = []
    left = list(enumerate(times))
    while left:
        due = left[0][0] + window <= len(came)
        came.append(left.pop(0 if due else random.randrange(min(len(left), window + 1)))[1])
    order, late = given_order(came, window)
    assert order == [number for number, _ in sorted(enumerate(came, 1), key=lambda pair: pair[1])]
    assert late.late == 0


def test_an_event_without_a_number_stays_behind_the_one_before() -> None:
    for nothing in (None, "12", True, [3], {"time": 1}):
        order, late = given_order([nothing, 3, nothing, 1, nothing, 2], window=10)
        assert order == [1, 4, 5, 6, 2, 3]
        assert (late.without, late.first_without, late.late) == (3, 1, 0)


def test_numbers_are_compared_by_value() -> None:
    big = 2**53
    assert given_order([big + 1, float(big), big, 1e300, 10**300], window=9)[0] == [2, 3, 1, 5, 4]


def test_a_field_by_its_path() -> None:
    stamped: list[tuple[int, dict[str, Any]]] = [
        (1, {"header": {"stamp": 2}}),
        (2, {"header.stamp": 1, "header": {"stamp": 9}}),
        (3, {"header": 0}),
    ]
    late = Ordering("header.stamp", window=5)
    assert ordered(stamped, late) == [2, 3, 1]
    assert (late.without, late.first_without) == (1, 3)


def test_an_ordering_goes_on_from_a_pickle() -> None:
    random = Random(5)
    trace = events([number + random.randrange(12) for number in range(200)])
    straight, halting = Ordering("time", window=7), Ordering("time", window=7)
    for _, event in trace:
        halting = pickle.loads(pickle.dumps(halting))
        assert halting.add(event) == straight.add(event)
    assert halting.late == straight.late > 0
    assert list(pickle.loads(pickle.dumps(halting)).rest()) == list(straight.rest())


@pytest.mark.parametrize(("field", "window"), [("time", -1), ("", 5), ("a..b", 5)])
def test_options_that_make_no_sense(field: str, window: int) -> None:
    with pytest.raises(OptionError):
        Ordering(field, window=window)


def test_time_that_goes_back_is_counted() -> None:
    watching = Backwards("time")
    for number, event in events([1, 5, None, 3, 4, "0", 4.0, 3.5, 9]):
        watching.see(number, event)
    assert (watching.count, watching.first) == (2, 4)
    fresh = Backwards("time")
    for number, event in events([2, 2, 3]):
        fresh.see(number, event)
    assert (fresh.count, fresh.first) == (0, 0)


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
def test_keys_are_told_apart_as_everywhere(one: Any, other: Any, same: bool) -> None:
    for fields in (["k"], ["k", "m"]):
        key = Key.parse(fields)
        names = []
        for value in (one, other):
            found = key.of({"k": value, "m": 1})
            assert found is not None
            names.append(key.name(found))
        assert (names[0] == names[1]) is same


def test_several_fields_are_one_key() -> None:
    key = Key.parse(["user", "host.src"])
    assert key.of({"user": None, "host": {"src": 7}}) == (None, 7)
    assert key.told((None, 7)) == {"user": None, "host.src": 7}
    assert key.of({"user": 1}) is key.of({"host": {"src": 1}}) is None
    assert Key.parse(["a", "a"]).told((1,)) == 1


@pytest.mark.parametrize("text", ["", ".", "a.", ".a", "a..b"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match="is no field"):
        Field.parse(text)
