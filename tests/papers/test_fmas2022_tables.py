"""The tables, formulas and the Listing of the FMAS 2022 paper: as stored, and computed rather than copied."""

import json
import re
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import pytest

import rvaft
from backends.rml import RmlBackend
from cross_check.participants import Absent
from papers.fmas2022 import tex, verdict_tex, verdicts
from papers.fmas2022.listing import formulas_tex, listing_rml
from papers.fmas2022.making import latex_texts
from papers.fmas2022.notes import Notes, difference
from papers.fmas2022.places import GATES, PRUNED, TREES
from papers.fmas2022.transitions import transitions
from papers.fmas2022.verdict_tex import verdict_tables
from papers.fmas2022.verdicts import Disagreement, Enlisted, enlist, monitors, symbols, traces
from rvaft import RVAFT, ToolMissing, Verdict, loads
from tests.backends.rml.published import compiled, needs_published
from tests.tex import document, needs_tex

EXPECTED = Path(verdicts.__file__).parent / "expected"
TREE = rvaft.load(PRUNED)
TRACES = TREES / "pruned.traces"
MARK = re.compile(r"\\rlap\{\\textsuperscript\{([a-z]+)\}\}")
"""A cell that differs from the print."""
SPOT = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]
NEEDS_SPOT = [pytest.param(name, marks=SPOT) for name in ("table2.tex", "table3.tex", "gates.tex")]


@pytest.fixture(scope="module")
def enlisted() -> Enlisted:
    return enlist(TREE)


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    return latex_texts(TREES)


@pytest.mark.parametrize("name", ["table1.tex", "formulas.tex", "listing.rml", "listing.tex", *NEEDS_SPOT])
def test_every_text_is_as_stored(texts: dict[str, str], name: str) -> None:
    assert texts[name] == (EXPECTED / name).read_text(encoding="utf-8")


def test_the_stored_texts_are_all_of_them_and_say_what_the_print_does_not(texts: dict[str, str]) -> None:
    assert {file.name for file in EXPECTED.iterdir()} == {*texts, "findings.md", "paper.tex"}
    below = texts["table1.tex"].partition(r"\end{tabular}")[2]
    assert all(name in below for name in (r"movebase\_result", "MoveBaseGoal", "move(Waypoint)"))
    assert r"\lstset{caption={$\varphi$ in RML" in texts["listing.tex"]
    for name, text in texts.items():
        if name.endswith(".tex") and name != "listing.tex":
            bare = text.replace(r"\{", "").replace(r"\}", "")
            assert bare.count("{") == bare.count("}"), name
            assert text.count(r"\begin{") == text.count(r"\end{"), name


# -- Tables 2 and 3 --------------------------------------------------------------------------------------------------


def test_the_print_differs_in_two_cells(enlisted: Enlisted) -> None:
    """φ after the fourth event of the first two traces of Table 3: φ₃, φ₄ may still come.

    Two columns of four cells in each of eight traces.
    """
    found = list(traces(enlisted, TRACES))
    cells = {
        (trace.table, trace.number, sign, place): (trace.printed(branch, place), verdict)
        for trace in found
        for sign, branch in monitors(TREE).items()
        for place, verdict in enumerate(trace.verdicts[sign], 1)
    }
    printed = {cell: (said.symbol, meant.symbol) for cell, (said, meant) in cells.items() if said is not None}
    assert (len(printed), len(cells)) == (64, 5 * (4 * 4 + 4 * 5))
    differing = {cell: pair for cell, pair in printed.items() if pair[0] != pair[1]}
    assert differing == {(3, 1, "φ", 4): ("⊥", "?"), (3, 2, "φ", 4): ("⊥", "?")}
    as_printed = [symbols(trace.as_printed["φ"]) if trace.as_printed else None for trace in found]
    assert as_printed == [None, None, "???⊥", "???⊥"] * 2, "the third and fourth detect nothing"


