"""One trace from its first event to its last: fields, keys, the order, what explanations name, and
that many lines at a time tell the same.
"""

import gzip
import io
import json
import math
import os
import pickle
import re
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cross_check.generate.traces import random_trace
from rvaft import Semantics, TraceError, loads, monitor
from rvaft.cli import main
from rvaft.errors import OptionError, TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.readers import json_blocks
from rvaft.readers.json_blocks import JsonBlockReader
from rvaft.readers.json_lines import LinesRead, read
from rvaft.stream import batch_steps, pipeline
from rvaft.stream.data_warnings import DataWarnings, Doubt
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import Field, Key
from rvaft.stream.listeners import Listener
from rvaft.stream.monitor_set import MonitorSet, Per, columns
from rvaft.stream.order import Backwards, OrderedField, Ordering
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from rvaft.stream.sources import LogReading
from rvaft.stream.statistics import Statistics
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from tests.benchmarks.logs import ignoring_tree, inspections
from tests.cli.runs import SAND, lines
from tests.cli.runs import run as cli
from tests.tables import sampled
from tests.trees import shipped

TREE = loads('event a(v) = { kind: "k", value: v }; toplevel r; r and x y; x on a(1); y on a(2);')


def test_fields_and_keys() -> None:
    key = Key.parse(["user", "host.src"])
    assert key.of({"user": None, "host": {"src": 7}}) == (None, 7)
    assert key.as_json((None, 7)) == {"user": None, "host.src": 7}
    assert key.of({"user": 1}) is key.of({"host": {"src": 1}}) is None
    assert Key.parse(["a", "a"]).as_json((1,)) == 1
    stamp = OrderedField("header.stamp")
    assert stamp.place({"header": {"stamp": 2}}) == 2
    assert stamp.place({"header.stamp": 1, "header": {"stamp": 9}}) == 1
    assert stamp.place({"header": 0}) is stamp.place({"header": {"stamp": True}}) is None
    for text in ("", ".", "a.", ".a", "a..b"):
        with pytest.raises(OptionError, match="is not a field"):
            Field.parse(text)


# -- the order
# ----------------------------------------------------------------------------------------------------------

numbers = st.integers(-20, 20) | st.floats(-20, 20)


def events(times: Sequence[Any]) -> list[dict[str, Any]]:
    """An event for each time, the first one number 1; None stands for an event without a time."""
    return [{"n": n} if time is None else {"n": n, "time": time} for n, time in enumerate(times, 1)]


def in_order(times: Sequence[Any], window: int) -> tuple[list[int], Ordering[Any]]:
    ordering: Ordering[Any] = Ordering("time", window=window)
    given = [event for one in events(times) if (event := ordering.add(one)) is not None]
    return [event["n"] for event in (*given, *ordering.rest())], ordering


def by_hand(times: Sequence[Any], window: int) -> tuple[list[int], list[int]]:
    """Which events come in which order, and which are late: look for the smallest of those waiting, again and again."""
    waiting: list[tuple[float, int]] = []
    order: list[int] = []
    late: list[int] = []
    said = before = float("-inf")
    for number, time in enumerate(times, 1):
        before = before if time is None else time
        if time is not None and time < said:
            late.append(number)
        waiting.append((before, number))
        if len(waiting) > window:
            first = min(waiting)
            waiting.remove(first)
            said = max(said, first[0])
            order.append(first[1])
    if len(times) <= window and None not in times and times == sorted(times, reverse=True) != sorted(times):
        return [number for _, number in sorted(waiting, key=lambda one: (one[0], -one[1]))], late  # newest first
    return order + [number for _, number in sorted(waiting)], late


@given(st.lists(numbers | st.none(), max_size=40), st.integers(0, 12))
def test_the_smallest_of_those_that_wait_comes_first(times: list[float | None], window: int) -> None:
    expected, late = by_hand(times, window)
    order, met = in_order(times, window)
    assert order == expected
    assert (met.late, met.first_late) == (len(late), late[0] if late else 0)
    without = [number for number, time in enumerate(times, 1) if time is None]
    assert (met.without, met.first_without) == (len(without), without[0] if without else 0)


