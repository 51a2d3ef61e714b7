"""The comparison in papers/languages: what is committed there, and that it can be made anew."""

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from cross_check.results import reason
from papers.languages import plots
from papers.languages.__main__ import LANGUAGES, PAGES, main, texts
from papers.languages.findings import FINDINGS, missed
from papers.languages.measurement import EVENTS, NO_LATE_EVENTS, Measurement, Outcome, default_languages, gate_subjects
from papers.languages.note import FOLDER, TREES, expressible
from papers.languages.tables import Width, read_rows
from rvaft import NotExpressible, Semantics, load, translate
from rvaft.errors import Cause
from rvaft.model.nodes import Assumption


@pytest.fixture(scope="module")
def rows() -> list[Measurement]:
    return list(read_rows((FOLDER / "languages.csv").read_text(encoding="utf-8")))


def test_all_was_measured(rows: list[Measurement]) -> None:
    assert len(rows) == (5 * 8 + 36 + len(TREES)) * len(Semantics) * len(LANGUAGES)
    untyped = {*default_languages()} - {"kql"}  # KQL needs types, which these trees do not declare
    assert {row.language for row in rows} == {*LANGUAGES} >= untyped
    assert {row.children for row in rows} == {None, *range(1, 9)}
    assert not any(row.broken for row in rows)
    assert {Path(row.tree) for row in rows if row.gate is None} == {
        path.relative_to(FOLDER) for path in FOLDER.glob("trees/*")
    }


def test_every_finding_holds_and_one_that_does_not_is_told(rows: list[Measurement]) -> None:
    assert len(FINDINGS) > 30
    assert missed(rows) == []
    assert len(missed([row for row in rows if row.result is Outcome.TOO_LARGE])) > 30
    larger = [
        replace(row, symbols=row.symbols and row.symbols + 1, states=row.states and row.states + 1) for row in rows
    ]
    assert len(missed(larger)) > 25


def test_the_pages_are_those_of_the_measurements(rows: list[Measurement]) -> None:
    for name, text in texts(rows).items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, name


@pytest.mark.ci
@pytest.mark.spot
def test_committed_sizes_are_those_of_the_texts(rows: list[Measurement]) -> None:
    pytest.importorskip("spot")
    trees = {subject.name: subject.tree for subject in gate_subjects(max_arity=4)}
    trees |= {f"trees/{name}.rvaft": load(FOLDER / "trees" / f"{name}.rvaft") for name in TREES}
    small = [row for row in rows if row.tree in trees]
    assert len(small) == (5 * 4 + 10 + len(TREES)) * len(Semantics) * len(LANGUAGES)
    for row in small:
        try:
            made = translate(trees[row.tree], row.language, semantics=row.semantics)
        except NotExpressible as error:
            ended: tuple[object, ...] = (Outcome.NOT_EXPRESSIBLE, reason(error), error.cause, "")
        else:
            late = Assumption.ORDER in made.assumes
            extension = ", ".join(made.extensions)
            refused = (Outcome.NOT_EXPRESSIBLE, NO_LATE_EVENTS, Cause.WRITER, "")
            ended = refused if late else (Outcome.OK, "", None, extension)
        assert (row.result, row.reason, row.cause, row.extension) == ended, row
        if row.result is Outcome.NOT_EXPRESSIBLE:
            continue
        found = made.metrics
        expected = (row.symbols, row.subformulas, row.states, row.edges, row.characters)
        assert (found.symbols, found.subformulas, found.states, found.edges, len(made.text)) == expected, row


def test_each_reason_is_told_once(rows: list[Measurement]) -> None:
    table, reasons = expressible(rows)
    assert {len(line) for line in table} == {1 + len(LANGUAGES)}
    cells = [cell for line in table[1 : 1 + len(TREES)] for cell in line[1:]]
    answers = {cell.partition(" (")[0] for cell in cells}
    assert answers == {"yes", "slices", "time variables", "no", "-"}
    numbers = {cell.partition(" (")[2].rstrip(")") for cell in cells} - {""}
    assert numbers == {str(number) for number in range(1, len(reasons) + 1)}
    assert table[-1][1:].count("all") == 4


def test_each_claim_that_a_language_cannot_has_its_argument(
    rows: list[Measurement], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    claimed = {(row.language, row.reason) for row in rows if row.cause is Cause.LANGUAGE}
    assert main(["--claims"]) == 0
    said = capsys.readouterr().out
    assert all(f"{language}: {claim} (" in said for language, claim in claimed)
    assert {(row.result is Outcome.NOT_EXPRESSIBLE) == (row.cause is not None) for row in rows} == {True}
    for page in PAGES.glob("*.md"):
        (tmp_path / page.name).write_text(page.read_text("utf-8").replace("- **STIX has no null**", "- STIX"), "utf-8")
    monkeypatch.setattr("papers.languages.__main__.PAGES", tmp_path)
    monkeypatch.setattr("papers.languages.__main__.ROOT", tmp_path)
    assert main(["--claims"]) == 1
    assert "stix: STIX has no null (1 cells): NO ARGUMENT" in capsys.readouterr().out


def test_few_events_give_no_speed(rows: list[Measurement]) -> None:
    few = [row for row in rows if row.events is not None and row.events < EVENTS]
    assert few
    assert all(row.events_per_second is row.again_per_second is None for row in few)


@pytest.mark.slow
@pytest.mark.spot
@pytest.mark.usefixtures("quick")
def test_a_small_one(tmp_path: Path, rows: list[Measurement], capsys: pytest.CaptureFixture[str]) -> None:
    """The sizes are those that are committed; a finding about larger gates has nothing to stand on here."""
    pytest.importorskip("spot")
    assert main(["--out", str(tmp_path), "--max-arity", "1", "--texts"]) == 1
    said = capsys.readouterr()
    assert all(line.startswith("papers.languages: not confirmed: ") for line in said.err.splitlines())
    assert any("3n + k + 10 symbols" in line for line in said.err.splitlines())
    committed = {_cell(row): _sizes(row) for row in rows}
    fresh = list(read_rows((tmp_path / "languages.csv").read_text(encoding="utf-8")))
    assert {_cell(row): _sizes(row) for row in fresh} == {_cell(row): committed[_cell(row)] for row in fresh}
    assert {path.name for path in tmp_path.iterdir()} == {*texts(fresh), "languages.csv"}


def _cell(row: Measurement) -> tuple[object, ...]:
    return (row.tree, row.digest, row.semantics, row.language)


def _sizes(row: Measurement) -> tuple[object, ...]:
    sizes = (row.symbols, row.subformulas, row.states, row.edges, row.characters)
    return (row.result, row.reason, *sizes, row.run, row.events, row.walks, row.differing)


@pytest.mark.parametrize("width", Width)
def test_the_legend_of_languages_that_cannot_express_a_tree_fits_the_figure(
    width: Width, rows: list[Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    drawn: list[Any] = []

    def kept(drawing: Any) -> list[tuple[str, bytes]]:
        drawn.append(drawing)
        return []

    monkeypatch.setattr(plots, "saved", kept)
    list(plots.plots([row for row in rows if row.tree == "trees/late.rvaft"], width))
    assert drawn
    for drawing in drawn:
        drawing.canvas.draw()
        legend = drawing.legends[0].get_window_extent()
        assert legend.x0 >= 0 <= legend.y0
        assert legend.x1 <= drawing.bbox.x1
        assert legend.y1 <= drawing.bbox.y1
