"""`rvaft check` and `rvaft explain`."""

import json
import os
import re
from pathlib import Path

import pytest

from tests.cli.runs import PRUNED, UNBOUND, failed, process, run, written

LINE = re.compile(
    r"(?P<file>[^:]+):(?P<line>\d+):(?P<column>\d+): (?P<severity>error|warning): .+ \[(?P<code>[a-z-]+)\]"
)
TORN = "toplevel a;\na and and b;\n"


@pytest.fixture
def warned(tmp_path: Path) -> Path:
    return written(tmp_path / "warned.rvaft", "toplevel a;\na and b typo;\nb;\n")


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    return written(tmp_path / "wrong.rvaft", "toplevel a;\na and b;\nb and a;\n")


def test_findings_are_lines_and_warnings_count_only_with_strict(warned: Path, wrong: Path, tmp_path: Path) -> None:
    assert run("check", written(tmp_path / "fine.rvaft", "t sand a b;a;b;")).output == ""
    for options, status in (([], 0), (["--strict"], 1)):
        result = run("check", warned, *options)
        match = LINE.fullmatch(result.stdout.splitlines()[0])
        assert (result.exit_code, result.stderr) == (status, "")
        assert match is not None
        assert match.group("file", "line", "severity", "code") == (str(warned), "2", "warning", "undeclared")
    result = run("check", warned, wrong)
    assert result.exit_code == 1
    codes = [match["code"] for line in result.stdout.splitlines() if (match := LINE.fullmatch(line))]
    assert codes.count("undeclared") == 1
    assert "cycle" in codes
    for code in (*codes, "syntax", "no-branch"):  # every code is explained, and listed
        assert code in run("explain", code).stdout
        assert code in {line.split()[0] for line in run("explain").stdout.splitlines()}
    assert re.search(r"error: .*NewWp.*\[", run("check", UNBOUND).stdout)


def test_a_tree_that_does_not_parse_ends_with_2_and_a_caret(tmp_path: Path, wrong: Path) -> None:
    tree = written(tmp_path / "torn.rvaft", TORN)
    result = run("check", tree, wrong)
    assert result.exit_code == 2
    assert "[cycle]" in result.stdout
    first, source, caret = result.stderr.splitlines()
    assert re.fullmatch(rf"rvaft: error: {re.escape(str(tree))}:2:7: .+", first)
    assert (source, caret) == ("a and and b;", "      ^")


def test_json_is_for_editors_and_says_also_what_cannot_be_read(warned: Path, wrong: Path, tmp_path: Path) -> None:
    result = run("check", warned, wrong, "--format", "json")
    findings = json.loads(result.stdout)
    assert result.exit_code == 1
    assert {tuple(finding) for finding in findings} == {("file", "line", "column", "severity", "code", "message")}
    assert (findings[0]["file"], findings[0]["line"], findings[0]["code"]) == (str(warned), 2, "undeclared")
    missing, torn = tmp_path / "missing.rvaft", written(tmp_path / "torn.rvaft", TORN)
    result = run("check", missing, torn, warned, "--format", "json")
    assert result.exit_code == 2
    (_, absent, broken) = json.loads(result.stdout)
    said = "cannot read the file: No such file or directory"
    assert (absent["file"], absent["code"], absent["message"]) == (str(missing), "syntax", said)
    assert (broken["line"], broken["column"], broken["severity"], broken["code"]) == (2, 7, "error", "syntax")


def test_a_dash_is_standard_input(warned: Path, wrong: Path) -> None:
    result = run("check", "-", data=warned.read_bytes())
    assert result.exit_code == 0
    assert result.stdout == run("check", warned).stdout.replace(str(warned), "<stdin>")
    result = run("check", warned, "-", "--format", "json", data=wrong.read_bytes())
    assert {finding["file"] for finding in json.loads(result.stdout)} == {str(warned), "<stdin>"}
    for data, said in ((b"a and", "1:6: the text ends"), (b"a;\n\xff", "2:1: this is no UTF-8 text")):
        result = run("check", "-", data=data)
        assert result.exit_code == 2
        assert result.stderr.startswith(f"rvaft: error: <stdin>:{said}")
    with Path(os.devnull).open("wb") as writable:
        done = process("check", "-", stdin=writable)
    assert done.returncode == 2
    assert done.stderr.startswith("rvaft: error: <stdin>: cannot read the file: ")


def test_a_file_for_import_is_fine(tmp_path: Path, warned: Path) -> None:
    part = written(tmp_path / "events.rvaft", "event e(x) = { a: x };\n")
    assert (run("check", part).exit_code, run("check", part).output) == (0, "")
    assert run("check", part, warned, "--strict").exit_code == 1
    failed(run("check", written(tmp_path / "nothing.rvaft", "toplevel a;\n")), "there is no tree here")
    assert (run("cross-check", part).exit_code, run("cross-check", part).stderr) == (0, "")
    failed(run("test", part), "there is no tree here")
    assert run("check", written(part, "event e(x) = { a: };\n")).exit_code == 2


def test_annotations_for_github(tmp_path: Path, wrong: Path) -> None:
    torn = written(tmp_path / "a,b: 100%.rvaft", TORN)
    result = run("check", wrong, torn, "--format", "github")
    lines = result.stdout.splitlines()
    assert result.exit_code == 2
    cycle = rf"::error file={re.escape(str(wrong))},line=3,col=7,title=rvaft cycle::.*\[cycle\]"
    assert any(re.match(cycle, line) for line in lines)
    assert any("a%2Cb%3A 100%25.rvaft,line=2,col=7,title=rvaft syntax::" in line for line in lines)
    assert run("check", PRUNED, "--format", "github", "--strict").output == run("check", PRUNED).output


def test_sarif(wrong: Path, warned: Path) -> None:
    result = run("check", wrong, warned, "--format", "sarif")
    assert result.exit_code == 1
    (said,) = json.loads(result.stdout)["runs"]
    levels = {found["ruleId"]: found["level"] for found in said["results"]}
    assert (levels["cycle"], levels["undeclared"]) == ("error", "warning")
    assert {rule["id"] for rule in said["tool"]["driver"]["rules"]} == levels.keys()
    place = said["results"][0]["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == str(wrong)
    assert place["region"].keys() == {"startLine", "startColumn"}


def test_names_are_guessed_for_a_hundred_children_and_no_more(tmp_path: Path) -> None:
    """Comparing every undeclared child with every declared one would keep `check` busy for minutes."""
    gates = (f"gate{number} 2of3 gate{number + 1} x{number} gat{number};" for number in range(300))
    tree = written(tmp_path / "deep.rvaft", "toplevel gate0;\n" + "\n".join(gates) + "\ngate300;\n")
    lines = run("check", tree).stdout.splitlines()
    assert len(lines) == 600
    assert sum("did you mean gate" in line for line in lines) == 50
