"""`rvaft monitor`, from file to verdicts, beside what people would use instead, in one process and one run.

`pytest tests/benchmarks/test_monitoring.py -s` prints the table for logs of a tenth of the size,
with `-m slow` for all of it. What is asserted are ratios within the run: of the shortest times, for
whatever else the machine does only ever adds to them. Imports and the start of other programs are
left out of all figures; the answer of each tool is compared with what is known of the log.
"""

import contextlib
import gc
import importlib
import io
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from random import Random
from statistics import median
from typing import Any, Final, cast

import orjson
import pytest

from cross_check.published import monpoly, r2u2
from rvaft import RVAFT, Monitor, NotExpressible, Semantics, Verdict, load, loads, monitor, translate
from rvaft.backend import backend
from rvaft.cli import main
from rvaft.model.values import Json
from rvaft.monitors import DetectionMonitor
from tests.benchmarks.conftest import Ratios
from tests.benchmarks.logs import (
    BOUND,
    ENDING,
    SSHD_TREE,
    TREE,
    Log,
    attacks,
    ignoring_tree,
    inspections,
    sshd,
    telemetry,
)

TYPES: Final = ("move", "result", "inspect", "radiation", "goal")
"""The event types of the tree, in its order."""
RML_RATIO: Final = 40
"""Our events per second at least, as a multiple of those of the published RML monitor."""
Tool = Callable[[Log], tuple[int, float]]
"""From a log to how many events it has read in how many seconds."""


class NotRun(Exception):
    """A tool that could not run, and why."""


@dataclass(frozen=True, slots=True)
class Watched:
    """A log, the tree it is watched for, and for each semantics how many times the seconds of
    `orjson.loads` a monitor may take.
    """

    name: str
    log: Log
    tree: Path
    most: dict[Semantics, float]

    @property
    def ignoring(self) -> bool:
        """Whether the tree ignores all of the log but its end."""
        return self.tree != TREE


@dataclass(slots=True)
class Row:
    """The timings of one tool on one log, in seconds for each event."""

    tool: str
    run: Tool
    events: int = 0
    timings: list[float] = field(default_factory=list)
    reason: str = ""

    def measure(self, log: Log) -> None:
        """One more timing, unless the tool cannot run."""
        try:
            if not self.reason:
                self.events, seconds = self.run(log)
                self.timings.append(seconds / self.events)
        except NotRun as not_run:
            self.reason = str(not_run)

    def line(self, log: str, base: float) -> str:
        """The row of the table; `base` is the median of seconds per event to compare with."""
        if not self.timings:
            return f"{log:17} {self.tool:26} not run: {self.reason}"
        each = median(self.timings)
        return (
            f"{log:17} {self.tool:26} {self.events:9,} {each * self.events:9.3f} {1 / each:12,.0f} {each / base:8.2f}"
        )


def timed(call: Callable[[], object]) -> float:
    """Seconds of the processor for a call, with nothing left over from what ran before."""
    gc.collect()
    start = time.process_time()
    call()
    return time.process_time() - start


# -- the others --------------------------------------------------------------------------------------------------------


def decoding(loads: Callable[[bytes], object]) -> Tool:
    """All lines of a log through a decoder, and no more than that."""

    def run(log: Log) -> tuple[int, float]:
        def read() -> None:
            with log.file.open("rb") as stream:
                for line in stream:
                    loads(line)

        return log.events, timed(read)

    return run


ATTACK: Final = f"""
{{topic: "/move_base/goal"}} and pre(once(
{{topic: "/command", name: "move"}} and pre(once(
{{topic: "/radiation_sensor_plugin/sensor_0", value >= {BOUND}}} and pre(once(
{{topic: "/command", name: "inspect"}} and pre(once(
{{topic: "/command", name: "move"}} or {{topic: "/move_base/result", result: "success"}}
))))))))
"""
"""The attack branches of the pruned tree under `scattered`, without what ties their variables together.

The same: the events, `result` "success", the bound of the reading, and that each comes strictly
after the one before (`pre` of `once`). Left out: the fault branches, whose guard compares two times
(Reelay has no arithmetic over data; its own time is counted in events); that both waypoints are
equal; that the waypoint of the goal is another one than that of the move (data references have to
be strings); that it is not "entrance", which no event has in these logs. A field that an event
lacks keeps its value in Reelay; no atom sees that here, for an event with its topic has all its
fields. So the formula demands less than the tree, and first holds with the last event of the logs,
as the tree is detected there.
"""