@given(st.lists(numbers, max_size=60), st.integers(0, 10), st.randoms(use_true_random=False))
def test_within_the_window_it_is_a_stable_sort(times: list[float], window: int, random: Random) -> None:
    """Nobody stands more than `window` places behind its own."""
    places = [place + random.randint(0, window) for place in range(len(times))]
    came = [time for _, _, time in sorted(zip(places, range(len(times)), sorted(times), strict=True))]
    order, met = in_order(came, window)
    if met.rises or len(came) > window:  # not newest first
        assert order == [number for number, _ in sorted(enumerate(came, 1), key=lambda pair: pair[1])]
    assert met.late == 0


def test_an_event_without_a_number_stays_behind_the_one_before() -> None:
    for nothing in (None, "12", True, [3], {"time": 1}):
        order, met = in_order([nothing, 3, nothing, 1, nothing, 2], window=10)
        assert order == [1, 4, 5, 6, 2, 3]
        assert (met.without, met.first_without, met.late) == (3, 1, 0)
    big = 2**53
    assert in_order([big + 1, float(big), big, 1e300, 10**300], window=9)[0] == [2, 3, 1, 5, 4]


def test_times_of_iso_8601_are_an_order_too_and_no_numbers() -> None:
    early, later, last = "2024-01-01T00:00:00.5Z", "2024-01-01T02:00:01+02:00", "2024-01-01 00:00:02"
    order, met = in_order([last, later, 7, "soon", early], window=9)
    assert (order, met.without, met.first_without) == ([5, 2, 3, 4, 1], 2, 3)
    assert in_order([3, early, 1], window=9)[0] == [3, 1, 2]


NEWEST: Final = [("c", 9), ("b", 5), ("a", 5)]
OLDEST: Final = NEWEST[::-1]
SEEMS: Final = "the log seems to be newest first: reverse it, as with tac LOG"


@pytest.mark.parametrize("semantics", ["projected", "scattered"])
@pytest.mark.parametrize("form", ["jsonl", "json"])
@pytest.mark.parametrize(
    ("log", "status", "said"),
    [
        (OLDEST, 1, ""),
        (NEWEST, 1, "the log is newest first: 2 events with equal values of time read from last to first"),
        ([("c", 9), ("b", 5), ("a", 4)], 1, ""),
        ([("b", 5), ("a", 5), ("c", 9)], 0, ""),  # not newest first: the order of the log
        (
            [("z", n) for n in range(99, 9, -1)] + [("z", 50), *NEWEST],
            0,
            f"4 events with equal values of time read in the order of the log, but {SEEMS}",
        ),
    ],
)
def test_a_log_that_is_newest_first_is_read_from_its_end(
    log: list[tuple[str, int]], *, status: int, said: str, form: str, semantics: str, tmp_path: Path
) -> None:
    found = [{"event": name, "time": time} for name, time in log]
    text = lines(found) if form == "jsonl" else json.dumps({"Records": found})
    file = tmp_path / f"log.{form}"
    file.write_text(text)
    result = cli("monitor", SAND, file, "--order-by", "time", "--semantics", semantics)
    assert (result.exit_code, result.stderr) == (status, f"rvaft: warning: {said}\n" if said else "")


def test_a_log_beyond_the_window_that_is_newest_first_is_said_and_goes_on_from_a_checkpoint(tmp_path: Path) -> None:
    file, state = tmp_path / "log.jsonl", tmp_path / "state"
    file.write_text(lines([{"event": "z", "time": n} for n in range(99, 9, -1)]))
    words = "monitor", SAND, file, "--order-by", "time"
    late = cli(*words, "--window", 20).stderr
    assert "too late for a window of 20" in late
    assert "the log seems to be newest first: reverse it" in late
    file.write_text(lines([{"event": name, "time": time} for name, time in NEWEST[:2]]))
    assert cli(*words, "--checkpoint", state).exit_code == 0
    with file.open("a") as stream:
        stream.write(lines([{"event": name, "time": time} for name, time in NEWEST[2:]]))
    result = cli(*words, "--checkpoint", state)
    assert (result.exit_code, "2 events with equal values of time read from last" in result.stderr) == (1, True)


