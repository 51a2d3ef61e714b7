"""Monitors that begin afresh after each detection: what the reference says of the events since,
whichever way the events are read.
"""

import json
import pickle
import shlex
import signal
from collections.abc import Iterator
from itertools import islice, product
from pathlib import Path
from random import Random
from typing import Any

import pytest

import rvaft
from rvaft.engine import Engine
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Explanation
from rvaft.semantics import Reference
from rvaft.stream.monitor_set import MonitorSet, columns
from tests.cli.runs import SAND, jsonl, lines, run, soon, started, written
from tests.engine.checking import check_explanation, small_valid_trees
from tests.engine.dense import SHAPES, dense_trace, dense_tree
from tests.tables import sampled

TIMED = """
time t as s late 2 s;
event e(n) = { event: n };
top or fast slow; fast sand a either within 2 s fault; either or b x; slow pand c d within 3 s attack; a times 2;
"""
TIMES: list[dict[str, Any]] = [{"event": name, "t": time} for name in "abcdx" for time in range(6)]


def expected(tree: RVAFT, semantics: str, trace: list[dict[str, Any]]) -> Iterator[tuple[Verdict, int]]:
    """The verdict after each event, and how many events a fresh monitor has not read; what is late
    depends on all of the trace.
    """
    reference, begun = Reference(tree, semantics), 0
    for number, event in enumerate(trace, 1):
        yield reference.step(event), begun
        if reference.verdict is Verdict.TRUE:
            latest, begun = reference._latest, number
            reference = Reference(tree, semantics)
            reference._latest = latest


def require_match(tree: RVAFT, semantics: str, trace: list[dict[str, Any]], begun: int, found: Explanation) -> None:
    """The explanation is one of the events since then, which have their numbers in the whole trace."""
    numbers = tuple(one._replace(event=one.event - begun) for one in found.matched)
    own = Explanation(found.branch, found.kinds, numbers, found.variables, found.scenario)
    late = [
        max([0, *(one.get("t", 0) for one in trace[:place])]) - event.get("t", 0) > 2
        for place, event in enumerate(trace)
    ]
    in_time = [{} if is_late else event for event, is_late in zip(trace, late, strict=True)]
    check_explanation(tree, in_time[begun:], semantics, own)


@pytest.mark.parametrize(
    ("shape", "semantics"), sampled(product(["plain", "shared", "variables", "timed"], Semantics), 3)
)
def test_it_says_what_the_reference_says_when_it_begins_afresh_after_each_detection(shape: str, semantics: str) -> None:
    """A monitor, one that is copied and pickled all the time, and a set of monitors that is kept and goes on."""
    random = Random(f"{shape} {semantics}")
    made = (lambda: rvaft.loads(TIMED)) if shape == "timed" else lambda: dense_tree(random, SHAPES[shape])
    detected = 0
    for tree in islice(small_valid_trees(made), 3):
        trace = (
            [random.choice(TIMES) for _ in range(24)] if shape == "timed" else dense_trace(random, SHAPES[shape], 24)
        )
        straight, moved = (rvaft.monitor(tree, semantics=semantics, repeat=True) for _ in range(2))
        fresh = MonitorSet(columns(tree), lambda part: Engine(part, semantics), Semantics(semantics), repeat=True)
        monitors = fresh.fork()
        for number, ((verdict, begun), event) in enumerate(
            zip(expected(tree, semantics, trace), trace, strict=True), 1
        ):
            moved = pickle.loads(pickle.dumps(moved)).fork()
            monitors = fresh.resumed(pickle.loads(pickle.dumps(monitors.snapshot)))
            changed = monitors.step(event, number)
            assert straight.step(event) is moved.step(event) is monitors.verdicts[0] is verdict
            assert straight.state == moved.state
            assert straight.pending() == moved.pending()
            if verdict is Verdict.TRUE:
                detected += 1
                assert straight.explanation is not None
                assert straight.explanation == moved.explanation == monitors.explanation(0)
                require_match(tree, semantics, trace[:number], begun, straight.explanation)
                monitors.begin_again()
                assert monitors.verdicts == (Verdict.UNKNOWN,)
            assert bool(changed) is (verdict is Verdict.TRUE or monitors.since.get(0) == number)
        counted = straight.detections, moved.detections, monitors.found[0].notified
    assert len(set(counted)) == 1
    assert detected or shape != "timed" or Semantics(semantics).ends