def reelay(log: Log) -> tuple[int, float]:
    """Reelay's monitor in Python (discrete time, a verdict for each event) on what `orjson` decodes."""
    try:
        module: Any = importlib.import_module("reelay")
    except ImportError as error:
        raise NotRun("the package reelay is not installed") from error
    monitor = module.discrete_timed_monitor(pattern=ATTACK, semantics="boolean", condense=False, y_name="holds")
    first = 0

    def run() -> None:
        nonlocal first
        with log.file.open("rb") as stream:
            for number, line in enumerate(stream, 1):
                event = orjson.loads(line)
                # Reelay cannot read a list where an atom names the field; such events are left out, in its favour.
                if event.get("name").__class__ is list:
                    continue
                if monitor.update(event)["holds"] and not first:
                    first = number

    seconds = timed(run)
    assert first == log.events
    return log.events, seconds


def rml(log: Log, tree: Path, semantics: Semantics, *, events: int) -> tuple[int, float]:
    """The published RML monitor as it comes (its own `monitor.pl`, silent) with the RML text of a
    tree, on the first events of a log.

    Of a log in which the tree is lost early, events of other types: the monitor stops with the event that loses it. The
    time to start it and to load the specification is measured, and taken off.
    """
    checkout = Path(os.environ.get("RML_MONITOR", ""))
    if not (checkout / "monitor.pl").is_file():
        raise NotRun("RML_MONITOR names no checkout of the monitor")
    swipl = shutil.which("swipl")
    if swipl is None:
        raise NotRun("swipl is not on the path")
    loaded = load(tree)
    try:
        text = backend("rml-prolog").translate(loaded, semantics).text
    except NotExpressible as error:
        raise NotRun(f"RML cannot express the tree under {semantics}") from error
    specification = log.file.with_suffix(".pl")
    specification.write_text(text, encoding="utf-8")
    prefix = log.file.with_suffix(".prefix")
    patterns: list[Any] = [relevant.pattern for relevant in loaded.alphabet]
    topics = tuple(f'"topic": "{dict(one.fields)["topic"].value}"'.encode() for one in patterns)
    with log.file.open("rb") as stream:
        kept = stream if loaded.ignores else (line for line in stream if not any(topic in line for topic in topics))
        lines = list(islice(kept, events))
    ending = log.file.read_bytes().splitlines(keepends=True)[-5:] if loaded.ignores else []
    command = [swipl, "-O", "-f", "none", "-p", f"monitor={checkout}", str(checkout / "monitor.pl"), "--"]
    command += [str(specification), str(prefix), "--silent"]

    def seconds(given: Iterable[bytes]) -> float:
        prefix.write_bytes(b"".join(given))
        start = time.perf_counter()
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        taken = time.perf_counter() - start
        said = "Execution terminated correctly" if ending else "Unmatched end of trace"
        assert said in done.stdout, done
        return taken

    return len(lines), seconds([*lines, *ending]) - seconds(ending)


def by_hand(log: Log) -> tuple[int, float]:
    """The attack branches of the pruned tree under `scattered`, as somebody would write them for
    this tree alone; the fault branches are left out.
    """
    found = 0

    def run() -> None:
        nonlocal found
        moved, new, inspected, high = set[Any](), set[Any](), False, False
        with log.file.open("rb") as stream:
            for number, line in enumerate(stream, 1):
                event = orjson.loads(line)
                topic = event.get("topic")
                if topic == "/command":
                    if event["name"] == "move":
                        moved.add(event["waypoint"])
                        if high:
                            new.add(event["waypoint"])
                    elif event["name"] == "inspect" and event["waypoint"] in moved:
                        inspected = True
                elif topic == "/radiation_sensor_plugin/sensor_0":
                    high = high or (inspected and event["value"] >= BOUND)
                elif topic == "/move_base/result":
                    if event["result"] == "success":
                        moved.add(event["waypoint"])
                elif topic == "/move_base/goal" and any(event["goal"] != one for one in new):
                    found = found or number

    seconds = timed(run)
    assert found == log.events
    return log.events, seconds


