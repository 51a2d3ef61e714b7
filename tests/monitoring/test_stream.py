"""Events put in order within a window, told apart by a key, and found again."""

import gzip
import json
import pickle
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft.errors import OptionError
from rvaft.monitoring.reader import read
from rvaft.monitoring.run import Backwards, EventBuffer, Field, Key, Ordering

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
    big = 2**53
    assert given_order([big + 1, float(big), big, 1e300, 10**300], window=9)[0] == [2, 3, 1, 5, 4]


def test_an_ordering_goes_on_from_a_pickle() -> None:
    random = Random(5)
    trace = events([number + random.randrange(12) for number in range(200)])
    straight, halting = Ordering("time", window=7), Ordering("time", window=7)
    for _, event in trace:
        halting = pickle.loads(pickle.dumps(halting))
        assert halting.add(event) == straight.add(event)
    assert halting.late == straight.late > 0
    assert list(pickle.loads(pickle.dumps(halting)).rest()) == list(straight.rest())


@pytest.mark.parametrize(
    ("times", "count", "first"), [([1, 5, None, 3, 4, "0", 4.0, 3.5, 9], 2, 4), ([2, 2, 3], 0, 0), ([3, 2], 1, 2)]
)
def test_time_that_goes_back_is_counted(times: list[Any], count: int, first: int) -> None:
    watching = Backwards("time")
    for number, event in events(times):
        watching.see(number, event)
    assert (watching.count, watching.first) == (count, first)


def test_fields_and_keys() -> None:
    key = Key.parse(["user", "host.src"])
    assert key.of({"user": None, "host": {"src": 7}}) == (None, 7)
    assert key.told((None, 7)) == {"user": None, "host.src": 7}
    assert key.of({"user": 1}) is key.of({"host": {"src": 1}}) is None
    assert Key.parse(["a", "a"]).told((1,)) == 1
    stamp = Field.parse("header.stamp")
    for event, number in (
        ({"header": {"stamp": 2}}, 2),
        ({"header.stamp": 1, "header": {"stamp": 9}}, 1),
        ({"header": 0}, None),
        ({"header": {"stamp": True}}, None),
    ):
        assert stamp.number(event) == number
    for text in ("", ".", "a.", ".a", "a..b"):
        with pytest.raises(OptionError, match="is no field"):
            Field.parse(text)


# -- events that an explanation names -----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".jsonl", ".jsonl.gz"])
@pytest.mark.parametrize("seed", range(10))
def test_a_file_is_numbered_as_it_is_read(seed: int, suffix: str, tmp_path: Path) -> None:
    random, log = Random(seed), tmp_path / f"log{suffix}"
    spaces = ["", "\n", "\r\n", "  \n", "\t\r\n\n", "\n\n\n"]
    text = random.choice(["", "\ufeff"])
    for number in range(random.randrange(1, 60)):
        text += random.choice(spaces) + random.choice(["", " "]) + json.dumps({"n": number}) + "\n"
    data = (text + random.choice(spaces)).encode()
    log.write_bytes(gzip.compress(data) if suffix.endswith(".gz") else data)
    expected = dict(enumerate(read(log), 1))
    assert EventBuffer(log).events(range(1, len(expected) + 3)) == expected
    for number, event in expected.items():
        assert EventBuffer(log).events([number]) == {number: event}


def test_what_is_forgotten_is_looked_up_in_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.monitoring.run.BOUND", 3)
    log, packed = tmp_path / "log.jsonl", tmp_path / "log.gz"
    stream, file = EventBuffer(), EventBuffer(log)
    assert file.events([1]) == {}
    log.write_text("".join(f'{{"n": {number}}}\n' for number in range(1, 100)))
    for buffer in (stream, file):
        for number in range(51, 56):
            buffer.remember(number, {"n": number, "remembered": True})
        assert len(buffer.known) == 3
    assert stream.events([7, 51, 55]) == {55: {"n": 55, "remembered": True}}
    assert file.events([7, 51, 55]) == {7: {"n": 7}, 51: {"n": 51}, 55: {"n": 55, "remembered": True}}
    log.write_text('{"n": 1}\nnonsense\n{"n": 3}\n')  # it has changed since
    assert EventBuffer(log).events([1, 2]) == {1: {"n": 1}}
    packed.write_bytes(gzip.compress(b'{"n": 1}\n' * 10_000)[:-9])
    assert EventBuffer(packed).events([10_001]) == {}
