"""`rvaft check` and `rvaft explain`."""

import json
import os
import re
from pathlib import Path

import pytest

from tests.cli.runs import PRUNED, TREES, failed, process, run

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


def test_a_dash_is_standard_input(warned: Path, wrong: Path) -> None:
    result = run("check", "-", data=warned.read_bytes())
    assert result.exit_code == 0
    assert result.stdout == run("check", warned).stdout.replace(str(warned), "<stdin>")
    result = run("check", warned, "-", "--format", "json", data=wrong.read_bytes())
    assert result.exit_code == 1
    assert {finding["file"] for finding in json.loads(result.stdout)} == {str(warned), "<stdin>"}


@pytest.mark.parametrize(
    ("data", "said"), [(b"a and", "<stdin>:1:6: the text ends"), (b"a;\n\xff", "<stdin>:2:1: this is no UTF-8 text")]
)
def test_standard_input_that_is_no_tree(data: bytes, said: str) -> None:
    result = run("check", "-", data=data)
    assert result.exit_code == 2
    assert result.stderr.startswith(f"rvaft: error: {said}")


def test_standard_input_that_cannot_be_read() -> None:
    with Path(os.devnull).open("wb") as writable:
        done = process("check", "-", stdin=writable)
    assert done.returncode == 2
    assert done.stderr.startswith("rvaft: error: <stdin>: cannot read the file: ")


def test_json_says_also_which_file_cannot_be_read(tmp_path: Path, warned: Path) -> None:
    missing = tmp_path / "missing.rvaft"
    result = run("check", missing, warned, "--format", "json")
    assert result.exit_code == 2
    (_, finding) = json.loads(result.stdout)
    assert (finding["file"], finding["code"]) == (str(missing), "syntax")
    assert finding["message"] == "cannot read the file: No such file or directory"


def test_every_code_that_is_reported_is_explained(warned: Path, wrong: Path) -> None:
    result = run("check", warned, wrong)
    codes = {match["code"] for line in result.stdout.splitlines() if (match := LINE.fullmatch(line))}
    for code in (*codes, "syntax", "no-branch"):
        explained = run("explain", code)
        assert explained.exit_code == 0
        assert code in explained.stdout
    failed(run("explain", "undeclard"), "undeclard", "undeclared")


def test_all_codes_are_listed() -> None:
    listed = run("explain")
    assert listed.exit_code == 0
    assert {"cycle", "syntax", "undeclared"} <= {line.split()[0] for line in listed.stdout.splitlines()}


def test_a_file_for_import_is_fine(tmp_path: Path, warned: Path) -> None:
    part, nothing = tmp_path / "events.rvaft", tmp_path / "nothing.rvaft"
    part.write_text("event e(x) = { a: x };\n")
    nothing.write_text("toplevel a;\n")
    assert (run("check", part).exit_code, run("check", part).output) == (0, "")
    assert run("check", part, warned, "--strict").exit_code == 1
    failed(run("check", nothing), "there is no tree here")
    compared = run("cross-check", part)
    assert (compared.exit_code, compared.stderr) == (0, "")
    part.write_text("event e(x) = { a: };\n")
    assert run("check", part).exit_code == 2


def test_annotations_for_github(tmp_path: Path, wrong: Path) -> None:
    torn = tmp_path / "a,b: 100%.rvaft"
    torn.write_text("toplevel a;\na and and b;\n")
    result = run("check", wrong, torn, "--format", "github")
    assert result.exit_code == 2
    lines = result.stdout.splitlines()
    assert any(
        re.match(rf"::error file={re.escape(str(wrong))},line=3,col=7,title=rvaft cycle::.*\[cycle\]", line)
        for line in lines
    )
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
    tree = tmp_path / "deep.rvaft"
    gates = (f"gate{number} 2of3 gate{number + 1} x{number} gat{number};" for number in range(300))
    tree.write_text("toplevel gate0;\n" + "\n".join(gates) + "\ngate300;\n")
    lines = run("check", tree).stdout.splitlines()
    assert len(lines) == 600
    assert sum("did you mean gate" in line for line in lines) == 50