# -- ours ------------------------------------------------------------------------------------------------------------


def ours(watched: Watched, semantics: Semantics) -> Tool:
    """The command in this process: the tree is loaded, the log read, the verdicts and the summary written to memory."""

    def run(log: Log) -> tuple[int, float]:
        arguments = ["monitor", str(watched.tree), str(log.file), "--semantics", semantics.value]
        said = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
        complained = io.StringIO()
        status = None

        def call() -> None:
            nonlocal status
            status = main(arguments, standalone_mode=False)

        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
            seconds = timed(call)
        assert complained.getvalue() == ""
        assert isinstance(said.buffer, io.BytesIO)
        check(said.buffer.getvalue().decode().splitlines(), watched, semantics)
        assert status == int(detected(watched, semantics))
        return log.events, seconds

    return run


def detected(watched: Watched, semantics: Semantics) -> bool:
    """Whether the tree is detected, with the last event; else it is lost."""
    return watched.ignoring or semantics is Semantics.SCATTERED


def check(lines: list[str], watched: Watched, semantics: Semantics) -> None:
    """The verdict, the event it changes at, the five events of the match, and all counts are what
    the log was made with.
    """
    log = watched.log
    if detected(watched, semantics):
        changed, verdict, matched = log.events, "true", 5
        assert any(re.match(rf" +event {log.events}\b.* is ev9\b", line) for line in lines)
    else:
        changed, verdict, matched = log.lost, "false", 0
    assert lines[0] == f"event {changed}: {verdict}"
    assert sum(" is ev" in line for line in lines) == matched
    assert f"verdict {verdict} after {log.events} events" in lines
    types = ENDING if watched.ignoring else log.types
    counts = ", ".join(f"{name} {types[name]}" for name in TYPES)
    assert f"events read: {log.events}; relevant: {counts}" in lines
    assert not any(line.startswith("warning: ") for line in lines)


# -- the table
# -----------------------------------------------------------------------------------------------------------


def rows(watched: Watched, events: int) -> dict[str, Row]:
    """The tools on one log, `orjson` first; the published RML monitor sees so many events."""
    published = partial(rml, tree=watched.tree, events=events)
    tools: dict[str, Tool] = {
        "orjson.loads": decoding(orjson.loads),
        "json.loads": decoding(json.loads),
        **{f"rvaft monitor, {semantics}": ours(watched, semantics) for semantics in watched.most},
        "by hand, attacks": by_hand,
        "Reelay (Python)": reelay,
        **{f"RML monitor, {semantics}": partial(published, semantics=semantics) for semantics in watched.most},
    }
    return {tool: Row(tool, run) for tool, run in tools.items()}


def too_slow(watched: Watched, measured: dict[str, Row], slack: float) -> list[str]:
    """What is not as fast as it has to be, given so much slack."""
    found = []
    base = min(measured["orjson.loads"].timings)
    for semantics, most in watched.most.items():
        mine = min(measured[f"rvaft monitor, {semantics}"].timings)
        if mine > slack * most * base:
            found.append(f"{watched.name}, {semantics}: {mine / base:.2f} x orjson.loads, at most {slack * most}")
        published = min(measured[f"RML monitor, {semantics}"].timings, default=math.inf)
        if not watched.ignoring and slack * published < RML_RATIO * mine:
            found.append(
                f"{watched.name}, {semantics}: {published / mine:.0f} x the RML monitor, at least {RML_RATIO / slack}"
            )
    return found


