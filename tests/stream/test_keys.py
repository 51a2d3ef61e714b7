"""`--max-keys`: values of a key are forgotten where nothing of theirs can matter any more."""

from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import jsonl, lines, run, written

TREE = """
event tried(n) = { event: n };
time time as s late 1 s;
semantics scattered;
top sand tries ok within 10 s;
tries times 2 on tried("failed");
ok on tried("accepted");
"""


def rotating(count: int, *, detect: int = 50) -> list[dict[str, Any]]:
    """Sources that each fail twice, a second apart, of which some then succeed."""
    found = []
    for source in range(count):
        names = ["failed", "failed", *(["accepted"] if source % detect == 0 else []), "failed"]
        found += [{"time": source, "event": name, "ip": f"ip{source}"} for name in names]
    return found


@pytest.mark.ci
@pytest.mark.parametrize("options", [[], ["--repeat"], ["--jobs", "2"], ["--order-by", "time"]])
def test_rotating_values_end_no_monitor(options: list[str], tmp_path: Path) -> None:
    tree, log = written(tmp_path / "t.rvaft", TREE), written(tmp_path / "log.jsonl", lines(rotating(2_000)))
    words = tree, log, "--key", "ip", *options
    found = jsonl(*words, "--max-keys", "200", "--detections")
    assert found == jsonl(*words, "--detections")
    assert len(found) == 40
    result = run("monitor", *words, "--max-keys", "200")
    assert result.exit_code == 1
    assert "values of ip that detected nothing and whose windows had passed were forgotten" in result.stderr
    assert "begin with an event earlier" not in result.stderr


def test_a_value_that_may_have_been_forgotten_is_told(tmp_path: Path) -> None:
    tree = written(tmp_path / "t.rvaft", TREE)
    events = [*rotating(500, detect=1_000), {"time": 3, "event": "accepted", "ip": "ip3"}]
    result = run("monitor", tree, written(tmp_path / "log.jsonl", lines(events)), "--key", "ip", "--max-keys", "200")
    assert "1 values of ip begin with an event earlier than those of other values allow" in result.stderr
    assert f"(first: event {len(events)})" in result.stderr


@pytest.mark.parametrize(
    ("command", "tree"),
    [
        ("monitor", TREE.replace(" within 10 s", "")),  # no window: any event may matter
        ("monitor", TREE.replace(" late 1 s", "")),  # an older event may still come
        ("monitor", TREE.replace("within 10 s", "within 1 h")),  # the windows have not passed
        ("report", TREE),  # which has all values
    ],
)
def test_values_that_may_matter_are_not_forgotten(command: str, tree: str, tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", lines(rotating(500)))
    words = [written(tmp_path / "t.rvaft", tree), log, "--key", "ip", "--max-keys", "200"]
    words += ["-o", tmp_path / "report.html"] if command == "report" else []
    result = run(command, *words)
    assert result.exit_code == 2
    assert "different values of ip (limit 200); raise it with --max-keys N" in result.stderr


def test_what_is_forgotten_is_known_after_a_checkpoint(tmp_path: Path) -> None:
    tree, events = written(tmp_path / "t.rvaft", TREE), rotating(1_000)
    log = written(tmp_path / "log.jsonl", lines(events[:2_000]))
    words = "monitor", tree, log, "--key", "ip", "--max-keys", "200", "--checkpoint", tmp_path / "kept"
    assert run(*words).exit_code == 1
    written(log, lines([*events, {"time": 2, "event": "accepted", "ip": "ip2"}]))
    again = run(*words)
    assert again.exit_code == 1
    assert "values of ip that detected nothing" in again.stderr
    assert "1 values of ip begin with an event earlier" in again.stderr
