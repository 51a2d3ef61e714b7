"""`rvaft traces`: example logs that are what they are called, the same ones every time, whole or not there."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from rvaft import Semantics, Verdict, load
from rvaft.semantics import Reference
from tests.cli.runs import PRUNED, TREES, failed, process, run
from tests.trees import shipped

SAND = TREES / "gates" / "sand.rvaft"


def events(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def written(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.iterdir())}


def verdict(tree: Path, text: str, semantics: str = "projected", **part: Any) -> Verdict:
    return [Verdict.UNKNOWN, *Reference(load(tree), semantics, **part).run(events(text))][-1]


@pytest.mark.parametrize("name", shipped.names())
@pytest.mark.parametrize("semantics", Semantics)
def test_each_mode_writes_what_it_says(name: str, semantics: Semantics, tmp_path: Path) -> None:
    tree = TREES / f"{name}.rvaft"
    for mode in ("--detect", "--near-miss", "--random"):
        result = run("traces", tree, mode, "--semantics", semantics, "-o", tmp_path)
        assert (result.exit_code, result.output) == (0, "")
    logs = written(tmp_path)
    assert set(logs) == {f"{mode}-{i}.jsonl" for mode in ("detect", "near-miss", "random") for i in range(1, 6)}
    for i in range(1, 6):
        assert verdict(tree, logs[f"detect-{i}.jsonl"], semantics) is Verdict.TRUE
        assert verdict(tree, logs[f"near-miss-{i}.jsonl"], semantics) is not Verdict.TRUE


def test_detection_is_the_default_and_standard_output_takes_one() -> None:
    result = run("traces", PRUNED)
    assert (result.exit_code, result.stderr) == (0, "")
    assert verdict(PRUNED, result.stdout) is Verdict.TRUE
    assert run("traces", PRUNED, "--detect", "-n", 1, "-o", "-").stdout == result.stdout
    assert run("monitor", PRUNED, data=result.stdout).exit_code == 1


@pytest.mark.parametrize("options", [{"branch": 2}, {"branch": 3}, {"kind": "attack"}, {"kind": "fault"}])
def test_a_branch_or_a_kind(options: dict[str, Any], tmp_path: Path) -> None:
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    assert run("traces", PRUNED, *words, "-o", tmp_path).exit_code == 0
    assert all(verdict(PRUNED, text, **options) is Verdict.TRUE for text in written(tmp_path).values())


def test_the_same_options_give_the_same_traces_in_any_process(tmp_path: Path) -> None:
    folders = [tmp_path / str(seed) for seed in range(3)]
    for seed, folder in enumerate(folders):
        done = process("traces", PRUNED, "--near-miss", "-o", folder, env={**os.environ, "PYTHONHASHSEED": str(seed)})
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert written(folders[0]) == written(folders[1]) == written(folders[2])


@pytest.mark.parametrize("mode", ["--detect", "--near-miss", "--random"])
def test_seeds_differ_and_more_traces_leave_the_first_ones_alone(mode: str, tmp_path: Path) -> None:
    for folder, words in {"few": ["-n", 3], "many": ["-n", 8], "other": ["-n", 3, "--seed", 1]}.items():
        assert run("traces", PRUNED, mode, *words, "-o", tmp_path / folder).exit_code == 0
    few, many, other = (written(tmp_path / folder) for folder in ("few", "many", "other"))
    assert few == {name: many[name] for name in few}
    assert len(set(many.values())) == len(many) == 8
    assert not set(few.values()) & set(other.values())


def test_a_tree_with_one_trace_gives_it_again(tmp_path: Path) -> None:
    assert run("traces", SAND, "--semantics", "strict", "-n", 2, "-o", tmp_path).exit_code == 0
    word = "".join(f'{{"event": "{letter}"}}\n' for letter in "abc")
    assert written(tmp_path) == {"detect-1.jsonl": word, "detect-2.jsonl": word}


@pytest.mark.parametrize("mode", ["--detect", "--near-miss", "--random"])
def test_the_longest_length(mode: str, tmp_path: Path) -> None:
    assert run("traces", PRUNED, mode, "--length", 4, "-n", 12, "-o", tmp_path).exit_code == 0
    lengths = {len(events(text)) for text in written(tmp_path).values()}
    assert max(lengths) == 4
    assert min(lengths) > 0


def test_other_files_stay_and_those_of_the_same_name_are_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine.jsonl").write_text("{}\n")
    (tmp_path / "detect-1.jsonl").write_text("old")
    assert run("traces", SAND, "-n", 1, "-o", tmp_path).exit_code == 0
    logs = written(tmp_path)
    assert logs.keys() == {"detect-1.jsonl", "mine.jsonl"}
    assert logs["mine.jsonl"] == "{}\n"
    assert verdict(SAND, logs["detect-1.jsonl"]) is Verdict.TRUE


def test_nothing_is_written_where_a_trace_is_not_found(tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    tree.write_text("event e(x) = { x: x }; top and a b; a on e(X) when X > 5; b on e(X) when X < 5;")
    for mode in ("--detect", "--near-miss"):
        result = run("traces", tree, mode, "-o", tmp_path / "logs")
        failed(result, str(tree), "100 attempts", "guards of a and b do not hold", "--seed")
    assert not (tmp_path / "logs").exists()
    assert run("traces", tree, "--random", "-o", tmp_path / "logs").exit_code == 0


def test_words_beyond_ascii_are_read_back(tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    tree.write_text('top sand "ärger" "雪";', encoding="utf-8")
    result = run("traces", tree, "--semantics", "strict")
    assert result.stdout == '{"event": "ärger"}\n{"event": "雪"}\n'
    assert run("monitor", tree, data=result.stdout.encode()).exit_code == 1


WRONG_USE: dict[str, tuple[list[object], list[str]]] = {
    "no tree": ([], ["TREE"]),
    "unknown tree": (["nowhere.rvaft"], ["nowhere.rvaft", "No such file"]),
    "two trees": ([SAND, SAND], ["sand.rvaft"]),
    "none": ([SAND, "-n", "0"], ["'-n'", "0"]),
    "fewer than none": ([SAND, "-n", "-1", "-o", "x"], ["'-n'", "-1"]),
    "no number": ([SAND, "-n", "many"], ["'many'"]),
    "several without a folder": ([SAND, "-n", "2"], ["2 traces", "-o"]),
    "several to standard output": ([SAND, "-n", "2", "-o", "-"], ["2 traces", "-o"]),
    "two modes": ([SAND, "--detect", "--near-miss"], ["--detect and --near-miss exclude"]),
    "two other modes": ([SAND, "--random", "--near-miss"], ["--near-miss and --random exclude"]),
    "branch and kind": ([PRUNED, "--branch", "1", "--kind", "fault"], ["--branch and --kind"]),
    "no such branch": ([PRUNED, "--branch", "5"], ["branch 5"]),
    "no such kind": ([SAND, "--kind", "fault"], ["fault"]),
    "unknown semantics": ([SAND, "--semantics", "weak"], ["'weak'", "scattered"]),
    "a seed that is no number": ([SAND, "--seed", "x"], ["'x'"]),
    "no length": ([SAND, "--length", "0"], ["--length", "0"]),
    "too short": ([SAND, "--length", "2"], ["shortest scenario met has 3 events", "--length"]),
    "a tree that breaks a rule": ([TREES / "remote_inspection" / "listing.rvaft"], ["NewWp", "[unbound-variable]"]),
    "a folder as a tree": ([TREES], ["Is a directory"]),
}


@pytest.mark.parametrize("case", WRONG_USE)
def test_wrong_use(case: str) -> None:
    words, parts = WRONG_USE[case]
    result = run("traces", *words)
    failed(result, *parts)
    assert result.stdout == ""


def test_a_folder_that_cannot_be_made_or_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    failed(run("traces", SAND, "-o", tmp_path / "file"), "file: cannot make the folder")
    failed(run("traces", SAND, "-o", tmp_path / "no" / "where"), "where: cannot make the folder: No such file")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "detect-2.jsonl").mkdir()
    failed(run("traces", SAND, "-o", tmp_path / "full"), "detect-2.jsonl", "cannot write")
    assert (tmp_path / "file").read_text() == "kept"
    assert {path.name for path in (tmp_path / "full").iterdir()} == {"detect-1.jsonl", "detect-2.jsonl"}


def test_a_folder_without_permission(tmp_path: Path) -> None:
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555)
    if os.access(folder, os.W_OK):
        pytest.skip("this user may write everywhere")
    failed(run("traces", SAND, "-o", folder), "locked", "Permission denied")
