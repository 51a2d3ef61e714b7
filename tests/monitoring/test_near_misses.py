"""What a trace holds: counts and near misses, and how far these are looked for."""

import pickle

from rvaft import loads
from rvaft.api import narrowed
from rvaft.monitoring.near_misses import LOOKED_AT, MOST, EventTypeIndex, Statistics

TREE = loads(
    'event a(v, w) = { topic: "/a", value: v, other: w }; event b(v) = { topic: "/b", level: v };'
    "toplevel r; r and x y; x on a(V, _); y on b(L) when L > 1; ignore a(V, _) when V < 0;"
)


def test_what_is_relevant() -> None:
    statistics = Statistics(EventTypeIndex(TREE))
    log: list[tuple[dict[str, object], bool]] = [
        ({"topic": "/a", "value": 1, "other": 1}, True),
        ({"topic": "/a", "value": -1, "other": 1}, False),
        ({"topic": "/b", "level": 2}, True),
        ({"topic": "/b", "level": 1}, False),
        ({"topic": "/c"}, False),
    ]
    assert [statistics.add(event, number) for number, (event, _) in enumerate(log, 1)] == [said for _, said in log]
    assert (statistics.events, statistics.relevant) == (5, {"a": 1, "b": 1})
    assert statistics.never_seen == ()


def test_near_misses_are_looked_for_in_the_first_events_that_are_alike() -> None:
    statistics = Statistics(EventTypeIndex(TREE))
    for number in range(1, LOOKED_AT + 1):
        statistics.add({"topic": "/A", "value": 1, "other": 1}, number)
    [miss] = statistics.near_misses.values()
    assert (miss.type, miss.field, miss.count, miss.more) == ("a", ("topic",), LOOKED_AT, False)
    assert miss.first == "event 1"
    statistics.add({"topic": "/A", "value": 1, "other": 1}, 1000)
    assert (miss.count, miss.more) == (LOOKED_AT, True)
    statistics.add({"topic": "b", "level": 1}, 1001, "log: ")
    other = statistics.near_misses["b", ("topic",)]
    assert (other.count, other.first, other.more, other.expected) == (1, "log: event 1001", False, '"/b"')


def test_another_type_is_no_near_miss() -> None:
    """What misses but the field that tells event types apart is of another type, unless the value is the same but for its spelling."""
    statistics = Statistics(EventTypeIndex(TREE))
    for number, topic in enumerate(["/c", "/ab", None, 1, ["/a"]], 1):
        statistics.add({"topic": topic, "value": 1, "other": 1, "level": 1}, number)
    statistics.add({"value": 1, "other": 1}, 6)
    assert statistics.near_misses == {}
    for number, topic in enumerate(["a", "/A", "a/"], 7):
        statistics.add({"topic": topic, "value": 1, "other": 1}, number)
    assert [(miss.type, miss.field, miss.count) for miss in statistics.near_misses.values()] == [("a", ("topic",), 3)]
    fresh = Statistics(EventTypeIndex(TREE))
    fresh.add({"topic": "/b", "value": 1, "other": 1}, 10)
    assert list(fresh.near_misses) == [("b", ("level",))]


def test_topics_without_end_are_not_remembered() -> None:
    statistics = Statistics(EventTypeIndex(TREE))
    for number in range(MOST + 10):
        statistics.add({"topic": f"/a{'/' * number}"[:50] + " " * (number // 40)}, number)
    assert len(statistics._looked_at) <= MOST


def test_a_pickle_goes_on_counting() -> None:
    types = EventTypeIndex(TREE)
    statistics = Statistics(types)
    statistics.add({"topic": "/a", "value": 1, "other": 1}, 1)
    statistics.add({"topic": "/B", "level": 1}, 2)
    again: Statistics = pickle.loads(pickle.dumps(statistics))
    again.types = types
    for one in (statistics, again):
        one.add({"topic": "/b", "level": 2}, 3)
        one.add({"topic": "/B", "level": 2}, 4)
    assert (again.events, again.relevant, again.never_seen) == (4, {"a": 1, "b": 1}, ())
    assert again.near_misses == statistics.near_misses
    assert next(iter(again.near_misses.values())).count == 2
    again.merge(statistics)
    assert (again.events, again.relevant, again.never_seen) == (8, {"a": 2, "b": 2}, ())
    assert next(iter(again.near_misses.values())).count == 4


def test_every_string_that_a_pattern_asks_for_tells_events_apart() -> None:
    tree = loads(
        'event a(v) = { topic: "/a", value: v }; event b(v) = { topic: "/b", name: "n", value: v };'
        'event k(v) = { kind: "k", value: v };'
        "toplevel r; r and x y z; x on a(V); y on b(V); z on k(V);"
    )
    discriminators = EventTypeIndex(tree).discriminators
    assert discriminators.fields == ("topic", "kind")
    for event, fitting in (
        ({"topic": "/a"}, 1),
        ({"topic": "/b"}, 1),
        ({"kind": "k"}, 1),
        ({"topic": "/a", "kind": "k"}, 2),
        ({"topic": "k", "kind": "/a"}, 0),
        ({"topic": ["/a"], "kind": None}, 0),
        ({}, 0),
    ):
        assert len(discriminators.candidates(discriminators.values(event))) == fitting


def test_an_event_of_a_type_may_miss_what_the_tree_asks_of_it() -> None:
    statistics = Statistics(
        EventTypeIndex(loads('event a(v) = { topic: "/a", value: v }; toplevel r; r or x; x on a(1);'))
    )
    assert not statistics.add({"topic": "/a", "value": 2}, 7)
    [miss] = statistics.near_misses.values()
    assert (miss.type, miss.field, miss.found, miss.first) == ("a", ("value",), "2", "event 7")
    assert (statistics.relevant, statistics.never_seen) == ({}, ())


def test_an_event_of_several_types() -> None:
    tree = loads(
        'event a(v) = { topic: "/t", value: v }; event b(v) = { topic: "/t", level: v };'
        'event c(v) = { topic: "/t", deep: { value: v } };'
        "toplevel r; r and x y z; x on a(V) when V > 1; y on b(V); z on c(V) when V > 1;"
    )
    statistics = Statistics(EventTypeIndex(tree))
    for _ in range(2):
        assert statistics.add({"topic": "/t", "value": 1, "level": 1, "deep": {"value": 2}}, 1)
        assert statistics.add({"topic": "/t", "value": 2, "level": 1}, 2)
        assert statistics.add({"topic": "/t", "value": 1, "level": 1}, 3)
        assert not statistics.add({"topic": "/t", "deep": {"value": 1}}, 4)
    assert statistics.relevant == {"a": 2, "b": 6, "c": 2}
    assert statistics.never_seen == ()


def test_a_part_is_counted_as_the_whole() -> None:
    whole = loads("toplevel r; r or x y; x; y;")
    statistics = Statistics(EventTypeIndex(narrowed(whole, 1, None)))
    assert statistics.add({"event": "y"}, 1)
    assert (statistics.names, statistics.never_seen) == (("x", "y"), ("x",))
