"""What a trace holds: counts and near misses, and how far these are looked for."""

import pickle

from rvaft import loads
from rvaft.api import narrowed
from rvaft.monitoring.near_misses import LOOKED_AT, MOST, Statistics

TREE = loads(
    'event a(v, w) = { topic: "/a", value: v, other: w }; event b(v) = { topic: "/b", level: v };'
    "toplevel r; r and x y; x on a(V, _); y on b(L) when L > 1; ignore a(V, _) when V < 0;"
)


def test_what_is_relevant() -> None:
    statistics = Statistics(TREE)
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
    statistics = Statistics(TREE)
    for number in range(1, LOOKED_AT + 1):
        statistics.add({"topic": "/A", "value": 1, "other": 1}, number)
    [miss] = statistics.near_misses.values()
    assert (miss.type, miss.field, miss.count, miss.more) == ("a", ("topic",), LOOKED_AT, False)
    assert miss.first == "event 1"
    statistics.add({"topic": "/A", "value": 1, "other": 1}, 1000)
    assert (miss.count, miss.more) == (LOOKED_AT, True)
    statistics.add({"topic": "/c", "level": 1}, 1001, "log: ")
    other = statistics.near_misses["b", ("topic",)]
    assert (other.count, other.first, other.more) == (1, "log: event 1001", False)


def test_events_that_are_passed_over_may_be_near_misses_too() -> None:
    statistics = Statistics(TREE)
    apart = statistics.discriminators.apart(["/A"])
    assert statistics.wants(apart) == LOOKED_AT
    statistics.add({"topic": "/A", "value": 1, "other": 1}, 1)
    assert statistics.wants(apart) == LOOKED_AT - 1
    statistics.pass_over(apart, 3)
    [miss] = statistics.near_misses.values()
    assert (statistics.events, miss.count, miss.more) == (4, 1, True)


def test_topics_without_end_are_not_remembered() -> None:
    statistics = Statistics(TREE)
    for number in range(MOST + 10):
        statistics.add({"topic": f"/{number}"}, number)
    assert statistics.wants(statistics.discriminators.apart(["/new"])) == 0
    statistics.add({"topic": "/new", "level": 1}, 1)
    assert not statistics.near_misses
    assert statistics.wants(statistics.discriminators.apart(["/0"])) == LOOKED_AT - 1
    statistics.add({"topic": "/0", "level": 1}, 2)
    assert [miss.first for miss in statistics.near_misses.values()] == ["event 2"]


def test_a_pickle_goes_on_counting() -> None:
    statistics = Statistics(TREE)
    statistics.add({"topic": "/a", "value": 1, "other": 1}, 1)
    statistics.add({"topic": "/B", "level": 1}, 2)
    again: Statistics = pickle.loads(pickle.dumps(statistics))
    for one in (statistics, again):
        one.add({"topic": "/b", "level": 2}, 3)
        one.add({"topic": "/B", "level": 2}, 4)
    assert vars(again).keys() == vars(statistics).keys()
    assert (again.events, again.relevant, again.never_seen) == (4, {"a": 1, "b": 1}, ())
    assert again.near_misses == statistics.near_misses
    assert next(iter(again.near_misses.values())).count == 2


def test_every_string_that_a_pattern_asks_for_tells_events_apart() -> None:
    tree = loads(
        'event a(v) = { topic: "/a", value: v }; event b(v) = { topic: "/b", name: "n", value: v };'
        'event k(v) = { kind: "k", value: v };'
        "toplevel r; r and x y z; x on a(V); y on b(V); z on k(V);"
    )
    discriminators = Statistics(tree).discriminators
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
    statistics = Statistics(loads('event a(v) = { topic: "/a", value: v }; toplevel r; r or x; x on a(1);'))
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
    statistics = Statistics(tree)
    for _ in range(2):
        assert statistics.add({"topic": "/t", "value": 1, "level": 1, "deep": {"value": 2}}, 1)
        assert statistics.add({"topic": "/t", "value": 2, "level": 1}, 2)
        assert statistics.add({"topic": "/t", "value": 1, "level": 1}, 3)
        assert not statistics.add({"topic": "/t", "deep": {"value": 1}}, 4)
    assert statistics.relevant == {"a": 2, "b": 6, "c": 2}
    assert statistics.never_seen == ()


def test_a_part_is_counted_as_the_whole() -> None:
    whole = loads("toplevel r; r or x y; x; y;")
    statistics = Statistics(narrowed(whole, 1, None))
    assert statistics.add({"event": "y"}, 1)
    assert (statistics.types, statistics.never_seen) == (("x", "y"), ("x",))
