"""Several trees on one reading of a log: each is told and counts what it would alone."""

import io
import json
from collections.abc import Sequence
from itertools import product
from random import Random
from typing import Any, Final

import pytest

from rvaft import RVAFT, Semantics, TraceError, loads, monitor
from rvaft.errors import RvaftError, TooLarge
from rvaft.readers import json_blocks
from rvaft.stream import pipeline, sources
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import Key
from rvaft.stream.listeners import Listener
from rvaft.stream.monitor_set import MonitorSet, Per, columns
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from rvaft.stream.statistics import Statistics
from rvaft.stream.verdict_change import VerdictChange
from tests.tables import sampled

TREES: Final = (
    'event e(v) = { kind: "k", value: v }; top sand a b; a on e(V); b on e(W) when W > V;',
    'event e(v) = { kind: "k", value: v }; event f(v) = { kind: "w", value: v }; top and a b; a on e(V); b on f(V);',
    'time at as s; event f(v) = { kind: "w", value: v }; top sand a b within 5 s; a on f(1); b on f(V) when V >= 2;',
    'time at as ms late 2 ms; event e(v) = { kind: "k", value: v }; top sand a b; a on e(1); b on e(2);',
    'time at as s late 3 s; event f(v) = { kind: "w", value: v }; top or a b; a on f(3); b on f(2) times 2;',
    'event g(u) = { user: "u1", kind: u }; event h(v) = { kind: "/K", value: v }; top and a b; a on g(_); b on h(_);',
    "event n(v) = { value: v, flag: true }; top and a b; a on n(1); b on n(V) when V != 1;",
    'event e(v) = { kind: "k", value: v }; assume types, present; top a or b c; b on e(1); c on e(9);'.replace(
        "top a or b c", "top or b c"
    ),
    'event z() = { kind: "z", inner: { x: 1 } }; ignore z(); top and a b; a on z(); b;'.replace("ignore z(); ", ""),
    'event e(v) = { kind: "k", value: v }; ignore e(V) when V > 2; top sand a b; a on e(1); b on e(2);',
)
"""Trees with different fields, times, lateness, guards, and assumptions."""
KINDS: Final = ("k", "K", "w", "z", "x", "y", None)
VALUES: Final = (1, 2, 3, 2.5, "a", None, [1], float("nan"))


class Told(Listener):
    """Keeps what is told of changes, and with `every` of each event."""

    def __init__(self, *, every: bool, order: list[tuple[int, int]], place: int) -> None:
        self.every = every
        self.said: list[Any] = []
        self._order, self._place = order, place

    def event(self, watch: Any, number: int, event: Any) -> None:  # noqa: ARG002 (the interface)
        self.events(watch, number, number, watch.monitors.verdicts)

    def events(self, watch: Any, first: int, last: int, verdicts: Any) -> None:
        self.said += [(watch.key, number, verdicts) for number in range(first, last + 1)]

    def change(self, change: VerdictChange) -> None:
        self._order.append((change.number, self._place))
        found = {column: one.matched for column, one in change.explanations.items()}
        self.said.append((change.watch.key, change.number, change.verdicts, found, dict(change.lines)))


def plan_of(tree: RVAFT, semantics: Semantics, per: Per, *, repeat: bool, limit: int, **options: Any) -> MonitoringPlan:
    make = lambda part: monitor(part, semantics=semantics, limit=limit)  # noqa: E731
    return MonitoringPlan(MonitorSet(columns(tree, per), make, semantics, repeat=repeat), **options)


def run_of(plan: MonitoringPlan, told: Listener) -> TraceRun:
    types = plan.monitors.types
    types.others.clear()
    types.impossible.clear()
    totals = Totals(Statistics(types), DataWarnings(types))
    return TraceRun(plan, "log", [told], totals, buffer=EventBuffer(reads=plan.reads))


