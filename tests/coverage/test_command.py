"""`rvaft coverage`: what it prints and its exit status."""

import gzip
import json
from pathlib import Path

import pytest

from rvaft import TooLarge, load, loads
from rvaft.coverage import Coverage, table_text
from tests.cli.runs import PRUNED, TREES, failed, run

WORDS = "top or x y v; x sand a b kx; y and c d; v 2of3 e f g; kx fault; y attack;"
VALUES = "event n(v) = { v: v }; event m(w) = { w: w }; top sand a b; a on n(X); b on m(X);"
CHOICES = f"top and {' '.join(f'g{n}' for n in range(20))}; " + " ".join(f"g{n} or a{n} b{n};" for n in range(20))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the tree and the logs of a test are."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree").write_text(WORDS)
    return tmp_path


def log(name: str, words: str) -> str:
    data = "".join(f'{{"event": "{word}"}}\n' for word in words.split()).encode()
    Path(name).write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return name


def rows(text: str) -> dict[str, str]:
    """The rows of the table by branch."""
    lines = (line.split(maxsplit=1) for line in text.splitlines())
    return {words[0]: " ".join(words[1].split()) for words in lines if words and words[0].isdigit()}


def test_what_was_detected_and_what_was_waited_for() -> None:
    logs = log("1.jsonl", "noise a b"), log("2.jsonl.gz", "g noise e")
    result = run("coverage", "tree", *logs)
    assert (result.exit_code, result.stderr) == (0, "")
    assert rows(result.stdout) == {
        "1": "fault 2 of 3 0 of 2 1.jsonl, event 3; waits for kx",
        "2": "attack 0 of 2 0 of 2 waits for c or d",
        "3": "- 2 of 2 1 of 2 detected: 2.jsonl.gz, event 3",
    }
    assert "each log is read afresh" in result.stdout.splitlines()[-3]
    assert "each log is read afresh" not in run("coverage", "tree", logs[0]).stdout
    ends = ["nodes never seen: kx, c, d, f", "branches exercised 1 of 3 (33%); nodes seen 4 of 8"]
    assert result.stdout.splitlines()[-2:] == ends
    value = json.loads(run("coverage", "tree", *logs, "--format", "json").stdout)
    branches = value.pop("branches")
    assert value == {
        "format": "rvaft-coverage",
        "version": 1,
        "semantics": "projected",
        "logs": 2,
        "infeasible": [],
        "unseen": [{"node": name, "event": name} for name in ("kx", "c", "d", "f")],
        "data_warnings": [],
        "totals": {"branches": 3, "exercised": 1, "nodes": 8, "seen": 4},
    }
    waits = {"waits_for": [{"node": "kx", "event": "kx"}]}
    counts = {"needed": 3, "reached": 2, "detected": 0, "log": "1.jsonl", "event": 3}
    assert branches[0] == {"branch": 1, "kinds": ["fault"], **counts, **waits}
    told = [(branch["reached"], branch["detected"], branch["log"], branch["event"]) for branch in branches[1:]]
    assert told == [(0, 0, None, None), (2, 1, "2.jsonl.gz", 3)]


@pytest.mark.parametrize(
    ("semantics", "reached"), [("strict", [0, 0, 0]), ("projected", [1, 0, 0]), ("scattered", [2, 1, 1])]
)
def test_the_semantics_decides(semantics: str, reached: list[int]) -> None:
    path = log("1.jsonl", "noise a d e b")
    value = json.loads(run("coverage", "tree", path, "--semantics", semantics, "--format", "json").stdout)
    assert [branch["reached"] for branch in value["branches"]] == reached


@pytest.mark.parametrize("option", ["--branch=2", "--kind=attack"])
def test_one_branch_or_one_kind(option: str) -> None:
    result = run("coverage", "tree", log("1.jsonl", "c d"), option)
    assert list(rows(result.stdout)) == ["2"]
    assert result.stdout.splitlines()[-1] == "branches exercised 1 of 1 (100%); nodes seen 2 of 2"


@pytest.mark.parametrize(("percent", "status"), [("0", 0), ("33.3", 0), ("33.4", 1), ("100", 1)])
def test_too_little_coverage_is_status_1(percent: str, status: int) -> None:
    assert run("coverage", "tree", log("1.jsonl", "c d"), "--fail-under", percent).exit_code == status


def test_what_cannot_be_asked_is_refused() -> None:
    """NaN above all, which no coverage is under."""
    path = log("1.jsonl", "c d")
    failed(run("coverage", "tree", path, "--branch", "2", "--kind", "attack"), "exclude each other")
    failed(run("coverage", "tree", path, "--branch", "7"), "there is no branch 7")
    failed(run("coverage", "tree"), "LOG")
    for percent in ("nan", "inf", "-inf", "-1", "100.1", "half"):
        failed(run("coverage", "tree", path, "--fail-under", percent), "--fail-under", percent.replace("nan", "NaN"))


