"""The tables, formulas and the Listing of the FMAS 2022 paper: as stored, and computed rather than copied."""

import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import rvaft
from backends.rml.reading.reader import read
from papers.fmas2022 import tex, verdicts
from papers.fmas2022.formulas_tex import formulas_tex
from papers.fmas2022.listing import listing_rml
from papers.fmas2022.making import TREES, latex_texts
from papers.fmas2022.notes import Notes, difference
from papers.fmas2022.verdict_tex import verdict_tables
from papers.fmas2022.verdicts import Disagreement, monitors, symbols, traces
from rvaft import Verdict, loads
from rvaft.tree import RVAFT
from tests.backends.rml.published.runner import compiled, needs_published

EXPECTED = Path(verdicts.__file__).parent / "expected"
TRACES = TREES / "pruned.traces"
MARK = re.compile(r"\\rlap\{\\textsuperscript\{([a-z]+)\}\}")
"""A cell that differs from the print."""
NEEDS_SPOT = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]


@pytest.fixture(scope="module")
def pruned() -> RVAFT:
    return rvaft.load(TREES / "pruned.rvaft")


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    return latex_texts(TREES)


@pytest.mark.parametrize(
    "name",
    [
        "table1.tex",
        "formulas.tex",
        "listing.rml",
        "listing.tex",
        "table2.tex",
        "table3.tex",
        pytest.param("gates.tex", marks=NEEDS_SPOT),
    ],
)
def test_every_text_is_as_stored(texts: dict[str, str], name: str) -> None:
    assert texts[name] == (EXPECTED / name).read_text(encoding="utf-8")


def test_the_stored_texts_are_all_of_them(texts: dict[str, str]) -> None:
    assert {file.name for file in EXPECTED.iterdir()} == {*texts, "findings.md", "paper.tex"}


# -- Tables 2 and 3 --------------------------------------------------------------------------------------------------


def test_the_print_differs_in_two_cells(pruned: RVAFT) -> None:
    """φ after the fourth event of the first two traces of Table 3: φ₃, φ₄ may still come."""
    signs = monitors(pruned)
    differing = {
        (trace.table, trace.number, sign, place): (printed.symbol, verdict.symbol)
        for trace in traces(pruned, TRACES)
        for sign, branch in signs.items()
        for place, verdict in enumerate(trace.verdicts[sign], 1)
        if (printed := trace.printed(branch, place)) not in (None, verdict)
    }
    assert differing == {(3, 1, "φ", 4): ("⊥", "?"), (3, 2, "φ", 4): ("⊥", "?")}


def test_as_printed_the_third_and_fourth_trace_detect_nothing(pruned: RVAFT) -> None:
    found = {
        (trace.table, trace.number): symbols(trace.as_printed["φ"]) if trace.as_printed else None
        for trace in traces(pruned, TRACES)
    }
    assert found == {(t, n): None if n < 3 else "???⊥" for t in (2, 3) for n in (1, 2, 3, 4)}


def test_every_printed_cell_is_there(pruned: RVAFT) -> None:
    """Two columns of four cells in each of eight traces."""
    cells = [
        trace.printed(branch, place)
        for trace in traces(pruned, TRACES)
        for branch in monitors(pruned).values()
        for place in range(1, len(trace.events) + 1)
    ]
    printed = [cell for cell in cells if cell is not None]
    assert (len(printed), len(cells)) == (64, 5 * (4 * 4 + 4 * 5))


@pytest.mark.parametrize(
    ("old", "new", "marked"),
    [
        ("Value >= 250", "Value >= 250", {2: 0, 3: 2}),
        ("Value >= 250", "Value >= 258", {2: 16, 3: 8}),
        ("T2 >= T1 + 10", "T2 >= T1 + 15", {2: 4, 3: 2}),
        ("T2 >= T1 + 10", "T2 >= T1 + 1", {2: 0, 3: 6}),
    ],
)
def test_a_threshold_in_the_tree_changes_the_tables(tmp_path: Path, old: str, new: str, marked: dict[int, int]) -> None:
    folder = tmp_path / "trees"
    shutil.copytree(TREES, folder)
    file = folder / "pruned.rvaft"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    tables = verdict_tables(rvaft.load(file), folder / "pruned.traces")
    assert {number: len(MARK.findall(table)) for number, table in tables.items()} == marked
    for table in tables.values():
        letters = set(MARK.findall(table))
        assert letters == set(re.findall(r"^\\textsuperscript\{([a-z]+)\}\\,The print has", table, re.MULTILINE))


