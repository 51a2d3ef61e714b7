"""Cut sets and probabilities on drawn trees."""

import re
from pathlib import Path
from typing import Final

import pytest

from rvaft.risk.cut_sets import CutSets
from rvaft.risk.model import of_file
from rvaft.risk.probability import Analysis
from tests.cli.runs import failed, run, written

pytest.importorskip("oxidd")

PUMP: Final = Path(__file__).parents[2] / "docs" / "risk" / "pump.rvaft"
VOTE: Final = "top or v s; v 2of3 a b c; s sand d e; a prob=.1; b prob=.2; c prob=.3; d prob=.5; e prob=.5;"


def marked(text: str) -> set[str]:
    return {name for line in text.splitlines() if line.startswith("● ") for name in re.findall(r"\w+", line)[:1]}


def test_each_cut_set_is_marked_by_its_number(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", VOTE)
    sets = CutSets(of_file(tree)).listed()
    assert len(sets) == 4
    for number, one in enumerate(sets, 1):
        shown = run("show", tree, "--cut-set", number).stdout
        listed = run("cut-sets", tree).stdout
        assert shown.rstrip().endswith(f"cut set {number}: {', '.join(one.leaves)}")
        assert re.search(rf"(?m)^ +{number}  {', '.join(one.leaves)}(  |$)", listed)
        inner = {"s"} if set(one.leaves) == {"d", "e"} else {"v"}
        assert marked(shown) == {"top", *one.leaves, *inner}


def test_a_number_beyond_the_sets_is_refused() -> None:
    failed(run("show", PUMP, "--cut-set", 3), "--cut-set 3: the tree has 2 minimal cut sets")
    failed(run("show", PUMP, "--cut-set", 1, "--highlight", "branch:1"), "--cut-set and --highlight exclude")
    failed(run("show", PUMP, "--risk", "9 h", "--format", "json"), "--risk: not for the format json")
    failed(run("show", PUMP, "--risk", "9"), "the rates of the tree have units: write --risk as")


@pytest.mark.parametrize("suffix", ["txt", "svg", "tex", "dot"])
def test_probabilities_stand_at_the_nodes(tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"tree.{suffix}"
    assert run("show", PUMP, "--risk", "1000 h", "-o", out).exit_code == 0
    analysis = Analysis(of_file(PUMP))
    text = out.read_text()
    for name in ("flooded", "leak", "no_pump", "alarm"):
        assert f"P = {analysis.element(name, 3.6e6):.4g}" in text
    assert text.count("P = ") == 4  # the clock of the pump starts with the alarm
    assert text.count("clock starts later") == 1


def test_a_guard_that_is_taken_to_hold_makes_bounds(tmp_path: Path) -> None:
    tree = written(
        tmp_path / "t.rvaft",
        "event e(n, v) = {event: n, v: v}; t and a b when V > W; a on e(_, V) prob=.5; b on e(_, W) prob=.5;",
    )
    done = run("show", tree, "--risk", "1")
    assert "upper bounds: t" in done.stderr
    assert "P ≤ 0.25" in done.stdout


def test_a_translated_tree_is_refused_with_the_reason(tmp_path: Path) -> None:
    tree = written(tmp_path / "t.dft", 'toplevel "t"; "t" wsp "a" "b"; "a" lambda=1; "b" lambda=1;')
    failed(run("show", tree, "--risk", "1"), "the drawing shows what the dynamic gates of Galileo are translated to")
    failed(run("show", tree, "--cut-set", "1"), "the drawing shows what the dynamic gates of Galileo are translated to")
    plain = written(tmp_path / "p.dft", 'toplevel "t"; "t" and "a" "b"; "a" lambda=1; "b" lambda=1;')
    assert "P = 0.3996" in run("show", plain, "--risk", "1").stdout