def watched_logs(folder: Path, share: int) -> list[Watched]:
    """The three logs, in one part of `share` of their full size."""
    ignoring = ignoring_tree(folder)
    own = {Semantics.PROJECTED: 2.0, Semantics.SCATTERED: 2.5}
    rounds = inspections(folder / "inspections.jsonl", 300_000 // share)
    even = inspections(folder / "even.jsonl", 300_000 // share, readings=1)
    day = telemetry(folder / "telemetry.jsonl", 1_000_000 // share)
    return [
        Watched("telemetry", day, TREE, dict.fromkeys(own, 1.0)),
        Watched("inspections", rounds, ignoring, own),
        Watched("inspections, even", even, ignoring, dict.fromkeys(own, math.inf)),  # told, and not asked for
    ]


def require_fast(capsys: pytest.CaptureFixture[str], lines: Sequence[str], slow: Sequence[str]) -> None:
    """Show what was measured; nothing of it may be slow."""
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(lines) + "\n")
    assert not slow, "\n".join(slow)


@pytest.mark.benchmark
@pytest.mark.parametrize(
    "size",
    [
        # What is done once, to read the tree and to learn its states, weighs ten times as much here.
        pytest.param((10, 5_000, 2.0), id="a tenth"),
        pytest.param((1, 50_000, 1.0), id="all", marks=pytest.mark.slow),
    ],
)
def test_the_logs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios, size: tuple[int, int, float]
) -> None:
    """A log on which something is too slow gets as many rounds again."""
    share, events, slack = size
    (warm := tmp_path / "warm").mkdir()
    for watched in watched_logs(warm, 100):  # imports, and what is made once
        for row in rows(watched, 10).values():
            row.measure(watched.log)
    lines = [f"{'log':17} {'tool':26} {'events':>9} {'seconds':>9} {'events/s':>12} {'x orjson':>8}"]
    failures = []
    for watched in watched_logs(tmp_path, share):
        measured = rows(watched, events)
        failed: list[str] = []
        for number in range(6):
            if number < 3 or failed:
                for row in list(measured.values())[:: -1 if number % 2 else 1]:
                    row.measure(watched.log)
            if number in (2, 5):
                failed = too_slow(watched, measured, slack)
        failures += failed
        lines += [row.line(watched.name, median(measured["orjson.loads"].timings)) for row in measured.values()]
        for semantics, most in watched.most.items():
            mine = min(measured[f"rvaft monitor, {semantics}"].timings)
            for tool in ("orjson.loads", "Reelay (Python)", f"RML monitor, {semantics}"):
                least = min(measured[tool].timings, default=None)
                bound = slack * most if tool == "orjson.loads" and most < math.inf else None
                if least is not None:
                    ratios.add(f"{watched.name}, {semantics}", tool, mine / least, bound)
    require_fast(capsys, lines, failures)


# -- events that are all the tree's own -------------------------------------------------------------------------------


def forty_leaves(folder: Path) -> tuple[Path, Path]:
    """A tree of 40 leaves with guards in 8 branches, over 8 types of events, that is never
    detected; and a log of nothing but its own events.
    """
    gates = ("sand", "and", "sand", "sand", "and", "sand", "and", "sand")
    lines = [f'event e{n}(u, v) = {{ topic: "/t{n}", user: u, value: v }};' for n in range(8)]
    lines += ['event never(v) = { topic: "/never", value: v };', f"top or {' '.join(f'b{n}' for n in range(8))};"]
    for number, gate in enumerate(gates):
        leaves = " ".join(f"x{leaf}" for leaf in range(5 * number, 5 * number + 5))
        lines += [f"b{number} sand c{number} n{number}; c{number} {gate} {leaves}; n{number} on never(_);"]
    lines += [f"x{n} on e{3 * n % 8}(_, V{n}) when V{n} > {100 + n};" for n in range(40)]
    (tree := folder / "forty.rvaft").write_text("\n".join(lines), encoding="utf-8")
    random = Random(5)
    with (log := folder / "forty.jsonl").open("w", encoding="utf-8") as stream:
        for number in range(20_000):
            event = {"topic": f"/t{random.randrange(8)}", "time": number / 10, "user": random.randrange(20)}
            event |= {
                "value": random.randrange(140, 1000),
                "id": number,
                "data": {"x": random.random()},
                "frame": "map",
            }
            stream.write(json.dumps(event) + "\n")
    return tree, log


@pytest.mark.benchmark
def test_events_that_all_concern_the_tree(tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios) -> None:
    """In processor time, in turns: the paper's tree beside a monitor written by hand, one of 40
    leaves beside `orjson.loads`.
    """
    tree, log = forty_leaves(tmp_path)
    even = inspections(tmp_path / "even.jsonl", 200_000, readings=1)
    ignoring = ignoring_tree(tmp_path)

    def seconds(tree: Path, log: Path, semantics: str) -> float:
        with contextlib.redirect_stdout(io.StringIO()):
            return timed(
                lambda: main(["monitor", str(tree), str(log), "--semantics", semantics], standalone_mode=False)
            )

    bars: dict[str, tuple[Callable[[], float], Callable[[], float], float]] = {}
    forty = Log(log, 20_000, Counter(), 0)
    for semantics, by_hand_at_most, orjson_at_most in (("projected", 1.8, 8), ("scattered", 2.1, 8)):
        bars[f"the paper's tree, {semantics}, by hand"] = (
            partial(seconds, ignoring, even.file, semantics),
            lambda: by_hand(even)[1],
            by_hand_at_most,
        )
        bars[f"40 leaves, {semantics}, orjson.loads"] = (
            partial(seconds, tree, log, semantics),
            lambda: decoding(orjson.loads)(forty)[1],
            orjson_at_most,
        )
    lines, slow = [], []
    for name, (own, other, most) in bars.items():
        taken = [(own(), other()) for _ in range(4)]
        ratio = min(mine for mine, _ in taken) / min(its for _, its in taken)
        workload, compared = name.rsplit(", ", 1)
        ratios.add(workload, compared, ratio, most)
        lines.append(f"{name:45} {ratio:8.2f} x, at most {most}")
        if ratio > most:
            slow.append(lines[-1])
    require_fast(capsys, lines, slow)


def eight_sequences(folder: Path, events: int) -> tuple[Path, Path]:
    """A tree of 40 leaves in 8 sequences, each tied by its own variable, and the log of `forty_leaves` repeated."""
    _, short = forty_leaves(folder)
    lines = [f'event e{n}(u) = {{ topic: "/t{n}", user: u }};' for n in range(8)]
    lines += ['event never(v) = { topic: "/never", value: v };', f"top or {' '.join(f'b{n}' for n in range(8))};"]
    for number in range(8):
        lines.append(f"b{number} sand {' '.join(f'x{n}' for n in range(5 * number, 5 * number + 5))} n{number};")
        lines.append(f"n{number} on never(_);")
    lines += [f"x{n} on e{3 * n % 8}(U{n // 5});" for n in range(40)]
    (tree := folder / "eight.rvaft").write_text("\n".join(lines), encoding="utf-8")
    (log := folder / "eight.jsonl").write_bytes(short.read_bytes() * (events // 20_000))
    return tree, log


@pytest.mark.benchmark
@pytest.mark.slow
def test_consecutive_and_detections(tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios) -> None:
    """In multiples of `orjson.loads`: 40 leaves under `consecutive`, and the paper's tree with a detection in each ten
    events.
    """
    forty, _ = forty_leaves(tmp_path)
    eight, log = eight_sequences(tmp_path, 200_000)
    detecting, ignoring = attacks(tmp_path / "attacks.jsonl", 100_000), ignoring_tree(tmp_path)
    repeated = {"projected": 24, "consecutive": 24, "scattered": 36}
    bars = [
        ("40 leaves with guards", forty, log, "consecutive", (), 13),
        ("40 leaves in 8 sequences", eight, log, "consecutive", (), 13),
        *(("10,000 detections", ignoring, detecting, one, ("--repeat",), most) for one, most in repeated.items()),
    ]
    lines, slow = [], []
    for name, tree, file, semantics, options, most in bars:

        def own(words: tuple[str, ...] = ("monitor", str(tree), str(file), "--semantics", semantics, *options)) -> None:
            with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()):
                main(list(words), standalone_mode=False)
            assert "10000 detections in 100000 events" in said.getvalue() or "unknown after 200000" in said.getvalue()

        other = partial(decoding(orjson.loads), Log(file, 1, Counter(), 0))
        taken = [(timed(own), other()[1]) for _ in range(3)]
        ratio = min(mine for mine, _ in taken) / min(its for _, its in taken)
        ratios.add(f"{name}, {semantics}", "orjson.loads", ratio, most)
        lines.append(f"{name:26} {semantics:12} {ratio:8.1f} x, at most {most}")
        if ratio > most:
            slow.append(lines[-1])
    require_fast(capsys, lines, slow)


@pytest.mark.benchmark
@pytest.mark.parametrize("count", [20_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_a_detection_and_its_explanation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios, count: int
) -> None:
    """In the API, in multiples of `orjson.loads` of one event: with the ten events that it takes, and under
    `consecutive` beside the same events with another last one, which go as far and detect nothing.
    """
    tree, log = load(ignoring_tree(tmp_path)), attacks(tmp_path / "attacks.jsonl", count)
    events = [orjson.loads(line) for line in log.read_bytes().splitlines()]
    sent = [
        {**event, "goal": 2} if event.get("goal") == 3 else event for event in events
    ]  # to the waypoint of the move

    def own(semantics: str, events: Sequence[Json] = events, matched: int = 5 * count // 10) -> None:
        repeating, found = monitor(tree, semantics=semantics, repeat=True), 0
        for event in events:
            if repeating.step(event) is Verdict.TRUE and (explanation := repeating.explanation) is not None:
                found += len(explanation.matched)
        assert found == matched

    other = partial(decoding(orjson.loads), Log(log, count, Counter(), 0))
    runs = {one: partial(own, one) for one in ("projected", "consecutive", "scattered")}
    runs["without"] = partial(own, "consecutive", sent, 0)
    rounds = [({name: timed(run) for name, run in runs.items()}, other()[1]) for _ in range(4)]
    best = {name: min(taken[name] for taken, _ in rounds) for name in runs}
    best["beside its events"] = best["consecutive"] - best.pop("without")
    bars = {"projected": 80, "consecutive": 80, "scattered": 140, "beside its events": 45}
    lines, slow = [], []
    for name, most in bars.items():
        ratio = 10 * best[name] / min(its for _, its in rounds)
        ratios.add(f"a detection in the API, {name}", "orjson.loads of an event", ratio, most)
        lines.append(f"a detection in the API, {name:18} {ratio:8.1f} x, at most {most}")
        if ratio > most:
            slow.append(lines[-1])
    require_fast(capsys, lines, slow)


# -- joins by a variable, with times -----------------------------------------------------------------------------------

STEPS_TREE: Final = """event a(u) = { event: "a", user: u };
event b(u) = { event: "b", user: u };
event c(u) = { event: "c", user: u };
time time as s late 0 s;
semantics scattered;
top sand x y z within 10 s;
x on a(U); y on b(U); z on c(U);
"""
"""Three steps of one user within 10 s."""


def steps(file: Path, events: int) -> None:
    """Write steps of 100 users; three of four events are of the tree, and times never fall."""
    random, now = Random(4), 1_000.0
    with file.open("w", encoding="utf-8") as stream:
        for number in range(events):
            now += 0.05 + random.random() / 10
            event = {"time": round(now, 3), "event": random.choice("abcd"), "user": f"u{random.randrange(100)}"}
            event |= {"host": f"web-{random.randrange(30)}", "message": "something happened", "id": number}
            stream.write(json.dumps(event) + "\n")


@pytest.mark.benchmark
def test_values_that_events_share_and_their_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios
) -> None:
    """In multiples of `orjson.loads`: failures and a success of one address, all together and by key, and steps of
    one user; and in multiples of the time without them: lateness and assumptions.
    """
    attackers, users = tmp_path / "sshd.jsonl", tmp_path / "steps.jsonl"
    detections = sshd(attackers, 100_000).total()
    steps(users, 100_000)
    robot = telemetry(tmp_path / "robot.jsonl", 100_000).file
    watching = f'import "{TREE}";\nsemantics scattered;\n'
    trees = {
        "sshd": SSHD_TREE,
        "steps": STEPS_TREE,
        "assumed": f"{STEPS_TREE}assume types, present, exact;\n",
        "robot": f"{watching}time time as s;\n",
        "late": f"{watching}time time as s late 0 s;\n",
    }
    for name, text in trees.items():
        (tmp_path / f"{name}.rvaft").write_text(text, encoding="utf-8")

    def own(tree: str, log: Path, *options: str, found: int | None = None) -> float:
        words = ["monitor", str(tmp_path / f"{tree}.rvaft"), str(log), *options]
        with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()):
            taken = timed(lambda: main(words, standalone_mode=False))
        assert found is None or said.getvalue().count(": true") == found
        return taken

    def decoded(log: Path) -> float:
        return decoding(orjson.loads)(Log(log, 1, Counter(), 0))[1]

    loads_of = "orjson.loads"
    bars: list[tuple[str, str, Callable[[], float], Callable[[], float], float]] = [
        (
            "failures of one address",
            loads_of,
            lambda: own("sshd", attackers, "--repeat"),
            lambda: decoded(attackers),
            13,
        ),
        (
            "failures by key",
            loads_of,
            lambda: own("sshd", attackers, "--key", "ip", "--repeat", found=detections),
            lambda: decoded(attackers),
            26,
        ),
        ("steps of one user", loads_of, lambda: own("steps", users, "--repeat"), lambda: decoded(users), 17),
        (
            "steps of one user, assume",
            "without",
            lambda: own("assumed", users, "--repeat"),
            lambda: own("steps", users, "--repeat"),
            1.25,
        ),
        ("telemetry, late 0 s", "without", lambda: own("late", robot), lambda: own("robot", robot), 1.9),
    ]
    lines, slow = [], []
    for name, compared, mine, other, most in bars:
        taken = [(mine(), other()) for _ in range(4)]
        ratio = min(one for one, _ in taken) / min(one for _, one in taken)
        ratios.add(name, compared, ratio, most)
        lines.append(f"{name:28} {compared:14} {ratio:8.2f} x, at most {most}")
        if ratio > most:
            slow.append(lines[-1])
    require_fast(capsys, lines, slow)


# -- every way --------------------------------------------------------------------------------------------------------

WAYS: Final = {
    "file": ("monitor", "LOG"),
    "standard input": ("monitor", "-"),
    "--key": ("monitor", "LOG", "--key", "topic"),
    "--order-by": ("monitor", "LOG", "--order-by", "time"),
    "--format jsonl": ("monitor", "LOG", "--format", "jsonl"),
    "--checkpoint": ("monitor", "LOG", "--checkpoint", "KEPT"),
    "coverage": ("coverage", "LOG"),
}


@pytest.mark.benchmark
@pytest.mark.parametrize(("share", "slowest"), [(10, 2.0), pytest.param(1, 1.5, marks=pytest.mark.slow)])
def test_every_way_is_about_as_fast_as_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, share: int, slowest: float
) -> None:
    """In processor time, each way in turn; asserted are the ratios of the shortest times, of more
    rounds where three do not show it.
    """

    def seconds(way: str, watched: Watched) -> float:
        kept = tmp_path / "kept"
        kept.unlink(missing_ok=True)
        words = [{"LOG": str(watched.log.file), "KEPT": str(kept)}.get(word, word) for word in WAYS[way]]
        said = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True)
        gc.collect()
        with watched.log.file.open("rb") as stream, contextlib.redirect_stdout(said):
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(stream, encoding="utf-8"))
            start = time.process_time()
            assert main([words[0], str(watched.tree), *words[1:]], standalone_mode=False) in (0, 1)
            return time.process_time() - start

    lines, slow = [], []
    for watched in watched_logs(tmp_path, share)[:2]:
        best = dict.fromkeys(WAYS, math.inf)
        for number in range(6):
            if number < 3 or max(best.values()) > slowest * best["file"]:
                best = {way: min(known, seconds(way, watched)) for way, known in best.items()}
        for way, taken in best.items():
            ratio = taken / best["file"]
            lines.append(f"{watched.name:17} {way:26} {taken:9.3f} s {ratio:8.2f} x the file")
            if ratio > slowest:
                slow.append(lines[-1])
    require_fast(capsys, lines, slow)


