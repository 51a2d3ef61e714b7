"""`rvaft test`: a tree's own traces against the verdicts expected of them."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.cli.runs import TREES, failed, run, written


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "door.traces").mkdir()
    written(tmp_path / "door.traces" / "in.jsonl", '{"event": "a"}\n{"event": "b"}\n')
    return written(tmp_path / "door.rvaft", "door sand a b;\n")


def test_the_shipped_trees_are_as_they_say() -> None:
    result = run("test", *sorted((TREES / "gates").glob("*.rvaft")), TREES / "vehicle" / "takeover.rvaft")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("6 trees, 36 traces, ")
    assert result.stdout.endswith("; all as expected\n")


def test_expectations_are_written_compared_and_written_again(tree: Path) -> None:
    failed(run("test", tree), "door.verdicts.json: no verdicts are expected yet; --update writes them")
    assert run("test", tree, "--update").exit_code == 0
    verdicts = tree.with_suffix(".verdicts.json")
    assert json.loads(verdicts.read_text())["in"]["strict"] == {"tree": "?⊤", "1": "?⊤"}
    assert run("test", tree).exit_code == 0
    tree.write_text("door sand b a;\n")
    result = run("test", tree)
    assert result.exit_code == 1
    assert "in.jsonl: projected, branch 1: expected ?⊤, got ⊥⊥ (event 1)" in result.stdout
    root = ET.fromstring(run("test", tree, "--format", "junit").stdout)
    assert [(suite.get("tests"), suite.get("failures")) for suite in root] == [("6", "6")]
    assert "as it was" not in run("test", tree, "--update").stderr
    assert "as it was" in run("test", tree, "--update").stderr
    assert run("test", tree).exit_code == 0


def test_only_what_is_stated_is_looked_at(tree: Path) -> None:
    verdicts = tree.with_suffix(".verdicts.json")
    verdicts.write_text('{"in": {"scattered": {"tree": "?⊤"}}, "out": {}}', encoding="utf-8")
    result = run("test", tree)
    assert result.exit_code == 1
    assert "out.jsonl: verdicts are expected of this trace, which is not there" in result.stdout
    (tree.with_suffix(".traces") / "more.jsonl").write_text("")
    assert "more.jsonl: no verdicts are expected of this trace" in run("test", tree).stdout


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        ("[]", "not a file of expected verdicts: Expected `object`"),
        ('{"in": {"loose": {}}}', "Invalid enum value"),
        ('{"in": {"strict": {"trunk": "?"}}}', "neither 'tree' nor the number of a branch"),
        ('{"in": {"strict": {"2": "?"}}}', "there is no branch 2"),
    ],
)
def test_expectations_that_are_none(tree: Path, verdicts: str, said: str) -> None:
    tree.with_suffix(".verdicts.json").write_text(verdicts)
    failed(run("test", tree), said)
    assert run("test", tree).stdout.endswith("nothing was compared\n")

    failed(run("test", written(tree.with_name("a.rvaft"), "a;")), "no traces: put them into")
