"""`rvaft branches`: the properties as text, in Unicode and in LaTeX."""

from pathlib import Path

from rvaft import load
from rvaft.analysis.branches import branches
from rvaft.export.property_text import align_latex, property_unicode
from tests.cli.runs import PRUNED, TREES, failed, run
from tests.tex import unsound

HALT = TREES / "multiprocessor" / "halt.rvaft"


def test_unicode_has_the_columns_of_text() -> None:
    plain, pretty = (run("branches", PRUNED, *options) for options in ([], ["--format", "unicode"]))
    assert (pretty.exit_code, pretty.stderr) == (0, "")
    rows = [line.split("\t") for line in pretty.stdout.splitlines()]
    assert [row[0] for row in rows] == ["φ₁", "φ₂", "φ₃", "φ₄"]
    assert [row[1] for row in rows] == [line.split("\t")[1] for line in plain.stdout.splitlines()]
    assert [row[2] for row in rows] == [property_unicode(branch) for branch in branches(load(PRUNED))]
    assert run("branches", PRUNED, "--format", "text").stdout == plain.stdout


def test_latex_is_one_environment() -> None:
    found = run("branches", PRUNED, "--format", "latex")
    assert (found.exit_code, found.stderr) == (0, "")
    assert found.stdout.splitlines() == "\n".join(align_latex(branches(load(PRUNED)))).splitlines()
    assert unsound(found.stdout, allowed="&") is None
    assert found.stdout.count(" &= ") == 4
    assert not any(line.strip() == "" for line in found.stdout.splitlines()), "an empty line ends an align*"


def test_the_whole_tree_has_one_property() -> None:
    text, pretty, tex = (
        run("branches", HALT, "--whole", "--format", form).stdout for form in ("text", "unicode", "latex")
    )
    assert text.startswith("-\tattack,fault\t(((fails(")
    assert pretty.startswith("φ\tattack,fault\t((fails(")
    assert (text.count("\n"), pretty.count("\n"), tex.count(" &= ")) == (1, 1, 1)
    assert "VOT 3/5(" in pretty
    assert r"\mathrm{VOT}_{3/5}(" in tex


def test_the_width_bounds_the_lines() -> None:
    def rows(width: int) -> int:
        return run("branches", PRUNED, "--format", "latex", "--width", width).stdout.count("\\\\")

    assert rows(10_000) == 3 < rows(100) < rows(40) < rows(1)


def test_control_codes_stay_visible(tmp_path: Path) -> None:
    path = tmp_path / "odd.rvaft"
    path.write_text('toplevel t; t and "a\\tb\\u001b[31m" "\\u202ex";', encoding="utf-8")
    for form in ("text", "unicode", "latex"):
        found = run("branches", path, "--format", form)
        assert found.exit_code == 0
        assert not {"\x1b", "\u202e"} & set(found.stdout)


def test_wrong_options_are_refused() -> None:
    failed(run("branches", PRUNED, "--width", "40"), "--width: not for the format text")
    failed(run("branches", PRUNED, "--format", "tex"), "'tex' is not one of 'text', 'unicode', 'latex'")
    failed(run("branches", PRUNED, "--format", "latex", "--width", "0"), "--width")
