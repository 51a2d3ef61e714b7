"""`--distinct`: an event whose id came before is skipped, however a log is read."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from rvaft.stream.keys import DistinctEvents, Key
from tests.cli.runs import SAND, failed, jsonl, lines, run, started, written


def events(*named: tuple[str, Any]) -> list[dict[str, Any]]:
    return [{"event": name} if number is None else {"event": name, "id": number} for name, number in named]


DOUBLED = events(("a", 1), ("a", 1), ("b", 2), ("a", 1), ("b", 2.0), ("c", "2"))


@pytest.mark.parametrize(
    ("semantics", "without", "skipping"), [("projected", "false", "true"), ("consecutive", "unknown", "true")]
)
def test_a_doubled_message_hides_no_detection(semantics: str, without: str, skipping: str, tmp_path: Path) -> None:
    twice = written(tmp_path / "twice.jsonl", lines(events(("a", 1), ("b", 2), ("b", 2), ("c", 3))))
    assert jsonl(SAND, twice, "--semantics", semantics)[-1]["verdict"] == without
    assert jsonl(SAND, twice, "--semantics", semantics, "--distinct", "id")[-1]["verdict"] == skipping
    log = written(tmp_path / "log.jsonl", lines(DOUBLED))
    words = SAND, log, "--semantics", semantics
    *_, last = jsonl(*words, "--distinct", "id")
    assert (last["verdict"], last["event"], last["line"]) == (skipping, 3, 6)
    assert [one["line"] for one in last["matched"]] == [1, 3, 6]
    result = run("monitor", *words, "--distinct", "id")
    assert (result.exit_code, result.stderr) == (
        1,
        "rvaft: warning: 3 events skipped, whose id came before (first: line 2)\n",
    )
    assert "events read: 3; relevant: a 1, b 1, c 1" in result.stdout


def test_formats_order_backends_and_pages(tmp_path: Path) -> None:
    """Each format has the field, or is refused."""
    records = written(tmp_path / "log.json", json.dumps({"Records": DOUBLED}))
    assert jsonl(SAND, records, "--distinct", "id")[-1]["verdict"] == "true"
    table = "event,id\n" + "".join(f"{one['event']},x{one['id']:.0f}\n" for one in DOUBLED[:-1]) + "c,x3\n"
    doors = written(tmp_path / "log.csv", table)
    assert jsonl(SAND, doors, "--distinct", "id")[-1]["verdict"] == "true"
    failed(run("monitor", SAND, doors, "--distinct", "number"), "number")
    timed = [{**event, "time": -place} for place, event in enumerate(DOUBLED[::-1])]
    log = written(tmp_path / "timed.jsonl", lines(timed))
    assert jsonl(SAND, log, "--distinct", "id", "--order-by", "time")[-1]["verdict"] == "true"
    assert run("monitor", SAND, records, "--distinct", "id", "--backend", "ltlf").exit_code == 1
    page = run("report", SAND, records, "--distinct", "id", "-o", tmp_path / "page.html")
    assert (page.exit_code, "3 events skipped" in page.stderr) == (1, True)
    for option, why in (("--native", "--native does not take --distinct"), ("--engine=duckdb", "a query reads every")):
        failed(run("monitor", SAND, log, option, "--distinct", "id"), why)
    failed(run("monitor", SAND, log, "--max-distinct", 3), "--max-distinct needs --distinct")
    failed(run("monitor", SAND, log, "--distinct", "a..b"), "'a..b' is not a field")


def test_an_event_without_an_id_is_not_skipped(tmp_path: Path) -> None:
    odd = [None, True, [1], {"n": 1}]
    log = written(tmp_path / "log.jsonl", lines([{"event": "x", "id": value} for value in odd * 2] + [{"event": "x"}]))
    result = run("monitor", SAND, log, "--distinct", "id")
    assert "events read: 9" in result.stdout
    assert result.stderr == ("rvaft: warning: 9 events without a text or number in id, never skipped (first: line 1)\n")
    nan = written(log, '{"event": "a", "id": NaN}\n' * 2)
    assert "events read: 2" in run("monitor", SAND, nan, "--distinct", "id").stdout


def test_an_id_is_one_of_its_key_and_may_have_several_fields(tmp_path: Path) -> None:
    numbers = [
        {"event": name, "device": device, "id": n} for n, name in enumerate("abc") for device in (1, 2) for _ in "ab"
    ]
    log = written(tmp_path / "log.jsonl", lines(numbers))
    for words in (
        ["--key", "device", "--distinct", "id"],
        ["--key", "device", "--distinct", "id", "--distinct", "device"],
    ):
        assert run("monitor", SAND, log, *words).stdout.count("device=1: event") == 1
    alone = run("monitor", SAND, log, "--distinct", "id", "--distinct", "device", "--semantics", "scattered")
    assert "6 events skipped, whose id and device came before" in alone.stderr


def test_the_memory_is_bounded_and_the_bound_is_said(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", lines(events(("a", 1), ("b", 2), ("a", 1), ("c", 3))))
    for most, verdict in ((1, "false"), (2, "true")):
        result = run("monitor", SAND, log, "--distinct", "id", "--max-distinct", most)
        assert f"verdict {verdict}" in result.stdout
        assert f"more than {most} ids in id, of which the oldest are forgotten" in result.stderr
    assert "forgotten" not in run("monitor", SAND, log, "--distinct", "id", "--max-distinct", 3).stderr
    distinct = DistinctEvents(Key.parse(["id"]), None, 10)
    assert all(distinct.is_new({"id": "long" * 10_000 + str(number)}) for number in range(1000))
    ids, *_ = distinct.state
    assert (len(ids), {len(one) for one in ids}) == (10, {16})


def test_a_checkpoint_knows_the_ids(tmp_path: Path) -> None:
    log, state = written(tmp_path / "log.jsonl", lines(DOUBLED[:3])), tmp_path / "state"
    words = "monitor", SAND, log, "--checkpoint", state
    assert "1 event skipped" in run(*words, "--distinct", "id").stderr
    with log.open("a") as stream:
        stream.write(lines(DOUBLED[3:]))
    failed(run(*words), "of a run with --distinct id, not without --distinct")
    again = run(*words, "--distinct", "id")
    assert (again.exit_code, "event 3 (line 6): true" in again.stdout) == (1, True)
    assert "3 events skipped, whose id came before (first: line 2)" in again.stderr


def test_a_growing_log(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", lines(DOUBLED[:2]))
    with started("monitor", SAND, log, "--follow", "--distinct", "id") as running:
        with log.open("a") as stream:
            stream.write(lines(DOUBLED[2:]))
        assert running.stdout.readline() == "event 3 (line 6): true\n"
        running.send_signal(signal.SIGTERM)
        assert running.wait(timeout=30) == 1
        assert "3 events skipped" in running.stderr.read()
