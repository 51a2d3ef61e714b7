"""`rvaft compare`."""

import shutil
import signal
import subprocess
import time
from collections.abc import Generator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from papers.languages import command, plots
from papers.languages.measurement import Cell, Measurement, Outcome, measured
from papers.languages.tables import COLUMNS, read_rows
from tests.cli.runs import COMMAND, PRUNED, TREES, failed, run

pytestmark = pytest.mark.usefixtures("quick")
VOT = TREES / "gates" / "vot.rvaft"
RML = ("--languages", "rml")


def kept(path: Path) -> list[Measurement]:
    return list(read_rows(path.read_text(encoding="utf-8"), str(path)))


@pytest.mark.ci
def test_a_table_for_people() -> None:
    result = run("compare", "--gates", "and,vot", "--max-arity", 2, "--semantics", "strict,scattered", *RML)
    assert result.exit_code == 0, result.stderr
    heading, *lines, last = result.stdout.splitlines()
    assert " ".join(heading.split()) == (
        "TREE SEMANTICS LANGUAGE SYMBOLS SUBFORMULAS STATES EDGES MS READ EVENTS/S AGAIN/S RESULT"
    )
    gates = ("and 1", "and 2", "vot 1/1", "vot 1/2", "vot 2/2")
    shown = [f"{gate} {semantics}" for gate in gates for semantics in ("strict", "scattered")]
    assert [" ".join(line.split()[:3]) for line in lines] == shown
    assert last == "10 measurements: 10 ok"


@pytest.mark.ci
def test_trees_of_the_user_alone_or_with_gates(tmp_path: Path) -> None:
    table = tmp_path / "x.csv"
    result = run("compare", VOT, PRUNED, VOT, "--languages", "rml,rml-paper", "--csv", table)
    assert result.exit_code == 0
    *lines, worst, last = result.stdout.splitlines()[1:]
    assert [line.split("  ")[-1] for line in lines] == ["ok"] * 3
    assert worst.endswith("traces get other verdicts")
    assert last == "4 measurements: 3 ok, 1 with other verdicts"
    assert [row.tree for row in kept(table)] == [str(VOT)] * 2 + [str(PRUNED)] * 2
    assert {(row.gate, row.children) for row in kept(table)} == {(None, None)}
    assert [bool(row.differing) for row in kept(table)] == [False, False, False, True]
    assert run("compare", VOT, "--gates", "or", "--max-arity", 1, *RML, "--csv", table).exit_code == 0
    assert [row.tree for row in kept(table)] == [str(VOT), "or 1"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("1 --semantics scattered --languages rml-paper", "not expressible: the paper does not define it\n"),
        ("4 --limit 9 --languages automaton", "(limit 9)"),
        ("1 --timeout 1e-6 --languages rml", "timeout: not within 1e-06 s"),
    ],
)
def test_the_three_words(words: str, said: str) -> None:
    result = run("compare", "--gates", "and", "--max-arity", *words.split())
    assert said in result.stdout
    assert result.exit_code == 0


def test_csv_to_standard_output_is_all_there_is() -> None:
    result = run("compare", "--gates", "or", "--max-arity", 1, *RML, "--csv", "-")
    assert result.stdout.splitlines()[0] == ",".join(COLUMNS)
    assert len(result.stdout.splitlines()) == 2


# -- interrupted runs -------------------------------------------------------------------------------------------------


def test_an_interrupted_run_keeps_what_it_has_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopping(cells: Sequence[Cell], *options: Any, **more: Any) -> Generator[tuple[Cell, Measurement], None, None]:
        yield from islice(measured(cells, *options, **more), 2)
        raise KeyboardInterrupt

    table = tmp_path / "x.csv"
    words = ("compare", "--gates", "and,or", "--max-arity", 3, *RML, "--csv", table)
    with monkeypatch.context() as patch:
        patch.setattr(command, "measured", stopping)
        result = run(*words)
    assert result.exit_code == 130
    assert result.stderr == "interrupted after 2 of 6 measurements; go on with --resume\n"
    assert result.stdout.splitlines()[-1] == "2 measurements: 2 ok"
    before = kept(table)
    assert [row.tree for row in before] == ["and 1", "and 2"]
    with table.open("a") as file:
        file.write("and 3,and,3")  # as a kill in the middle of a line leaves it
    result = run(*words, "--resume")
    assert result.exit_code == 0
    assert kept(table)[:2] == before  # times and all: they were not measured again
    assert [row.tree for row in kept(table)] == ["and 1", "and 2", "and 3", "or 1", "or 2", "or 3"]
    assert result.stdout.splitlines()[-1] == "6 measurements: 6 ok"