@pytest.mark.parametrize(
    ("old", "new", "marked"),
    [
        ("Value >= 250", "Value >= 250", {2: 0, 3: 2}),
        ("Value >= 250", "Value >= 258", {2: 16, 3: 8}),
        ("T2 >= T1 + 10", "T2 >= T1 + 15", {2: 4, 3: 2}),
        ("T2 >= T1 + 10", "T2 >= T1 + 1", {2: 0, 3: 6}),
    ],
)
def test_a_threshold_in_the_tree_changes_the_tables(old: str, new: str, marked: dict[int, int]) -> None:
    text = PRUNED.read_text(encoding="utf-8")
    assert old in text
    tree = loads(text.replace(old, new))
    tables = verdict_tables(tree, TRACES)
    assert {number: len(MARK.findall(table)) for number, table in tables.items()} == marked
    for table in tables.values():
        letters = set(MARK.findall(table))
        assert letters == set(re.findall(r"^\\textsuperscript\{([a-z]+)\}\\,The print has", table, re.MULTILINE))
        assert "describe" not in table, "nothing is said of the traces that another threshold makes false"
    assert new.removeprefix("Value ").removeprefix("T2 >= T1 + ") in listing_rml(tree)


def test_the_tables_name_who_gives_the_same_verdicts_and_who_was_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_rml(tree: RVAFT) -> Enlisted:
        absent = Absent(ToolMissing("a_tool", remedy="install it"))
        asked = {
            sign: [(name, everybody[name]) for name in ("engine", "reference")]
            for sign, everybody in enlist(tree).items()
        }
        return {sign: {**dict(mine), "rml": absent} for sign, mine in asked.items()}

    monkeypatch.setattr(verdict_tex, "enlist", without_rml)
    for table in verdict_tables(TREE, TRACES).values():
        assert r"in every cell, give \texttt{reference}.\par" in table
        assert r"Not run: \texttt{rml} (a\_tool is not installed: install it).\par" in table


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


def test_a_participant_that_says_something_else_is_no_footnote(
    enlisted: Enlisted, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = verdicts.verdicts_after

    def lying(one: Any, events: Sequence[Any]) -> Any:
        found = real(one, events)
        return found if found is None or one.name != "rml" else (*found[:-1], Verdict.TRUE)

    monkeypatch.setattr(verdicts, "verdicts_after", lying)
    with pytest.raises(Disagreement, match=r"engine says .*, rml says .*⊤"):
        list(traces(enlisted, TRACES))


# -- formulas and the Listing ----------------------------------------------------------------------------------------


def test_the_formulas_are_those_of_the_paper() -> None:
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
    rows = [row.partition("&=") for row in re.sub(r"%.*\n", "", formulas_tex(TREE)).split(r"\varphi")[1:]]
    assert [rf"\varphi{name}".strip() for name, _, _ in rows] == list(expected)
    words = re.compile(r"\{(move|result|inspect|radiation|goal|MBGoal)\}(?=\(|\])|(250|10|entrance)")
    for (_, _, formula), parts in zip(rows, expected.values(), strict=True):
        assert [first or second for first, second in words.findall(formula)] == parts


@pytest.mark.parametrize("trace", sorted(TRACES.glob("table*.jsonl")), ids=lambda path: path.stem)
def test_the_listing_says_what_the_tree_says(trace: Path) -> None:
    events = [json.loads(line) for line in trace.read_text(encoding="utf-8").splitlines()]
    said = list(RmlBackend().read(listing_rml(TREE)).run(events))
    assert said == list(rvaft.monitor(TREE, semantics="strict").run(events))


@pytest.mark.published
@needs_published
def test_the_published_compiler_takes_the_listing(tmp_path: Path) -> None:
    (found,) = compiled([listing_rml(TREE)], tmp_path)
    assert isinstance(found, Path), found


@pytest.mark.parametrize("gate", ["or", "vot", "and", "sand", "sand_rl"])
def test_the_transitions_of_a_gate_detect_what_the_gate_detects(gate: str) -> None:
    tree = rvaft.load(GATES / f"{gate}.rvaft")
    states = transitions(rvaft.translate(tree, "automaton", semantics="strict").text)
    edges = {
        (state, event): target
        for state, leaving in (part.split(": ") for part in states)
        for events, target in re.findall(r"((?:\w, )*\w) → ([\d⊤]+)", leaving)
        for event in events.split(", ")
    }
    for word in product("abc", repeat=3):
        state, monitor = "0", rvaft.monitor(tree, semantics="strict")
        for event in word:
            state = state if state in "⊤⊥" else edges.get((state, event), "⊥")
            assert monitor.step({"event": event}).symbol == (state if state in "⊤⊥" else "?")


@needs_tex
def test_pdflatex_compiles_the_tables(tmp_path: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    parts = [rf"\input{{{Path(name).stem}}}" for name in texts if name.endswith(".tex")]
    said = document(tex.document(parts), tmp_path)
    assert "Overfull" not in said
    assert (tmp_path / "test.pdf").stat().st_size > 20_000
