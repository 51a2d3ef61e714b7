"""`rvaft check` and `rvaft explain`."""

import json
import re
from pathlib import Path

import pytest

from tests.cli.runs import PRUNED, TREES, failed, run

LINE = re.compile(
    r"(?P<file>[^:]+):(?P<line>\d+):(?P<column>\d+): (?P<severity>error|warning): .+ \[(?P<code>[a-z-]+)\]"
)


@pytest.fixture
def warned(tmp_path: Path) -> Path:
    tree = tmp_path / "warned.rvaft"
    tree.write_text("toplevel a;\na and b typo;\nb;\n")
    return tree


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    tree = tmp_path / "wrong.rvaft"
    tree.write_text("toplevel a;\na and b;\nb and a;\n")
    return tree


def test_a_tree_without_findings_is_silent(tmp_path: Path) -> None:
    tree = tmp_path / "fine.rvaft"
    tree.write_text("toplevel t; t sand a b; a; b;")
    result = run("check", tree)
    assert (result.exit_code, result.output) == (0, "")


def test_a_warning_is_found_only_by_strict(warned: Path) -> None:
    for options, status in (([], 0), (["--strict"], 1)):
        result = run("check", warned, *options)
        assert result.exit_code == status
        match = LINE.fullmatch(result.stdout.splitlines()[0])
        assert match is not None
        assert (match["file"], match["line"], match["severity"]) == (str(warned), "2", "warning")
        assert match["code"] == "undeclared"
        assert result.stderr == ""


def test_an_error_in_a_tree_that_parses_is_found(wrong: Path, warned: Path) -> None:
    result = run("check", warned, wrong)
    assert result.exit_code == 1
    codes = [match["code"] for line in result.stdout.splitlines() if (match := LINE.fullmatch(line))]
    assert codes.count("undeclared") == 1
    assert "cycle" in codes


def test_the_refused_tree_of_the_paper_names_the_unbound_variable() -> None:
    result = run("check", TREES / "remote_inspection" / "listing.rvaft")
    assert result.exit_code == 1
    assert re.search(r"error: .*NewWp.*\[", result.stdout)


def test_a_tree_that_does_not_parse_ends_with_2_and_a_caret(tmp_path: Path, wrong: Path) -> None:
    tree = tmp_path / "torn.rvaft"
    tree.write_text("toplevel a;\na and and b;\n")
    result = run("check", tree, wrong)
    assert result.exit_code == 2
    assert "[cycle]" in result.stdout
    first, source, caret = result.stderr.splitlines()
    assert re.fullmatch(rf"rvaft: error: {re.escape(str(tree))}:2:7: .+", first)
    assert (source, caret) == ("a and and b;", "      ^")


def test_json_is_for_editors(warned: Path, wrong: Path) -> None:
    result = run("check", warned, wrong, "--format", "json")
    assert result.exit_code == 1
    findings = json.loads(result.stdout)
    assert {tuple(finding) for finding in findings} == {("file", "line", "column", "severity", "code", "message")}
    assert (findings[0]["file"], findings[0]["line"], findings[0]["code"]) == (str(warned), 2, "undeclared")
    assert json.loads(run("check", PRUNED, "--format", "json").stdout) is not None


def test_json_says_also_where_a_tree_does_not_parse(tmp_path: Path) -> None:
    tree = tmp_path / "torn.rvaft"
    tree.write_text("toplevel a;\na and and b;\n")
    result = run("check", tree, "--format", "json")
    assert result.exit_code == 2
    (finding,) = json.loads(result.stdout)
    assert (finding["line"], finding["column"], finding["severity"], finding["code"]) == (2, 7, "error", "syntax")


def test_every_code_that_is_reported_is_explained(warned: Path, wrong: Path) -> None:
    result = run("check", warned, wrong)
    codes = {match["code"] for line in result.stdout.splitlines() if (match := LINE.fullmatch(line))}
    for code in (*codes, "syntax"):
        explained = run("explain", code)
        assert explained.exit_code == 0
        assert code in explained.stdout
    failed(run("explain", "undeclard"), "undeclard", "undeclared")