@pytest.mark.parametrize(
    ("times", "count", "first"),
    [
        ([1, 5, None, 3, 4, "0", 4.0, 3.5, 9], 2, 4),
        ([2, 2, 3], 0, 0),
        (["2024-02-01", "2024-02-01T00:01Z", "2024-02-01T00:00Z"], 1, 3),
    ],
)
def test_time_that_goes_back_is_counted(times: list[Any], count: int, first: int) -> None:
    clock = Backwards("time")
    for event in events(times):
        clock.see(event["n"], event)
    assert (clock.count, clock.first) == (count, first)


# -- events that an explanation names
# -----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".jsonl", ".jsonl.gz"])
@pytest.mark.parametrize("seed", range(4))
def test_a_file_is_numbered_as_it_is_read(seed: int, suffix: str, tmp_path: Path) -> None:
    random, log = Random(seed), tmp_path / f"log{suffix}"
    spaces = ["", "\n", "\r\n", "  \n", "\t\r\n\n", "\n\n\n"]
    text = ["", "\ufeff"][seed % 2]
    for number in range(random.randrange(20, 60)):
        text += random.choice(spaces) + random.choice(["", " "]) + json.dumps({"n": number}) + "\n"
    data = (text + random.choice(spaces)).encode()
    log.write_bytes(gzip.compress(data) if suffix.endswith(".gz") else data)
    expected = dict(enumerate(read(log), 1))
    assert EventBuffer(log).events(range(1, len(expected) + 3)) == expected
    for number, event in expected.items():
        assert EventBuffer(log).events([number]) == {number: event}


def test_what_is_forgotten_is_looked_up_in_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.stream.event_buffer.BOUND", 3)
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


# -- many lines at a time
# -----------------------------------------------------------------------------------------------


class Told(Listener):
    """Remembers what it was told, and the explanations of then."""

    def __init__(self, *, every: bool = False) -> None:
        self.every = every
        self.said: list[Any] = []

    def event(self, watch: object, number: int, event: Any) -> None:  # noqa: ARG002 (the interface)
        self.said.append((number, event))

    def change(self, change: VerdictChange) -> None:
        monitors = change.watch.monitors
        for column in change.columns:
            explanation = monitors.explanation(column)
            known = (
                () if explanation is None else change.watch.buffer.events({one.event for one in explanation.matched})
            )
            times = {at: (known[at].get("time"), known[at].get("topic")) for at in known}
            verdict = change.verdicts[column], explanation, monitors.ended(column)
            self.said.append((change.watch.key, change.number, column, verdict, times))


def plan_of(
    tree: RVAFT, semantics: str = "projected", per: Per = Per.TREE, *, repeat: bool = False, **options: Any
) -> MonitoringPlan:
    make = lambda part: monitor(part, semantics=semantics)  # noqa: E731
    monitors = MonitorSet(columns(tree, per), make, Semantics(semantics), repeat=repeat)
    return MonitoringPlan(monitors, **options)


def block_reader(plan: MonitoringPlan) -> JsonBlockReader | None:
    return LogReading([plan]).block_reader()


def run_of(plan: MonitoringPlan, told: Told) -> TraceRun:
    totals = Totals(Statistics(plan.monitors.types), DataWarnings(plan.monitors.types))
    return TraceRun(plan, "log", [told], totals, buffer=EventBuffer(reads=plan.reads))


def outcome(plan: MonitoringPlan, data: bytes) -> Any:
    """What is told and counted, which many lines at a time do as one by one."""
    found = []
    for by_blocks in (True, False):
        told, error = Told(), None
        run = run_of(plan, told)
        try:
            list(pipeline.read([run], io.BytesIO(data), "log", by_blocks=by_blocks))
        except (TraceError, TooLarge) as failure:
            error = str(failure)
        statistics = run.totals.statistics
        assert statistics is not None
        counted: Any = statistics.events, statistics.relevant, statistics.never_seen, statistics.near_misses
        monitors, missed = run.watch.monitors, run.totals.data_warnings.found
        keys = [(repr(watch.key), watch.monitors.verdicts, watch.events) for watch in run.watches]
        watched = monitors.verdicts, monitors.found, missed, keys, run.number
        if error is not None and "different values" in error:  # it is read on before that is known
            counted, warnings = counted[1:], []
        else:
            warnings = list(run.warnings)
        found.append((told.said, watched, counted, error, warnings))
    assert found[0] == found[1]
    return found[0]


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_blocks, "SIZE", 300)