def test_without_any_log_that_counts_there_is_no_table() -> None:
    Path("bad.jsonl").write_text("[]\n")
    result = run("coverage", "tree", "bad.jsonl", "none.jsonl", "--fail-under", "50")
    assert (result.exit_code, len(result.stderr.splitlines())) == (2, 2)
    assert result.stdout == "no log could be used; branches: 3, nodes: 8\n"
    assert json.loads(run("coverage", "tree", "bad.jsonl", "--format", "json").stdout)["logs"] == 0
    empty = run("coverage", "tree", log("empty.jsonl", ""))
    assert list(rows(empty.stdout)) == ["1", "2", "3"], "an empty log is a log"


def test_a_malformed_log_does_not_count_and_the_others_do(folder: Path) -> None:
    bad, short, good = log("bad.jsonl", "c d"), log("short.jsonl.gz", "a b kx"), log("good.jsonl", "e f")
    (folder / bad).write_text((folder / bad).read_text() + "[]\n")
    (folder / short).write_bytes((folder / short).read_bytes()[:-9])
    result = run("coverage", "tree", bad, "none.jsonl", short, good, "--fail-under", "100")
    assert result.exit_code == 2
    told = (f"{bad}:3: not a JSON object", "No such file", short)
    assert [part in line for part, line in zip(told, result.stderr.splitlines(), strict=True)] == [True] * 3
    assert result.stdout.splitlines()[-1] == "branches exercised 1 of 3 (33%); nodes seen 2 of 8"


def test_patterns_and_standard_input() -> None:
    log("1.log", "c d")
    log("2.log", "e f")
    result = run("coverage", "tree", "*.log", "-", data='{"event": "a"}\n')
    assert rows(result.stdout) == {
        "1": "fault 1 of 3 0 of 3 <stdin>, event 1; waits for b",
        "2": "attack 2 of 2 1 of 3 detected: 1.log, event 2",
        "3": "- 2 of 2 1 of 3 detected: 2.log, event 2",
    }


def test_it_is_readable_at_80_columns() -> None:
    coverage = Coverage(load(PRUNED))
    name = "a-folder/with-a-name/of-some-length/and-more/and-a-file-with-an-even-longer-name.jsonl"
    coverage.add(name, [{"topic": "/command", "name": "move", "waypoint": 1, "time": 1}])
    text = table_text(coverage.report(), width=80)
    assert max(map(len, text.splitlines())) <= 80
    assert "waits for ev3 inspect(Waypoint)" in " ".join(text.split())
    assert "longer-name.jsonl" in "".join(text.split())


@pytest.mark.ci
def test_what_is_too_much_is_an_error_that_says_what_to_do(folder: Path) -> None:
    empty = log("empty.jsonl", "")
    (folder / "tree").write_text(CHOICES)
    failed(run("coverage", "tree", empty), "a monitor for each branch of top", "--branch", "prune")
    assert run("coverage", "tree", empty, "--branch", "5").exit_code == 0
    failed(run("coverage", TREES / "gates" / "or.rvaft", empty, "--limit", "1"), "limit 1", "--limit allows more")
    names = " ".join(f"a{n}" for n in range(14))  # very many ways to keep children that others keep too
    with pytest.raises(TooLarge, match="ways to keep children of v, w, which share nodes"):
        Coverage(loads(f"top and v w; v 7of14 {names}; w 7of14 {names};"))


def test_a_log_with_too_many_partial_matches_is_named_and_does_not_count(folder: Path) -> None:
    """With the event, and the option that allows more."""
    (folder / "tree").write_text(VALUES)
    (folder / "large").write_text('{"noise": 1}\n' + "".join(f'{{"v": {number}}}\n' for number in range(10)))
    (folder / "small").write_text('{"v": 1}\n')
    found = run("coverage", "tree", "large", "small", "--semantics", "scattered", "--max-configurations", "5")
    assert found.exit_code == 2
    (error,) = found.stderr.splitlines()
    assert error.endswith("(limit 5); at event 6 of large; --max-configurations allows more")
    assert rows(found.stdout) == {"1": "- 1 of 2 0 of 1 small, event 1; waits for b m(X)"}
    assert run("coverage", "tree", "large", "small", "--semantics", "scattered").exit_code == 0


def test_a_branch_that_nothing_can_detect_does_not_count(folder: Path) -> None:
    (folder / "tree").write_text("top or bad c; bad sand x y; x and a s; y and s b;")
    result = run("coverage", "tree", log("1.jsonl", "c"))
    assert list(rows(result.stdout)) == ["2"]
    ends = ["no feasible scenario: branch 1", "branches exercised 1 of 1 (100%); nodes seen 1 of 1"]
    assert result.stdout.splitlines()[-2:] == ends
