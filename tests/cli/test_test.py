"""`rvaft test`: a tree's own traces against the verdicts expected of them."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.cli.runs import failed, run, written


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "door.traces").mkdir()
    written(tmp_path / "door.traces" / "in.jsonl", '{"event": "a"}\n{"event": "b"}\n')
    return written(tmp_path / "door.rvaft", "door sand a b;\n")


def test_expectations_are_written_compared_and_written_again(tree: Path) -> None:
    failed(run("test", tree), "door.verdicts.json: the file of expected verdicts does not exist; --update writes it")
    assert run("test", tree, "--update").exit_code == 0
    verdicts = tree.with_suffix(".verdicts.json")
    assert json.loads(verdicts.read_text())["in"]["strict"] == {"tree": "?⊤", "1": "?⊤"}
    assert run("test", tree).exit_code == 0
    tree.write_text("door sand b a;\n")
    result = run("test", tree)
    assert result.exit_code == 1
    assert "in.jsonl: projected, branch 1: expected ?⊤, got ⊥⊥ (event 1)" in result.stdout
    root = ET.fromstring(run("test", tree, "--format", "junit").stdout)
    assert [(suite.get("tests"), suite.get("failures")) for suite in root] == [("8", "8")]
    assert "unchanged" not in run("test", tree, "--update").stderr
    assert "unchanged" in run("test", tree, "--update").stderr
    assert run("test", tree).exit_code == 0
    tree.write_text('event a(v) = { event: "a", v: v }; time t as s; door or x y; x on a(X) when X > 1; y;')
    written(tree.with_name("door.traces") / "in.jsonl", '{"event": "a", "v": "1", "t": 1}\n')
    said = 'undefined guard in 1 event: X > 1 of x, where X is a string ("1") (first: in: event 1)'
    assert f"rvaft: warning: {tree}: {said}\n" in run("test", tree).stderr
