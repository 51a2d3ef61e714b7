"""What a trace holds: counts and near misses, and how far these are looked for."""

import pickle
from typing import Any

import pytest

from rvaft import RVAFT, loads
from rvaft.rules.validity import valid_part
from rvaft.stream.statistics import LOOKED_AT, MOST, OTHERS, EventTypeIndex, Statistics

TREE = loads(
    'event a(v, w) = { topic: "/a", value: v, other: w }; event b(v) = { topic: "/b", level: v };'
    "toplevel r; r and x y; x on a(V, _); y on b(L) when L > 1; ignore a(V, _) when V < 0;"
)


def counted(tree: RVAFT, *events: dict[str, Any]) -> Statistics:
    statistics = Statistics(EventTypeIndex(tree))
    for number, event in enumerate(events, 1):
        statistics.add(event, number)
    return statistics


def misses(statistics: Statistics) -> list[tuple[str, str, int, str]]:
    return [(one.type, ".".join(one.field), one.count, one.first) for one in statistics.near_misses.values()]


A = {"topic": "/a", "value": 1, "other": 1}
VALUES = loads(
    'event a(v) = { topic: "/t", value: v }; event b(v) = { topic: "/t", level: v };'
    'event c(v) = { topic: "/t", deep: { value: v } };'
    "toplevel r; r and x y z; x on a(V) when V > 1; y on b(V); z on c(V) when V > 1;"
)


@pytest.mark.parametrize(
    ("tree", "event", "types"),
    [
        (TREE, A, "a"),
        (TREE, {**A, "value": -1}, ""),
        (TREE, {"topic": "/b", "level": 2}, "b"),
        (TREE, {"topic": "/b", "level": 1}, ""),
        (TREE, {"topic": "/c"}, ""),
        (VALUES, {"topic": "/t", "value": 1, "level": 1, "deep": {"value": 2}}, "bc"),
        (VALUES, {"topic": "/t", "value": 2, "level": 1}, "ab"),
        (VALUES, {"topic": "/t", "value": 1, "level": 1}, "b"),
        (VALUES, {"topic": "/t", "deep": {"value": 1}}, ""),
    ],
)
def test_what_is_relevant(tree: RVAFT, event: dict[str, Any], types: str) -> None:
    statistics = Statistics(EventTypeIndex(tree))
    for number in (1, 2):
        assert statistics.add(event, number) is bool(types)
    assert (statistics.events, statistics.relevant) == (2, dict.fromkeys(types, 2))


def test_what_is_seen_need_not_be_relevant() -> None:
    assert counted(TREE, {"topic": "/b", "level": 1}).never_seen == ("a",)
    statistics = counted(valid_part(loads("toplevel r; r or x y; x; y;"), 1, None), {"event": "y"})  # as of the whole
    assert (statistics.relevant, statistics.names, statistics.never_seen) == ({"y": 1}, ("x", "y"), ("x",))
    tree = loads('event a(v) = { topic: "/a", value: v }; toplevel r; r or x; x on a(1);')
    statistics = counted(tree, {"topic": "/a", "value": 2})
    [miss] = statistics.near_misses.values()
    assert (miss.type, miss.field, miss.found, miss.first) == ("a", ("value",), "2", "event 1")
    assert (statistics.relevant, statistics.never_seen) == ({}, ())


def test_a_misspelt_literal_is_seen() -> None:
    """A call with a literal that no event fits is listed, and the other values of its field."""
    tree = loads(
        'event log(k, u) = { event: k, user: u }; toplevel r; r or x y; x on log("in", U); y on log("out", _);'
    )
    given: list[dict[str, Any]] = [
        {"event": "out", "user": 1},
        {"event": "inn", "user": 1},
        *({"event": f"e{number}"} for number in range(99)),
    ]
    statistics = counted(tree, *given)
    assert (statistics.never_seen, statistics.never_called) == ((), ('log("in", _)',))
    assert [*statistics.others["event"]] == ["inn", *(f"e{number}" for number in range(OTHERS - 1))]
    first, again = pickle.loads(pickle.dumps(counted(tree, given[0]))), pickle.loads(pickle.dumps(statistics))
    first.attach(EventTypeIndex(tree))
    first.merge(again)
    assert (first.never_called, first.others) == (statistics.never_called, statistics.others)


def test_near_misses_are_looked_for_in_the_first_events_that_are_alike() -> None:
    statistics = counted(TREE, *[{**A, "topic": "/A"}] * LOOKED_AT)
    [miss] = statistics.near_misses.values()
    assert (misses(statistics), miss.more) == ([("a", "topic", LOOKED_AT, "event 1")], False)
    statistics.add({**A, "topic": "/A"}, 1000)
    assert (miss.count, miss.more) == (LOOKED_AT, True)
    statistics.add({"topic": "b", "level": 1}, 1001, "log: ")
    other = statistics.near_misses["b", ("topic",)]
    assert (other.count, other.first, other.more, other.expected) == (1, "log: event 1001", False, '"/b"')


def test_another_type_is_no_near_miss() -> None:
    """What misses but the field that tells event types apart is of another type, unless the value
    is the same but for its spelling.
    """
    others = [{**A, "topic": topic, "level": 1} for topic in ("/c", "/ab", None, 1, ["/a"])]
    assert misses(counted(TREE, *others, {"value": 1, "other": 1})) == []
    assert misses(counted(TREE, *({**A, "topic": topic} for topic in ("a", "/A", "a/")))) == [
        ("a", "topic", 3, "event 1")
    ]
    assert misses(counted(TREE, {**A, "topic": "/b"})) == [("b", "level", 1, "event 1")]


def test_topics_without_end_are_not_remembered() -> None:
    topics = (f"/a{'/' * number}"[:50] + " " * (number // 40) for number in range(MOST + 10))
    assert len(counted(TREE, *({"topic": topic} for topic in topics))._looked_at) <= MOST


def test_a_pickle_goes_on_counting() -> None:
    statistics = counted(TREE, A, {"topic": "/B", "level": 1})
    again: Statistics = pickle.loads(pickle.dumps(statistics))
    again.types = statistics.types
    for one in (statistics, again):
        one.add({"topic": "/b", "level": 2}, 3)
        one.add({"topic": "/B", "level": 2}, 4)
    for times in (1, 2):
        assert (again.events, again.relevant, again.never_seen) == (4 * times, {"a": times, "b": times}, ())
        assert misses(again) == [("b", "topic", 2 * times, "event 2")]
        again.merge(statistics)


def test_every_string_that_a_pattern_asks_for_tells_events_apart() -> None:
    tree = loads(
        'event a(v) = { topic: "/a", value: v }; event b(v) = { topic: "/b", name: "n", value: v };'
        'event k(v) = { kind: "k", value: v };'
        "toplevel r; r and x y z; x on a(V); y on b(V); z on k(V);"
    )
    discriminators = EventTypeIndex(tree).discriminators
    assert discriminators.fields == ("topic", "kind")
    for topic, kind, fitting in (
        ("/a", None, 1),
        ("/b", None, 1),
        (None, "k", 1),
        ("/a", "k", 2),
        ("k", "/a", 0),
        (["/a"], None, 0),
    ):
        values = discriminators.values({"topic": topic, "kind": kind})
        assert len(discriminators.candidates(values)) == fitting
    assert not discriminators.candidates(discriminators.values({}))
