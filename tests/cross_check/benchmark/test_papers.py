"""The comparison in papers/languages: what is committed there, and that it can be made anew."""

from pathlib import Path

import pytest

from cross_check.benchmark.measurement import Measurement, Outcome, gate_subjects
from cross_check.benchmark.tables import latex_text, read_rows
from papers.languages.__main__ import FOLDER, main
from papers.languages.findings import FINDINGS, missed
from papers.languages.note import note, short
from rvaft import NotExpressible, translate


@pytest.fixture(scope="module")
def rows() -> list[Measurement]:
    return list(read_rows((FOLDER / "languages.csv").read_text(encoding="utf-8")))


def test_all_was_measured(rows: list[Measurement]) -> None:
    assert len(rows) == (5 * 12 + 78) * 4 * 4
    assert {row.children for row in rows} == set(range(1, 13))
    assert not any(row.broken for row in rows)


def test_every_finding_holds_and_one_that_does_not_is_told(rows: list[Measurement]) -> None:
    assert len(FINDINGS) > 10
    assert missed(rows) == []
    assert len(missed([row for row in rows if row.result is Outcome.TOO_LARGE])) > 10


def test_the_pages_are_those_of_the_measurements(rows: list[Measurement]) -> None:
    assert (FOLDER / "README.md").read_text(encoding="utf-8") == note(rows)
    assert (FOLDER / "short.tex").read_text(encoding="utf-8") == latex_text(short(rows))
    assert (FOLDER / "languages.tex").read_text(encoding="utf-8") == latex_text(rows)


@pytest.mark.spot
def test_committed_sizes_are_those_of_the_texts(rows: list[Measurement]) -> None:
    pytest.importorskip("spot")
    trees = {subject.name: subject.tree for subject in gate_subjects(max_arity=5)}
    small = [row for row in rows if row.tree in trees]
    assert len(small) == (5 * 5 + 15) * 4 * 4
    for row in small:
        try:
            made = translate(trees[row.tree], row.language, semantics=row.semantics)
        except NotExpressible:
            assert row.result is Outcome.NOT_EXPRESSIBLE
            continue
        found = made.metrics
        expected = (row.symbols, row.subformulas, row.states, row.edges, row.characters)
        assert (found.symbols, found.subformulas, found.states, found.edges, len(made.text)) == expected, row.tree


@pytest.mark.slow
@pytest.mark.spot
def test_a_small_one(tmp_path: Path, rows: list[Measurement], capsys: pytest.CaptureFixture[str]) -> None:
    """The sizes are those that are committed; a finding about larger gates has nothing to stand on here."""
    pytest.importorskip("spot")
    assert main(["--out", str(tmp_path), "--max-arity", "2", "--texts"]) == 1
    said = capsys.readouterr()
    assert said.out == "208 measurements: 178 ok, 30 not expressible\n"
    assert all(line.startswith("papers.languages: not confirmed: ") for line in said.err.splitlines())
    assert any("3n + k + 10 symbols" in line for line in said.err.splitlines())
    committed = {_cell(row): _sizes(row) for row in rows}
    fresh = list(read_rows((tmp_path / "languages.csv").read_text(encoding="utf-8")))
    assert {_cell(row): _sizes(row) for row in fresh} == {_cell(row): committed[_cell(row)] for row in fresh}
    assert {path.name for path in tmp_path.iterdir()} == {"README.md", "languages.csv", "languages.tex", "short.tex"}


def _cell(row: Measurement) -> tuple[object, ...]:
    return (row.tree, row.digest, row.semantics, row.language)


def _sizes(row: Measurement) -> tuple[object, ...]:
    sizes = (row.symbols, row.subformulas, row.states, row.edges, row.characters)
    return (row.result, row.reason, *sizes, row.run, row.events, row.walks, row.differing)
