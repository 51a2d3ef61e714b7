"""`rvaft coverage`: what it prints and its exit status."""

import gzip
import json
from pathlib import Path

import pytest

from rvaft import TooLarge, loads
from rvaft.coverage import Coverage, table_text
from tests.cli.runs import PRUNED, TREES, failed, run

WORDS = "top or x y v; x sand a b kx; y and c d; v 2of3 e f g; kx fault; y attack;"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    path = tmp_path / "tree.rvaft"
    path.write_text(WORDS)
    return path


def log(folder: Path, name: str, words: str) -> Path:
    path = folder / name
    data = "".join(f'{{"event": "{word}"}}\n' for word in words.split()).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


def rows(text: str) -> dict[str, list[str]]:
    """The rows of the table by branch, as words."""
    return {words[0]: words[1:] for line in text.splitlines() if (words := line.split()) and words[0].isdigit()}


def test_the_table_says_what_was_detected_and_what_was_waited_for(tree: Path, tmp_path: Path) -> None:
    first, second = log(tmp_path, "1.jsonl", "noise a b"), log(tmp_path, "2.jsonl.gz", "g noise e")
    result = run("coverage", tree, first, second)
    assert (result.exit_code, result.stderr) == (0, "")
    flat = " ".join(result.stdout.split())
    assert f"1 fault 2 of 3 0 of 2 {first}, event 3; waits for kx" in _folded(flat, first)
    assert "2 attack 0 of 2 0 of 2 waits for c or d" in flat
    assert f"3 - 2 of 2 1 of 2 detected: {second}, event 3" in _folded(flat, second)
    assert result.stdout.splitlines()[-2:] == [
        "nodes never seen: kx, c, d, f",
        "branches exercised 1 of 3 (33%); nodes seen 4 of 8",
    ]


def _folded(flat: str, path: Path) -> str:
    """The text with a path in one piece where the table had to break it."""
    pieces = str(path)
    for cut in range(1, len(pieces)):
        flat = flat.replace(f"{pieces[:cut]} {pieces[cut:]}", pieces)
    return flat


def test_json_says_the_same(tree: Path, tmp_path: Path) -> None:
    first, second = log(tmp_path, "1.jsonl", "noise a b"), log(tmp_path, "2.jsonl", "g noise e")
    result = run("coverage", tree, first, second, "--format", "json")
    value = json.loads(result.stdout)
    assert (value["format"], value["version"], value["semantics"], value["logs"]) == (
        "rvaft-coverage",
        1,
        "projected",
        2,
    )
    assert value["branches"][0] == {
        "branch": 1,
        "kinds": ["fault"],
        "needed": 3,
        "reached": 2,
        "detected": 0,
        "log": str(first),
        "event": 3,
        "waits_for": [{"node": "kx", "event": "kx"}],
    }
    assert value["branches"][1]["log"] is None
    assert [(b["reached"], b["detected"], b["event"]) for b in value["branches"]] == [
        (2, 0, 3),
        (0, 0, None),
        (2, 1, 3),
    ]
    assert value["unseen"] == [{"node": name, "event": name} for name in ("kx", "c", "d", "f")]
    assert value["totals"] == {"branches": 3, "exercised": 1, "nodes": 8, "seen": 4}


@pytest.mark.parametrize(
    ("semantics", "reached"), [("strict", [0, 0, 0]), ("projected", [1, 0, 0]), ("scattered", [2, 1, 1])]
)
def test_the_semantics_decides(tree: Path, tmp_path: Path, semantics: str, reached: list[int]) -> None:
    path = log(tmp_path, "1.jsonl", "noise a d e b")
    value = json.loads(run("coverage", tree, path, "--semantics", semantics, "--format", "json").stdout)
    assert [branch["reached"] for branch in value["branches"]] == reached


def test_one_branch_or_one_kind(tree: Path, tmp_path: Path) -> None:
    path = log(tmp_path, "1.jsonl", "c d")
    for options in (["--branch", "2"], ["--kind", "attack"]):
        result = run("coverage", tree, path, *options)
        assert list(rows(result.stdout)) == ["2"]
        assert result.stdout.splitlines()[-1] == "branches exercised 1 of 1 (100%); nodes seen 2 of 2"
    failed(run("coverage", tree, path, "--branch", "2", "--kind", "attack"), "exclude each other")
    failed(run("coverage", tree, path, "--branch", "7"), "there is no branch 7")


@pytest.mark.parametrize(("percent", "status"), [("0", 0), ("33.3", 0), ("33.4", 1), ("100", 1)])
def test_too_little_coverage_is_status_1(tree: Path, tmp_path: Path, percent: str, status: int) -> None:
    path = log(tmp_path, "1.jsonl", "c d")
    assert run("coverage", tree, path, "--fail-under", percent).exit_code == status


@pytest.mark.parametrize("percent", ["nan", "inf", "-inf", "-1", "100.1", "half"])
def test_what_is_no_percentage_is_refused(tree: Path, tmp_path: Path, percent: str) -> None:
    """NaN above all, which no coverage is under."""
    failed(run("coverage", tree, log(tmp_path, "1.jsonl", "c d"), "--fail-under", percent), "--fail-under", percent)