def log_of(trace: Sequence[Json], random: Random) -> bytes:
    """A trace among telemetry, blank lines, and times that go back now and then."""
    lines: list[str] = []
    for event in trace:
        lines.extend(json.dumps({"topic": "/odom", "x": random.random()}) for _ in range(random.choice([0, 0, 1, 5])))
        lines.extend([""] * random.choice([0, 0, 0, 1]))
        timed = event if "time" in event or random.random() < 0.5 else {**event, "time": random.random()}
        lines.append(json.dumps(timed))
    return "\n".join(lines).encode()


@pytest.mark.parametrize(("name", "per", "semantics"), sampled(product(shipped.names(), Per, Semantics), 11, ci=2))
def test_shipped_trees(name: str, per: Per, semantics: Semantics) -> None:
    tree = shipped.load(name)
    random = Random(f"{name} {per} {semantics}")
    plan = plan_of(tree, semantics, per, repeat=random.random() < 0.5)
    stored = [events for _, events in shipped.traces(name)]
    for trace in (random.choice(stored), random_trace(random, tree, max_length=24)):
        for end in (b"", b"\n{"):
            outcome(plan, log_of(trace, random) + end)


TIMED = """time at as iso8601 LATE; event e(v) = { topic: "t", value: v }; event f(v) = { topic: "u", value: v };
    top or p q; p and a b within 5 s; a on e(X) when X > 1; b on f(Y) times 2; q sand c d;
    c on f(Z); d on e(V) when V <= Z;"""
TIMES = ["", *(f"2024-01-01T00:00:{second:02}Z" for second in range(9)), 5, None]
VALUES = [1, 2, 2.5, "a", None, math.nan, [math.inf]]


@pytest.mark.parametrize("late", ["", "late 2 s"])
@pytest.mark.parametrize("semantics", Semantics)
def test_times_late_events_and_oversights_are_the_same_however_they_are_read(late: str, semantics: Semantics) -> None:
    random, plan, seen = (
        Random(f"{late} {semantics}"),
        plan_of(loads(TIMED.replace("LATE", late)), semantics),
        set[Doubt](),
    )
    assert block_reader(plan) is not None
    for _ in range(20):
        events: list[dict[str, Any]] = [
            {"topic": random.choice("tuvw"), "value": random.choice(VALUES), "at": random.choice(TIMES), "x": math.nan}
            for _ in range(random.randint(1, 12))
        ]
        for event in events:
            event.pop(random.choice([*event, "y", "y", "y"]), None)
        alone = monitor(plan.monitors.columns[0].part, semantics=semantics)
        _, watched, *_ = outcome(plan, lines(events).encode())
        assert watched[0] == ([*alone.run(events)][-1],)
        seen |= {reason for reason, _ in watched[2]}
    assert seen == set(Doubt) - {Doubt.ASSUMPTION} - ({Doubt.LATE, Doubt.JUMP} if not late else set())


KEYS = ["a", "b", 1, 1.0, True, None, math.nan, [1], {"x": 1}, -0.0, 0, 2**53 + 1, 10**400]


KEYS_AND_ORDERS = [("u", None), ("u v", None), ("", "at"), ("u", "at"), ("u", "u"), ("kind", "n")]


@pytest.mark.parametrize(
    ("keys", "order", "semantics"),
    sampled(((*one, semantics) for one, semantics in product(KEYS_AND_ORDERS, Semantics)), 7),
)
def test_keys_and_orders_are_the_same_however_they_are_read(keys: str, order: str | None, semantics: Semantics) -> None:
    random = Random(f"{keys} {order} {semantics}")
    wild: dict[str, list[Any]] = {
        "at": [None, "2024-01-01T00:00:00Z", True, [1]],
        "u": KEYS,
        "v": KEYS,
        "kind": ["k", "w", 1, True],
        "n": [7],
    }
    for _ in range(40):
        now, events, few = 0.0, list[dict[str, Any]](), random.random() < 0.5
        for n in range(random.randint(1, 60)):
            now += random.choice([0, 1, 1, 1, 1, -2]) if random.random() < 0.9 else random.uniform(-9, 9)
            event = {
                "kind": random.choice("kww"),
                "value": random.choice([1, 1, 2, 3]),
                "at": now,
                "u": "a",
                "v": 1,
                "n": n,
            }
            if random.random() < (0.1 if few else 0.6):
                name = random.choice(list(wild))
                event[name] = random.choice(wild[name])
            if random.random() < 0.1:
                del event[random.choice(list(event))]
            events.append(event)
        data = lines(events).encode() + random.choice([b"", b"", b"{", b'{"u":1,"u":2}\n'])
        key, window, most = (
            Key.parse(keys.split()) if keys else None,
            random.choice([1, 2, 5, 100]),
            random.choice([2, 99]),
        )
        repeat = random.random() < 0.5
        plan = plan_of(TREE, semantics, repeat=repeat, key=key, order_by=order, window=window, max_keys=most)
        assert (block_reader(plan) is None) is (key is not None and semantics is Semantics.STRICT)
        outcome(plan, data)