@pytest.mark.ci
def test_resuming_measures_again_what_was_late_or_has_changed_and_keeps_the_rest(tmp_path: Path) -> None:
    table, tree = tmp_path / "x.csv", tmp_path / "t.rvaft"
    shutil.copy(VOT, tree)
    words = ("compare", tree, "--gates", "or", "--max-arity", 1, *RML, "--csv", table)
    for more in ((), ("--resume",)):
        assert run(*words, "--timeout", 1e-6, *more).exit_code == 0
        assert [row.result for row in kept(table)] == [Outcome.TIMEOUT] * 2
    assert run(*words, "--resume").exit_code == 0
    first = kept(table)
    assert [row.result for row in first] == [Outcome.OK] * 2
    tree.write_text("top and a b;")
    assert run(*words, "--resume").exit_code == 0
    changed, same, old = kept(table)
    assert (same, old) == (first[1], first[0])
    assert changed.digest != old.digest
    result = run("compare", "--gates", "and", "--max-arity", 1, *RML, "--csv", table, "--resume")
    assert result.stdout.splitlines()[-1] == "1 measurement: 1 ok"
    assert [row.tree for row in kept(table)] == ["and 1", str(tree), "or 1", str(tree)]


def test_ctrl_c(tmp_path: Path) -> None:
    table = tmp_path / "x.csv"
    words = ["compare", "--gates", "vot", "--languages", "rml-paper", "--csv", str(table)]
    with subprocess.Popen([*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline and (not table.exists() or table.read_text().count("\n") < 3):
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=30)
    assert running.returncode == 130, err
    assert err.startswith("interrupted after ")
    assert err.count("\n") == 1
    assert len(kept(table)) == len(out.splitlines()) - 2 >= 2


# -- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.ci
def test_latex_and_plots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("pandas")
    monkeypatch.setattr(plots, "MEASURES", {"symbols": plots.MEASURES["symbols"]})
    folder, table = tmp_path / "a" / "b", tmp_path / "x.tex"
    words = ("--latex", table, "--plots", folder, "--width", "column")
    assert run("compare", VOT, *RML, *words).exit_code == 0
    assert r"\toprule" in table.read_text()
    assert sorted(path.name for path in folder.iterdir()) == ["trees-symbols.pdf", "trees-symbols.png"]


WRONG = [  # the words, with T for a folder that has a tree `t.rvaft`, an empty `file` and two others; what is said
    ("--gates xand", "unknown gate xand", "did you mean and?"),
    ("--gates tomato", "unknown gate tomato; known: or, and, sand, sand_rl, pand, vot"),
    ("--languages hoa", "unknown backend hoa", "did you mean automaton?"),
    ("--semantics loose", "unknown semantics loose; known: strict, projected, consecutive, scattered"),
    ("--gates ,", "unknown gate ,; known: or, and"),
    ("T/t.rvaft --languages ,", "nothing to compare"),
    ("--max-arity 0", "--max-arity"),
    ("--timeout nan", "NaN is not allowed"),
    ("--resume", "--csv"),
    ("--resume --csv -", "--csv"),
    ("--csv x --latex x", "two outputs name the same file"),
    ("--csv x --latex ./x", "two outputs name the same file"),
    ("--width column", "--width needs --latex or --plots"),
    ("T/none.rvaft", "none.rvaft"),
    ("T/t.rvaft --csv T/none/x.csv", "cannot write"),
    ("T/t.rvaft --latex T/none/x.tex", "cannot write"),
    ("T/t.rvaft --latex T", "cannot write to a folder"),
    ("T/t.rvaft --csv T", "cannot write to a folder"),
    ("T/t.rvaft --plots T/file", "file: cannot write: "),
    ("T/t.rvaft --csv T/../t/t.rvaft", "which would be overwritten"),
    ("T/t.rvaft --latex T/t.rvaft", "which would be overwritten"),
    ("T/t.rvaft --csv T/line", "line:1:1: not a comparison of languages"),
    ("T/t.rvaft --csv T/json --resume", "json:1:1: not a comparison of languages"),
]


def test_wrong_input(tmp_path: Path) -> None:
    """Nothing is written, and nothing is written over something else."""
    folder = tmp_path / "t"
    folder.mkdir()
    before = {"t.rvaft": VOT.read_text(), "file": "", "line": "one line", "json": '{"no": "comparison"}\n'}
    for name, text in before.items():
        (folder / name).write_text(text)
    for words, *said in WRONG:
        failed(run("compare", *words.replace("T", str(folder)).split()), *said)
    assert {path.name: path.read_text() for path in folder.iterdir()} == before


def test_no_figures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    nothing = ("--semantics", "scattered", "--languages", "rml-paper", "--plots", tmp_path / "p")
    result = run("compare", "--gates", "and", "--max-arity", 1, *nothing)
    failed(result, "no figures: ")
    assert "1 measurement: 1 not expressible" in result.stdout
    assert not (tmp_path / "p").exists()


def test_a_tree_that_cannot_be_read_does_not_stop_the_others(tmp_path: Path) -> None:
    bad = tmp_path / "bad.rvaft"
    bad.write_text("top nand a b;")
    result = run("compare", bad, VOT, *RML)
    assert result.exit_code == 2
    assert "bad.rvaft:1:" in result.stderr
    assert result.stdout.splitlines()[-1] == "1 measurement: 1 ok"
