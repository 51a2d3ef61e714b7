"""`--merge`: several files of one recording, in the order of their times."""

from pathlib import Path
from random import Random

import pytest

from tests.cli.pages import data_of, fetched
from tests.cli.runs import SAND, failed, jsonl, lines, run, started, written

TREE = "time t as s; semantics scattered; top sand a b c within 10 s;"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    return written(tmp_path / "tree.rvaft", TREE)


def test_files_of_several_formats_are_one_log(tree: Path, tmp_path: Path) -> None:
    one = written(tmp_path / "one.jsonl", lines([{"event": "a", "t": 1}, {"event": "x"}, {"event": "c", "t": 9}]))
    other = written(tmp_path / "other.csv", "t,event\n5,b\n")
    found = run("monitor", tree, one, other, "--merge")
    assert found.output.splitlines()[:5] == [
        "event 4: true",
        "  branch 1",
        "  event 1 at 1 is a",
        "  event 3 at 5 is b",
        "  event 4 at 9 is c",
    ]
    assert run("monitor", tree, one, other).exit_code == 0
    wrong = written(tmp_path / "wrong.csv", "t,event\n5,b\n6\n")
    assert f"{wrong}:3: 1 field, but the header has 2" in run("monitor", tree, one, wrong, "--merge").stderr


def test_a_page_shows_files_as_one_log(tree: Path, tmp_path: Path) -> None:
    one = written(tmp_path / "one.jsonl", lines([{"event": "a", "t": 1}, {"event": "c", "t": 9}]))
    other = written(tmp_path / "other.jsonl", lines([{"event": "b", "t": 5}]))
    apart, merged = run("report", tree, one, other), run("report", tree, one, other, "--merge")
    assert (apart.exit_code, merged.exit_code) == (0, 1)
    assert data_of(merged.output)["traces"] == [f"{one} and {other}"]
    with started("view", tree, one, other, "--merge") as running:
        served = fetched(running.stdout.readline().split()[-1])
    assert served["at"] == data_of(merged.output)["at"] == [2]
    failed(run("view", tree, one, other, "--merge", "--follow"), "merged is not one")


def test_a_log_that_was_dealt_out_is_monitored_as_before(tree: Path, tmp_path: Path) -> None:
    random = Random("merge")
    events = [{"event": random.choice("abcx"), "t": number} for number in range(3_000)]
    hands: list[list[dict[str, object]]] = [[], [], []]
    for event in events:
        random.choice(hands).append(event)
    whole = written(tmp_path / "whole.jsonl", lines(events))
    files = [written(tmp_path / f"{number}.jsonl", lines(hand)) for number, hand in enumerate(hands)]
    options = ["--repeat", "--detections"]
    expected, found = (
        [(one["event"], [match["event"] for match in one["matched"]]) for one in jsonl(*call, *options)]
        for call in ([tree, whole], [tree, *files, "--merge"])
    )
    assert len(found) > 100
    assert found == expected


def test_what_cannot_be_merged_is_refused(tree: Path, tmp_path: Path) -> None:
    log = written(tmp_path / "one.jsonl", lines([{"event": "a", "t": 1}]))
    failed(run("monitor", SAND, log, log, "--merge"), "add `time FIELD as FORMAT;` to each tree")
    failed(run("monitor", tree, log, "-", "--merge"), "--merge is for files")
    failed(run("monitor", tree, log, log, "--merge", "--native"), "--native does not take --merge")
    failed(run("monitor", tree, log, log, "--merge", "--follow"), "merged is not one")
