"""`rvaft monitor`, from file to verdicts, beside what people would use instead, in one process and one run.

`pytest tests/benchmarks/test_monitoring.py -s` prints the table for logs of a tenth of the size, with `-m slow` for all of it. What is
asserted are ratios within the run: of the shortest times, for whatever else the machine does only ever adds to them.
"""

import contextlib
import io
import math
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final

import pytest

from rvaft.cli import main
from rvaft.model.verdict import Semantics
from rvaft.monitoring.near_misses import LOOKED_AT
from tests.benchmarks.logs import ENDING, TREE, Log, ignoring_tree, inspections, telemetry
from tests.benchmarks.peers import JSON, ORJSON, NotRun, Timing, reelay, rml, timed

TYPES: Final = ("move", "result", "inspect", "radiation", "goal")
"""The event types of the tree, in its order."""
RML_RATIO: Final = 40
"""Our events per second at least, as a multiple of those of the published RML monitor."""
Tool = Callable[[Log], Timing]


@dataclass(frozen=True, slots=True)
class Watched:
    """A log, the tree it is watched for, and for each semantics how many times the seconds of `orjson.loads` a monitor may take."""

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
    """The timings of one tool on one log."""

    tool: str
    run: Tool
    timings: list[Timing] = field(default_factory=list)
    reason: str = ""

    def measure(self, log: Log) -> None:
        """One more timing, unless the tool cannot run."""
        try:
            if not self.reason:
                self.timings.append(self.run(log))
        except NotRun as not_run:
            self.reason = str(not_run)

    @property
    def shortest(self) -> float:
        """Seconds per event in the best round."""
        return min(timing.seconds / timing.events for timing in self.timings)

    def line(self, log: str, base: float) -> str:
        """The row of the table; `base` is the median of seconds per event to compare with."""
        if not self.timings:
            return f"{log:17} {self.tool:26} not run: {self.reason}"
        events = self.timings[0].events
        seconds = median(timing.seconds for timing in self.timings)
        return f"{log:17} {self.tool:26} {events:9,} {seconds:9.3f} {events / seconds:12,.0f} {seconds / events / base:8.2f}"


HEADER: Final = f"{'log':17} {'tool':26} {'events':>9} {'seconds':>9} {'events/s':>12} {'x orjson':>8}"


def ours(watched: Watched, semantics: Semantics) -> Tool:
    """The command in this process: the tree is loaded, the log read, the verdicts and the summary written to memory."""

    def run(log: Log) -> Timing:
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
        return Timing(log.events, seconds)

    return run


def detected(watched: Watched, semantics: Semantics) -> bool:
    """Whether the tree is detected, with the last event; else it is lost."""
    return watched.ignoring or semantics is Semantics.SCATTERED


def check(lines: list[str], watched: Watched, semantics: Semantics) -> None:
    """The verdict, the event it changes at, the five events of the match, and all counts are what the log was made with."""
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
    warnings = [line for line in lines if line.startswith("warning: ")]
    assert len(warnings) == (log.near_misses > 0)
    for warning in warnings:
        near = re.search(r"near miss:\D* (\d+) events would be radiation", warning)
        assert near
        assert int(near[1]) == min(log.near_misses, LOOKED_AT)


def rows(watched: Watched, events: int) -> Iterator[Row]:
    """The tools on one log, `orjson` first; the published RML monitor sees so many events."""
    yield Row("orjson.loads", ORJSON)
    yield Row("json.loads", JSON)
    for semantics in watched.most:
        yield Row(f"rvaft monitor, {semantics}", ours(watched, semantics))
    yield Row("Reelay (Python)", reelay)
    for semantics in watched.most:
        yield Row(f"RML monitor, {semantics}", partial(rml, tree=watched.tree, semantics=semantics, events=events))


def too_slow(watched: Watched, measured: dict[str, Row], slack: float) -> list[str]:
    """What is not as fast as it has to be, given so much slack."""
    found = []
    base = measured["orjson.loads"].shortest
    for semantics, most in watched.most.items():
        mine = measured[f"rvaft monitor, {semantics}"].shortest
        if mine > slack * most * base:
            found.append(f"{watched.name}, {semantics}: {mine / base:.2f} x orjson.loads, at most {slack * most}")
        published = measured[f"RML monitor, {semantics}"]
        if not watched.ignoring and published.timings and slack * published.shortest < RML_RATIO * mine:
            times = published.shortest / mine
            found.append(f"{watched.name}, {semantics}: {times:.0f} x the RML monitor, at least {RML_RATIO / slack}")
    return found


def table(logs: list[Watched], *, rounds: int, events: int, slack: float) -> tuple[list[str], list[str]]:
    """The lines of the table, and what is too slow; a log on which something is gets as many rounds again."""
    lines, failures = [HEADER], []
    for watched in logs:
        measured = {row.tool: row for row in rows(watched, events)}
        for _ in range(2):
            for number in range(rounds):
                for row in list(measured.values())[:: -1 if number % 2 else 1]:
                    row.measure(watched.log)
            failed = too_slow(watched, measured, slack)
            if not failed:
                break
        failures += failed
        timings = measured["orjson.loads"].timings
        base = median(timing.seconds / timing.events for timing in timings)
        lines += [row.line(watched.name, base) for row in measured.values()]
    return lines, failures


def logs(folder: Path, share: int) -> list[Watched]:
    """The three logs, in one part of `share` of their full size."""
    ignoring = ignoring_tree(folder)
    own = {Semantics.PROJECTED: 2.0, Semantics.SCATTERED: 4.0}
    other = {Semantics.PROJECTED: 1.0, Semantics.SCATTERED: 1.0}
    rounds = inspections(folder / "inspections.jsonl", 300_000 // share)
    even = inspections(folder / "even.jsonl", 300_000 // share, readings=1)
    return [
        Watched("telemetry", telemetry(folder / "telemetry.jsonl", 1_000_000 // share), TREE, other),
        Watched("inspections", rounds, ignoring, own),
        Watched("inspections, even", even, ignoring, dict.fromkeys(own, math.inf)),  # told, and not asked for
    ]


def compare(
    folder: Path, capsys: pytest.CaptureFixture[str], *, share: int, rounds: int, events: int, slack: float = 1.0
) -> None:
    (warm := folder / "warm").mkdir()
    for watched in logs(warm, 100):  # imports, and what is made once
        for row in rows(watched, 10):
            row.measure(watched.log)
    lines, failures = table(logs(folder, share), rounds=rounds, events=events, slack=slack)
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(lines) + "\n")
    assert not failures, "\n".join(failures)


@pytest.mark.benchmark
def test_a_tenth_of_the_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # What is done once, to read the tree and to learn its states, weighs ten times as much here.
    compare(tmp_path, capsys, share=10, rounds=3, events=5_000, slack=2.0)


@pytest.mark.benchmark
@pytest.mark.slow
def test_the_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    compare(tmp_path, capsys, share=1, rounds=3, events=50_000)