def outcome(run: TraceRun, told: Told, error: str | None) -> Any:
    statistics = run.totals.statistics
    assert statistics is not None
    counted = statistics.events, statistics.relevant, statistics.never_seen, statistics.near_misses, statistics.others
    keys = [(repr(watch.key), watch.monitors.verdicts, watch.events) for watch in run.watches]
    return told.said, counted, run.totals.data_warnings.found, keys, run.number, error, list(run.warnings)


def read(plans: Sequence[MonitoringPlan], data: bytes, *, every: bool, **options: Any) -> tuple[list[Any], list[Any]]:
    """What each run is told and counts, and the order of all that is told."""
    order: list[tuple[int, int]] = []
    told = [Told(every=every, order=order, place=place) for place in range(len(plans))]
    runs = [run_of(plan, one) for plan, one in zip(plans, told, strict=True)]
    errors: dict[int, str] = {}

    def failed(run: TraceRun, error: RvaftError) -> None:
        errors[id(run)] = str(error)

    left = None
    try:
        list(pipeline.read(runs, io.BytesIO(data), "log", failed=failed, **options))
    except (TraceError, TooLarge) as error:
        left = str(error)
    found = [outcome(run, one, errors.get(id(run), left)) for run, one in zip(runs, told, strict=True)]
    return found, order


def log_of(random: Random) -> bytes:
    lines = list[str]()
    now = 0
    for _ in range(random.randint(1, 60)):
        now += random.choice([0, 1, 1, 2, -3])
        event: dict[str, Any] = {
            "kind": random.choice(KINDS),
            "value": random.choice(VALUES),
            "at": now,
            "user": random.choice("uv"),
        }
        event |= {"user": "u1"} if random.random() < 0.1 else {}
        event |= {"inner": {"x": random.choice([1, 2])}} if random.random() < 0.3 else {}
        event |= {"flag": random.choice([True, 1, None])} if random.random() < 0.3 else {}
        for name in ("at", "value", "user"):
            if random.random() < 0.1:
                del event[name]
        lines.append(json.dumps(event))
        lines += [""] * (random.random() < 0.1)
    return "\n".join(lines).encode() + random.choice([b"", b"\n", b"\n{"])


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_blocks, "SIZE", 500)
    monkeypatch.setattr(sources, "BLOCK", 7)
    monkeypatch.setattr("rvaft.stream.batch_steps.FEW", 3)


OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "plain": {},
    "key": {"key": Key.parse(["user"])},
    "order": {"order_by": "at", "window": 4},
    "order and key": {"order_by": "at", "window": 4, "key": Key.parse(["user"])},
    "distinct": {"distinct": Key.parse(["at"])},
    "few keys": {"key": Key.parse(["value"]), "max_keys": 3},
}


@pytest.mark.parametrize(("semantics", "options", "per"), sampled(product(Semantics, OPTIONS, Per), 25, ci=2))
def test_each_tree_is_told_what_it_would_be_alone(semantics: Semantics, options: str, per: Per) -> None:
    random = Random(f"{semantics} {options} {per}")
    for _ in range(8):
        trees = random.sample(TREES, random.randint(2, 5))
        repeat, limit = random.random() < 0.6, random.choice([3, 100_000])
        plans = [plan_of(loads(tree), semantics, per, repeat=repeat, limit=limit, **OPTIONS[options]) for tree in trees]
        data, every = log_of(random), random.random() < 0.3
        how = {"by_blocks": random.random() < 0.7, "live": random.random() < 0.3}
        together, order = read(plans, data, every=every, **how)
        alone = [read([plan], data, every=every, **how)[0][0] for plan in plans]
        for one, own, tree in zip(together, alone, trees, strict=True):
            if own[5] is not None and "different values" in own[5]:
                continue  # which values came before one too many, is not counted alike
            # events after a failure are counted to the end of a batch
            compared = (0, 4, 5) if own[5] is not None and "too large" in own[5] else range(7)
            assert [one[at] for at in compared] == [own[at] for at in compared], tree
        if options == "plain":
            assert order == sorted(order)