@pytest.mark.parametrize("options", ["", "--per kind", "--per branch --cooldown 3s"])
def test_each_key_repeats_as_in_a_log_of_its_own(options: str, tmp_path: Path) -> None:
    """Several fields are one key; what one key has detected silences no other; the numbers of
    events are those of the log.
    """
    random, words = Random(options), [*shlex.split(options), "--semantics", "scattered", "--repeat"]
    tree, log = written(tmp_path / "tree.rvaft", TIMED), tmp_path / "log.jsonl"
    events = [{**random.choice(TIMES), "t": at // 9, "user": random.choice("uv"), "ip": at % 2} for at in range(150)]
    events = sorted(events, key=lambda event: event["t"] + random.random())
    written(log, lines(events))
    told = jsonl(tree, log, *words, "--key", "user", "--key", "ip", "--detections")
    for user, ip in product("uv", (0, 1)):
        places = [place for place, event in enumerate(events, 1) if (event["user"], event["ip"]) == (user, ip)]
        alone = jsonl(tree, written(tmp_path / "own", lines([events[at - 1] for at in places])), *words, "--detections")
        for one in alone:
            one["event"] = one["line"] = places[one["event"] - 1]
            for match in (m for part in (one, *one.get("columns", {}).values()) for m in part.get("matched", ())):
                match["event"] = match["line"] = places[match["event"] - 1]
        mine = [dict(one) for one in told if one["key"] == {"user": user, "ip": ip}]
        for one in mine:
            del one["key"]
        assert mine == alone
    assert len(told) > 8


ENDINGS = [
    ("--semantics scattered", "a b c a b", "1 detection in 5 events, the last at event 3", 1),
    ("--semantics consecutive", "a b b c", "0 detections in 4 events", 0),
    ("", "a b c b", "1 detection in 4 events, the last at event 3; false since event 4", 1),
    (
        "--per branch",
        "a b c a",
        "1 detection in 4 events, the last at event 3\n  MONITOR  DETECTIONS  LAST  FALSE SINCE",
        1,
    ),
    ("--semantics strict --backend ltlf", "a b c a b c", "2 detections in 6 events, the last at event 6", 1),
]


@pytest.mark.parametrize(("options", "word", "said", "status"), ENDINGS)
def test_the_summary_counts_the_detections(options: str, word: str, said: str, status: int) -> None:
    result = run("monitor", SAND, "--repeat", "--word", word, *options.split())
    assert (result.exit_code, result.stderr) == (status, "")
    assert f"{said}\n" in result.stdout


def test_the_summary_of_many_traces_and_keys(tmp_path: Path) -> None:
    """One process or several; where a monitor has detected nothing, and where it never can any more."""
    tree = written(tmp_path / "tree.rvaft", "top or a s; a attack; s sand b c fault;")
    logs = [
        written(tmp_path / f"{n}.jsonl", lines([{"event": e, "k": e < "c"} for e in word]))
        for n, word in enumerate(["abcax", "xc"])
    ]
    one, many = (run("monitor", tree, *logs, "--repeat", "--jobs", jobs) for jobs in (1, 2))
    assert (one.exit_code, one.stdout) == (many.exit_code, many.stdout)
    *_, head, first, second, total = (line.split() for line in one.stdout.splitlines())
    assert head == ["TRACE", "EVENTS", "DETECTIONS", "LAST", "FALSE", "SINCE", "BRANCH", "KINDS"]
    assert first[1:] == ["5", "3", "4", "-", "1", "attack"]
    assert second[1:] == ["2", "0", "-", "2", "-", "-"]
    assert total == ["detections:", "3"]
    wide = run("monitor", tree, logs[0], "--repeat", "--key", "k", "--per", "kind", "--semantics", "scattered")
    assert [" ".join(line.split()) for line in wide.stdout.splitlines()[-3:-1]] == [
        "true 3 2, last 4 0 2, last 4 1 attack",
        "false 2 0 0 0 - -",
    ]


def test_a_growing_log_and_commands_tell_every_detection(tmp_path: Path) -> None:
    told, log = tmp_path / "told", written(tmp_path / "log.jsonl", lines([{"event": name} for name in "abcab"]))
    words = ["--repeat", "--semantics", "consecutive", "--follow", "--format", "jsonl", "--detections"]
    with started("monitor", SAND, log, *words, "--exec", f"cat >> {told}") as running:
        assert json.loads(running.stdout.readline())["detection"] == 1
        with log.open("a") as stream:
            stream.write(lines([{"event": name} for name in "cxabc"]))
        assert [json.loads(running.stdout.readline())["event"] for _ in range(2)] == [6, 10]
        assert soon(lambda: told.read_text().count("\n") == 3)  # the last command, too, has been started
        running.send_signal(signal.SIGTERM)
        assert running.wait(timeout=30) == 1
    assert [(one["event"], one["detection"]) for one in map(json.loads, told.read_text().splitlines())] == [
        (3, 1),
        (6, 2),
        (10, 3),
    ]