def test_without_any_log_that_counts_there_is_no_table(tree: Path, tmp_path: Path) -> None:
    bad = log(tmp_path, "bad.jsonl", "c d")
    bad.write_text("[]\n")
    result = run("coverage", tree, bad, tmp_path / "none.jsonl", "--fail-under", "50")
    assert (result.exit_code, len(result.stderr.splitlines())) == (2, 2)
    assert result.stdout == "no log could be used; branches: 3, nodes: 8\n"
    assert json.loads(run("coverage", tree, bad, "--format", "json").stdout)["logs"] == 0
    empty = run("coverage", tree, log(tmp_path, "empty.jsonl", ""))
    assert list(rows(empty.stdout)) == ["1", "2", "3"], "an empty log is a log"


def test_a_malformed_log_does_not_count_and_the_others_do(tree: Path, tmp_path: Path) -> None:
    bad, good = log(tmp_path, "bad.jsonl", "c d"), log(tmp_path, "good.jsonl", "e f")
    bad.write_text(bad.read_text() + "[]\n")
    short = log(tmp_path, "short.jsonl.gz", "a b kx")
    short.write_bytes(short.read_bytes()[:-9])
    result = run("coverage", tree, bad, tmp_path / "none.jsonl", short, good, "--fail-under", "100")
    assert result.exit_code == 2
    errors = result.stderr.splitlines()
    assert len(errors) == 3
    assert f"{bad}:3: not a JSON object" in errors[0]
    assert "No such file" in errors[1]
    assert str(short) in errors[2]
    assert result.stdout.splitlines()[-1] == "branches exercised 1 of 3 (33%); nodes seen 2 of 8"


def test_patterns_and_standard_input(tree: Path, tmp_path: Path) -> None:
    log(tmp_path, "1.log", "c d")
    log(tmp_path, "2.log", "e f")
    result = run("coverage", tree, tmp_path / "*.log", "-", data='{"event": "a"}\n')
    assert {row: words[3:6] for row, words in rows(result.stdout).items()} == {
        "1": ["3", "0", "of"],
        "2": ["2", "1", "of"],
        "3": ["2", "1", "of"],
    }
    assert "<stdin>, event 1; waits for b" in result.stdout
    failed(run("coverage", tree), "LOG")


def test_it_is_readable_at_80_columns() -> None:
    events = [{"topic": "/command", "name": "move", "waypoint": 1, "time": 1}]
    from rvaft import load

    coverage = Coverage(load(PRUNED))
    coverage.add("a-folder/with-a-name/of-some-length/and-more/and-a-file-with-an-even-longer-name.jsonl", events)
    text = table_text(coverage.report(), width=80)
    assert max(map(len, text.splitlines())) <= 80
    assert "waits for ev3 inspect(Waypoint)" in " ".join(text.split())
    assert "longer-name.jsonl" in "".join(text.split())


def test_too_many_branches_are_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    gates = " ".join(f"g{n} or a{n} b{n};" for n in range(20))
    path = tmp_path / "tree.rvaft"
    path.write_text(f"top and {' '.join(f'g{n}' for n in range(20))}; {gates}")
    empty = log(tmp_path, "empty.jsonl", "")
    failed(run("coverage", path, empty), "a monitor for each branch of top", "--branch", "prune")
    assert run("coverage", path, empty, "--branch", "5").exit_code == 0
    with pytest.raises(TooLarge):
        Coverage(loads("top or a b c;"), limit=2)
    failed(run("coverage", TREES / "gates" / "or.rvaft", empty, "--limit", "1"), "limit 1", "--limit allows more")


def test_too_many_partial_matches_leave_the_log_out() -> None:
    tree = loads("event n(v) = { v: v }; event m(w) = { w: w }; top sand a b; a on n(X); b on m(X);")
    coverage = Coverage(tree, "scattered", configurations=5)
    with pytest.raises(TooLarge):
        coverage.add("log", [{"v": number} for number in range(10)])
    assert coverage.report().logs == 0
    assert coverage.report().seen == 0


def test_a_log_with_too_many_partial_matches_is_named(tmp_path: Path) -> None:
    """With the event, and the option that allows more."""
    path = tmp_path / "tree.rvaft"
    path.write_text("event n(v) = { v: v }; event m(w) = { w: w }; top sand a b; a on n(X); b on m(X);")
    large, small = tmp_path / "large.jsonl", tmp_path / "small.jsonl"
    large.write_text('{"noise": 1}\n' + "".join(f'{{"v": {number}}}\n' for number in range(10)))
    small.write_text('{"v": 1}\n')
    found = run("coverage", path, large, small, "--semantics", "scattered", "--max-configurations", "5")
    assert found.exit_code == 2
    (error,) = found.stderr.splitlines()
    assert error.endswith(f"(limit 5); at event 6 of {large}; --max-configurations allows more")
    assert list(rows(found.stdout)) == ["1"]
    assert run("coverage", path, large, small, "--semantics", "scattered").exit_code == 0


def test_a_branch_that_nothing_can_detect_does_not_count(tmp_path: Path) -> None:
    path = tmp_path / "tree.rvaft"
    path.write_text("top or bad c; bad sand x y; x and a s; y and s b;")
    result = run("coverage", path, log(tmp_path, "1.jsonl", "c"))
    assert list(rows(result.stdout)) == ["2"]
    assert result.stdout.splitlines()[-2:] == [
        "no feasible scenario: branch 1",
        "branches exercised 1 of 1 (100%); nodes seen 1 of 1",
    ]


def test_keeping_children_of_shared_thresholds_has_a_limit() -> None:
    """Each of these gates has very many ways to keep children that others keep too."""
    names = " ".join(f"a{n}" for n in range(14))
    tree = loads(f"top and v w; v 7of14 {names}; w 7of14 {names};")
    with pytest.raises(TooLarge, match="ways to keep children of v, w, which share nodes"):
        Coverage(tree)
