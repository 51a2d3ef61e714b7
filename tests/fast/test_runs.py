"""Which runs read a log quickly, and what they remember of its events."""

from dataclasses import replace

from rvaft import loads
from rvaft.monitoring.monitor_set import Per
from rvaft.monitoring.run import batches_for
from rvaft.monitoring.stream import Field
from tests.monitoring.test_quick import Told, one_by_one, quickly, run_of

TREE = loads('event a(v) = { kind: "k", value: v }; toplevel r; r and x y; x on a(1); y on a(2);')


class Every(Told):
    """Wants to be told of every event."""

    every = True


def test_what_has_to_see_every_event_as_it_stands() -> None:
    told = Told()
    run = run_of(TREE, "projected", Per.TREE, told)
    assert batches_for(run) is not None
    assert batches_for(run_of(TREE, "projected", Per.TREE, Every())) is None
    for plan in (replace(run.plan, key=Field.parse("id")), replace(run.plan, order_by="time")):
        run.plan = plan
        assert batches_for(run) is None


def test_the_topic_and_time_of_a_match_are_known_where_no_pattern_has_them() -> None:
    data = b'{"kind":"k","value":1,"topic":"/a","time":5}\n{"kind":"w"}\n{"kind":"k","value":2,"topic":"/b","time":4}\n'
    found = quickly(TREE, "scattered", Per.TREE, data)
    assert found == one_by_one(TREE, "scattered", Per.TREE, data)
    [(number, *_, times)] = found[0]
    assert (number, times) == (3, {1: (5, "/a")})