def test_a_table_is_faster_than_the_engine() -> None:
    """Events of gates without variables, in processor time: half a million in a second, on a
    machine on which the engine does the same.
    """
    events = [{"event": "axyz"[number % 4], "n": number} for number in range(20_000)]

    def shortest(fresh: Callable[[], Monitor]) -> float:
        def run() -> float:
            monitor = fresh()
            monitor.step(events[0])
            return timed(lambda: [monitor.step(event) for event in events])

        return min(run() for _ in range(3))

    for text in ("top sand a b c;", "top or p q r; p sand a b c; q and d e f; r sand c d a;"):
        tree = loads(text)
        engine = shortest(lambda tree=tree: monitor(tree, semantics="scattered"))  # type: ignore[misc]
        table = shortest(lambda tree=tree: translate(tree, "automaton", semantics="scattered").monitor())  # type: ignore[misc]
        assert table < engine


@pytest.mark.benchmark
@pytest.mark.slow
def test_two_processes_read_one_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What two cores would take that nobody else uses, from the processor time of each process: at
    most 1 / 1.4 of one alone.
    """

    def taken(jobs: int) -> float:
        before = time.process_time(), os.times()
        with contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO(), encoding="utf-8")):
            main(["monitor", str(TREE), str(log.file), "--jobs", str(jobs)], standalone_mode=False)
        mine, after = time.process_time() - before[0], os.times()
        others = sum(after[2:4]) - sum(before[1][2:4])
        return max(mine, (mine + others) / 2) if jobs > 1 else mine

    log = telemetry(tmp_path / "log.jsonl", 1_000_000)
    one, two = (min(taken(jobs) for _ in range(3)) for jobs in (1, 2))
    with capsys.disabled():
        sys.stdout.write(f"\none process {one:.3f} s, two {two:.3f} s: {one / two:.2f} x\n")
    assert one / two > 1.4


# -- the tools of other languages ------------------------------------------------------------------------------------


def other_tools(tree: RVAFT) -> dict[str, Callable[[Sequence[Json]], int | None]]:
    """The tools that are there: `eql`, MonPoly and VeriMon (`MONPOLY`), and R2U2 (`R2U2`); each with the
    text of the tree in its language.
    """
    made = {name: translate(tree, name, semantics="scattered").text for name in ("eql", "mfotl", "mtl-r2u2")}
    found: dict[str, Callable[[Sequence[Json]], int | None]] = {}
    if find_spec("eql") is not None:
        query = cast("DetectionMonitor", backend("eql").read(made["eql"]))
        found["eql"] = lambda trace: query.first_detections([trace])[0]
    if (program := Path(os.environ.get("MONPOLY", ""))).is_file():
        for name, verified in (("MonPoly", False), ("VeriMon", True)):
            ask = partial(monpoly.first_detections, program, made["mfotl"], verified=verified, timeout=300)
            found[name] = lambda trace, ask=ask: ask([trace])[0]  # type: ignore[misc]
    if (bounded := Path(os.environ.get("R2U2", ""))).is_file():
        found["R2U2"] = lambda trace: r2u2.first_detections(bounded, made["mtl-r2u2"], [trace], timeout=300)[0]
    return found


@pytest.mark.benchmark
def test_the_tools_of_other_languages(capsys: pytest.CaptureFixture[str], ratios: Ratios) -> None:
    """A sequence that the last of 20,000 events detects, in processor time of all processes, with
    the start of programs; the engine takes less than each of them.
    """
    tree = loads("top sand a b c;")
    trace = [{"event": "a" if number % 5 == 0 else "x", "n": number} for number in range(20_000)]
    trace[-2:] = [{"event": "b"}, {"event": "c"}]

    def engine(events: Sequence[Json]) -> int | None:
        verdicts = monitor(tree, semantics="scattered").run(events)
        return next((number for number, verdict in enumerate(verdicts, 1) if verdict is Verdict.TRUE), None)

    def taken(tool: Callable[[Sequence[Json]], int | None]) -> float:
        gc.collect()
        before = os.times()
        assert tool(trace) == len(trace)
        return sum(os.times()[:4]) - sum(before[:4])

    engine(trace)
    own = min(taken(engine) for _ in range(5))
    lines = [f"{'rvaft':10} {own:8.3f} s"]
    for name, tool in other_tools(tree).items():
        other = min(taken(tool) for _ in range(2))
        ratios.add("a sequence in 20,000 events, scattered", name, own / other, 1.0)
        lines.append(f"{name:10} {other:8.3f} s, {other / own:.0f} times as long")
        assert own < other, name
    require_fast(capsys, lines, [])