class Counting(Listener):
    """Keeps the verdicts after every event."""

    every = True

    def __init__(self) -> None:
        self.said: list[Any] = []

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:  # noqa: ARG002 (the interface)
        self.events(watch, number, number, watch.monitors.verdicts)

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:
        self.said += [(watch.key, number, verdicts) for number in range(first, last + 1)]

    def change(self, change: VerdictChange) -> None:
        self.said.append((change.watch.key, change.number, change.verdicts))


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("order", [None, "at"])
@pytest.mark.parametrize("keys", ["", "u"])
def test_every_event_is_told_once_and_in_order(keys: str, order: str | None, semantics: Semantics) -> None:
    random = Random(f"{keys} {order} {semantics}")
    for repeat in (False, True):
        events = [{"kind": random.choice("kw"), "value": random.choice([1, 2]), "at": n, "u": 1} for n in range(40)]
        plan = plan_of(TREE, semantics, repeat=repeat, order_by=order, key=Key.parse([keys]) if keys else None)
        said = []
        for by_blocks in (False, True):
            run = TraceRun(plan, "log", [listener := Counting()], run_of(plan, Told()).totals, buffer=EventBuffer())
            list(pipeline.read([run], io.BytesIO(lines(events).encode()), "log", by_blocks=by_blocks))
            said.append(listener.said)
        assert said[0] == said[1]
        assert [number for _, number, _ in said[0]] == [*range(1, 41)]


@pytest.mark.parametrize("order", [None, "at"])
@pytest.mark.parametrize("end", ["", "\n", "\n\n\n", "\n{"])
def test_a_pause_is_at_the_end_of_lines_that_were_read(order: str | None, end: str) -> None:
    plan = plan_of(TREE, "scattered", order_by=order, window=7)
    events = [{"kind": "w" if n % 5 else "k", "value": n % 3, "at": n} for n in range(60)]
    data = b"\xef\xbb\xbf" + b"\n".join(
        json.dumps(event).encode() + b"\n" * (n % 7 == 0) for n, event in enumerate(events)
    )
    data += end.encode()
    pauses: list[tuple[int, int, Any]] = []

    def rest(run: TraceRun, stream: LinesRead) -> Any:
        try:
            reading = pipeline.read([run], stream, "log", line=stream.line + 1)
            going_on = (one for one in reading if one and not run.ended)
            pauses.extend((stream.offset, stream.line, pickle.dumps((run.state, run.number))) for _ in going_on)
        except TraceError as error:
            return run.number, run.watch.monitors.verdicts, run.watch.monitors.since, str(error)
        return run.number, run.watch.monitors.verdicts, run.watch.monitors.since, None

    whole = rest(run_of(plan, Told()), LinesRead(io.BytesIO(data)))
    assert len(pauses) > 3
    for offset, line, kept in pauses[:]:
        assert (data[:offset].count(b"\n"), data[offset - 1 :][:1] in (b"\n", b"")) == (line, True) or offset == len(
            data
        )
        stream = io.BytesIO(data)
        stream.seek(offset)
        again = run_of(plan, Told())
        again.restore(*pickle.loads(kept))
        assert rest(again, LinesRead(stream, offset=offset, line=line)) == whole