LATE = (
    "event x(v) = { x: v }; toplevel r; r or a b; a sand p q; b sand p2 s; p on x(1); p2 on x(1); q on x(2); s on x(3);"
)


@pytest.mark.parametrize(
    ("values", "branch", "said"),
    [
        ([1], None, r"$\varphi_{1}$ awaits \texttt{x(2)} (q) and $\varphi_{2}$ awaits \texttt{x(3)} (s)"),
        ([1, 2], None, r"$\varphi_{1}$ is complete: p by event 1, q by event 2"),
        ([1, 3], 1, r"after event 2; before it $\varphi_{1}$ awaited \texttt{x(2)} (q)"),
    ],
)
def test_a_note_says_why_a_cell_differs(values: list[int], branch: int | None, said: str) -> None:
    note = difference(loads(LATE), branch, [{"x": value} for value in values], Verdict.FALSE)
    assert note.startswith(r"The print has $\bot$. ")
    assert said in note


def test_notes_have_letters_in_order_and_an_equal_note_keeps_its_own() -> None:
    notes = Notes()
    letters = [notes.letter(f"note {number}") for number in range(28)]
    assert letters[:2] + letters[25:] == ["a", "b", "z", "aa", "ab"]
    assert notes.letter("note 1") == "b"


def test_a_participant_that_says_something_else_is_no_footnote(pruned: RVAFT, monkeypatch: pytest.MonkeyPatch) -> None:
    real = verdicts.said

    def lying(one: Any, events: Sequence[Any]) -> Any:
        found = real(one, events)
        return found if found is None or one.name != "rml" else (*found[:-1], Verdict.TRUE)

    monkeypatch.setattr(verdicts, "said", lying)
    with pytest.raises(Disagreement, match=r"engine says .*, rml says .*⊤"):
        list(traces(pruned, TRACES))


# -- formulas and the Listing ----------------------------------------------------------------------------------------


def test_the_formulas_are_those_of_the_paper(pruned: RVAFT) -> None:
    """Their parts in their order; the paper joins them by one sign and merges φ by hand."""
    common = ["inspect", "radiation", "250", "move", "entrance"]
    late, altered = ["10"], ["goal", "MBGoal"]
    expected = {
        r"\varphi_{1}": ["move", *common, *late],
        r"\varphi_{2}": ["result", *common, *late],
        r"\varphi_{3}": ["move", *common, *altered],
        r"\varphi_{4}": ["result", *common, *altered],
        r"\varphi": ["move", "result", *common, *late, *altered],
    }
    rows = [row.partition("&=") for row in re.sub(r"%.*\n", "", formulas_tex(pruned)).split(r"\varphi")[1:]]
    assert [rf"\varphi{name}".strip() for name, _, _ in rows] == list(expected)
    words = re.compile(r"\{(move|result|inspect|radiation|goal|MBGoal)\}(?=\(|\])|(250|10|entrance)")
    for (_, _, formula), parts in zip(rows, expected.values(), strict=True):
        assert [first or second for first, second in words.findall(formula)] == parts


@pytest.mark.parametrize("trace", sorted(TRACES.glob("table*.jsonl")), ids=lambda path: path.stem)
def test_the_listing_says_what_the_tree_says(pruned: RVAFT, trace: Path) -> None:
    events = [json.loads(line) for line in trace.read_text(encoding="utf-8").splitlines()]
    said = list(read(listing_rml()).run(events))
    assert said == list(rvaft.monitor(pruned, semantics="strict").run(events))


@pytest.mark.published
@needs_published
def test_the_published_compiler_takes_the_listing(tmp_path: Path) -> None:
    (found,) = compiled([listing_rml()], tmp_path)
    assert isinstance(found, Path), found


# -- LaTeX -----------------------------------------------------------------------------------------------------------


def test_braces_and_environments_are_closed(texts: dict[str, str]) -> None:
    for name, text in texts.items():
        if name.endswith(".tex") and name != "listing.tex":
            bare = text.replace(r"\{", "").replace(r"\}", "")
            assert bare.count("{") == bare.count("}"), name
            assert text.count(r"\begin{") == text.count(r"\end{"), name


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs pdflatex (apt install texlive-latex-extra lmodern)")
def test_pdflatex_compiles_the_tables(tmp_path: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    parts = [rf"\input{{{Path(name).stem}}}" for name in texts if name.endswith(".tex")]
    (tmp_path / "all.tex").write_text(tex.document(parts), encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False, timeout=120
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout
    assert (tmp_path / "all.pdf").stat().st_size > 20_000