def test_what_has_to_see_every_event_as_it_stands() -> None:
    assert block_reader(plan_of(TREE)) is not None
    assert block_reader(plan_of(TREE, key=Key.parse(["robot.id"]))) is None
    assert block_reader(plan_of(TREE, order_by="header.stamp")) is None
    every = Told(every=True)
    every.whole = True
    list(pipeline.read([run_of(plan_of(TREE), every)], io.BytesIO(b'{"event": 1}'), "log"))
    assert every.said == [(1, {"event": 1})]


def test_what_comes_is_read_when_it_comes() -> None:
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as stream, os.fdopen(write_end, "wb", buffering=0) as given:
        run = run_of(plan_of(TREE), Told())
        given.write(b'{"kind": "k", "value": 1}\n{"kind"')
        reading = pipeline.read([run], stream, "log", live=True)
        assert (next(reading), run.number) == (True, 1)
        given.write(b': "k", "value": 2}\n')
        assert (next(reading), run.watch.monitors.verdicts) == (True, (Verdict.TRUE,))


def test_the_topic_and_time_of_a_match_are_known_where_no_pattern_has_them() -> None:
    data = b'{"kind":"k","value":1,"topic":"/a","time":5}\n{"kind":"w"}\n{"kind":"k","value":2,"topic":"/b","time":4}\n'
    [(_, number, *_, times)] = outcome(plan_of(TREE, "scattered"), data)[0]
    assert (number, times) == (3, {1: (5, "/a"), 3: (4, "/b")})


RISING = """time at as FORMAT late LATE; event e(v) = { kind: "k", value: v }; event f(v) = { kind: "w", value: v };
    semantics scattered; top sand a b c within 9 s; a on e(X); b on f(Y) when Y != X; c on e(X);"""
WRITTEN: Final[dict[str, list[Callable[[int], Any]]]] = {
    "s": [lambda t: t, lambda t: t - 150, float, lambda t: t / 10, lambda t: t + 0.5],
    "ms": [lambda t: t * 1000, lambda t: str(t * 1000)],
    "ns": [lambda t: t * 10**9, lambda t: 10**31 * (t % 9 == 8) + t],
    "iso8601": [
        lambda t: f"2024-01-01T00:{t // 60 % 60:02}:{t % 60:02}Z",
        lambda t: f"2024-01-01T00:{t // 60 % 60:02}:{t % 60:02}.5+0{t % 2}:00",
        lambda t: f"2024-01-{1 + t % 40:02} 10:00",
    ],
}
"""Ways to write a time of some seconds, of which some are unreadable, or fall where the seconds rise."""


@pytest.mark.ci
@pytest.mark.parametrize(
    ("form", "late", "repeat"), sampled(product(WRITTEN, ["0 s", "3 s", "1 min"], [False, True]), 5, ci=2)
)
def test_times_that_rise_are_taken_at_once(form: str, late: str, repeat: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_steps, "FEW", 2)
    random, seen = Random(f"{form} {late} {repeat}"), set[Doubt]()
    plan = plan_of(loads(RISING.replace("FORMAT", form).replace("LATE", late)), "scattered", repeat=repeat)
    for write in WRITTEN[form]:
        for _ in range(12):
            now, events, far = 100, list[dict[str, Any]](), random.choice([1, 4, 30])
            for _ in range(random.randint(1, 60)):
                now += random.choice([0, 0, 1, 1, 2, far]) - random.choice([1, 8, 70]) * (random.random() < 0.02)
                events.append({"kind": random.choice("kwo"), "value": random.choice("ab"), "at": write(now)})
                if random.random() < 0.03:
                    events[-1]["at"] = random.choice([None, "never", "2024-01-01T99:00:00Z", True, 1e300, [1]])
                if random.random() < 0.03:
                    del events[-1]["at"]
            data = lines(events).encode()
            exact = re.sub(rb'"at": ([0-9]+\.[0-9])', rb'"at": 17724384\g<1>0000012345678', data)
            for one in (data, exact):
                _, watched, *_ = outcome(plan, one)
                seen |= {reason for reason, _ in watched[2]}
    assert Doubt.TIME in seen
    assert late == "1 min" or Doubt.LATE in seen


ASSUMING = """time at as s; event e(v: TYPE, w) = { kind: "k", value: v, more: w }; event f(t: time) = { n: 1, u: t };
    assume types, present, exact; semantics scattered; top sand a b; a on e(V, W); b on f(_) when true = true;"""
ASSUMED = [1, 2.0, 2.5, 2**53, float(2**53), 9007199254740993.25, 2**70, True, None, "a", "7", [1], {"x": 1}, math.nan]


@pytest.mark.parametrize("type_", ["text", "number", "integer", "boolean", "any"])
@pytest.mark.parametrize("few", [True, False])
def test_assumptions_are_checked_alike_however_they_are_read(
    type_: str, few: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_steps, "FEW", 2)
    random = Random(f"{type_} {few}")
    for text in (ASSUMING.replace("TYPE", type_), ASSUMING.replace("TYPE", type_).replace("{ n: 1, u", '{ n: "n", u')):
        plan = plan_of(loads(text.replace(" when true = true", "")), "scattered", repeat=random.random() < 0.5)
        broken = 0
        for _ in range(15):
            events: list[dict[str, Any]] = [
                {
                    "kind": random.choice("kkw"),
                    "n": random.choice([1, 2, "n"]),
                    "at": n,
                    "u": n,
                    "value": 1,
                    "more": "x",
                }
                for n in range(random.randint(1, 30))
            ]
            for event in events:
                if random.random() < (0.1 if few else 0.6):
                    event[random.choice(["value", "more", "u"])] = random.choice(ASSUMED)
                if random.random() < 0.05:
                    del event[random.choice(["value", "more", "u", "kind"])]
            found = outcome(plan, lines(events).encode())
            broken += sum(one.count for (doubt, _), one in found[1][2].items() if doubt is Doubt.ASSUMPTION)
        assert broken


def test_assumptions_do_not_slow_down_the_reading_of_a_log() -> None:
    event = 'event e(v: text) = { kind: "k", value: v };'
    for assumed, quick in (("types, present, exact", True), ("case", False)):
        plan = plan_of(loads(f"{event} assume {assumed}; top sand a b; a on e(V); b on e(V);"))
        assert run_of(plan, Told()).assumes_in_bulk is quick


# -- keys
# ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("seed", range(2))
def test_each_key_gets_the_verdicts_and_matches_of_its_events_alone(seed: int, semantics: Semantics) -> None:
    tree, random = shipped.load("remote_inspection/pruned"), Random(seed)
    traces = dict(shipped.traces("remote_inspection/pruned"))
    turns = [name for name, events in traces.items() for _ in events]
    random.shuffle(turns)
    left = {name: iter(events) for name, events in traces.items()}
    run = run_of(plan_of(tree, semantics, key=Key.parse(["robot"])), Told())
    list(pipeline.read([run], [{**next(left[name]), "robot": name} for name in turns], "log"))
    assert {watch.key[0] for watch in run.watches if watch.key} == set(traces)
    for watch in run.watches:
        assert watch.key is not None
        [name] = watch.key
        given = [number for number, turn in enumerate(turns, 1) if turn == name]
        alone = monitor(tree, semantics=semantics)
        *_, last = alone.run(traces[name])
        assert watch.monitors.verdicts == (last,)
        explanation, own = watch.monitors.explanation(0), alone.explanation
        assert (explanation is None) is (own is None)
        if explanation is not None and own is not None:
            assert explanation.branch == own.branch
            assert explanation.matched == tuple(one._replace(event=given[one.event - 1]) for one in own.matched)
        if alone.ended is not None:
            assert watch.monitors.since[0] == given[alone.ended.event - 1]


def test_events_without_the_key_and_too_many_keys() -> None:
    run = run_of(plan_of(TREE, key=Key.parse(["robot.id", "x"]), max_keys=2), Told())
    log = [{"robot": {"id": None}, "x": 1}, {"robot": {"id": 1}}, {}, {"robot": {"id": 1}, "x": 1}]
    list(pipeline.read([run], log, "log"))
    assert [watch.key for watch in run.watches] == [(None, 1), (1, 1)]
    assert list(run.warnings) == ["2 events without the field robot.id or x, not monitored (first: event 2)"]
    with pytest.raises(TooLarge, match=r"different values of robot.id and x") as raised:
        list(pipeline.read([run], [{"robot": {"id": 1}, "x": 2}], "log"))
    assert raised.value.limit == 2


SAME = [(1, 1.0), ([1, 2], [1.0, 2]), ({"a": 1, "b": 2}, {"b": 2, "a": 1}), (2**60, float(2**60))]
OTHER = [(1, True), (0, False), ("1", 1), (None, False)]


@pytest.mark.parametrize(("pair", "values"), [*((one, 1) for one in SAME), *((one, 2) for one in OTHER)])
def test_keys_are_told_apart_as_everywhere(pair: tuple[Any, Any], values: int) -> None:
    for fields in (["k"], ["k", "m"]):
        run = run_of(plan_of(TREE, key=Key.parse(fields)), Told())
        list(pipeline.read([run], [{"k": value, "m": 1} for value in pair], "log"))
        assert len(run.watches) == values


@pytest.mark.parametrize("semantics", [None, *Semantics])
@pytest.mark.parametrize("options", [[], ["--key", "topic"], ["--order-by", "time"], ["--repeat", "--format", "jsonl"]])
def test_events_that_change_nothing_are_taken_at_once(
    semantics: Semantics | None,
    options: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    tree, log = ignoring_tree(tmp_path), tmp_path / "log.jsonl"
    inspections(log, 400, readings=1)
    odd, random = log.read_text(encoding="utf-8").splitlines(), Random(3)
    for number in (
        *range(150, 160),
        230,
        300,
    ):  # guards that are undefined, near misses, times that go back, what is relevant
        change: dict[str, Any] = random.choice(
            [{"waypoint": "x"}, {"value": 900.5}, {"waypoint": 7}, {"name": "Move"}, {"time": 2}, {"topic": [1]}]
        )
        odd[number] = json.dumps(json.loads(odd[number]) | change)
    log.write_text("\n".join(odd), encoding="utf-8")
    monkeypatch.setattr(json_blocks, "SIZE", 4000)
    arguments = ["monitor", str(tree), str(log), *options, *(["--semantics", semantics] if semantics else [])]
    told = []
    for few in (4, 10**9):
        monkeypatch.setattr(batch_steps, "FEW", few)
        status = main(arguments, standalone_mode=False)
        told.append((status, capsys.readouterr()))
    assert told[0] == told[1]


@pytest.mark.parametrize("by_blocks", [False, True])
def test_a_time_that_was_told_makes_earlier_events_of_known_keys_late(*, by_blocks: bool) -> None:
    tree = loads('time at as s late 1 s; event e(v) = { kind: "k", value: v }; top sand a b; a on e(1); b on e(2);')
    first: list[dict[str, Any]] = [{"kind": "k", "value": 3, "at": n, "u": "a"} for n in range(40)]
    plan = plan_of(tree, "scattered", key=Key.parse(["u"]))
    run = TraceRun(plan, "log", [], run_of(plan, Told()).totals, buffer=EventBuffer())
    for _ in range(2):  # the second batch is known to cause no warning
        list(pipeline.read([run], io.BytesIO(lines(first).encode()), "log", by_blocks=by_blocks))
        first = [{**event, "at": 40 + event["at"]} for event in first]
    run.pass_time(1_000)
    later = [{**event, "at": 80 + n, "u": "a" if n % 2 else "b"} for n, event in enumerate(first)]
    list(pipeline.read([run], io.BytesIO(lines(later).encode()), "log", by_blocks=by_blocks))
    found = run.totals.data_warnings.found
    assert [one.count for (doubt, _), one in found.items() if doubt is Doubt.LATE] == [20]


def test_a_wrong_line_among_irrelevant_ones_ends_a_log_with_lateness() -> None:
    tree = loads('time at as s late 1 s; event e(v) = { kind: "k", value: v }; top sand a b; a on e(1); b on e(2);')
    text = lines([{"kind": "k" if n % 9 == 0 else "w", "value": 1, "at": n} for n in range(60)])
    wrong = '{"kind": "k", "value": 1, "value": 2, "at": 60}\n'
    run = run_of(plan_of(tree, "scattered"), Told())
    with pytest.raises(TraceError, match="value"):
        list(pipeline.read([run], io.BytesIO((text + wrong + text).encode()), "log"))
    assert run.number == 60
    assert run.watch.monitors.engines[0].latest == 59 * 10**9
