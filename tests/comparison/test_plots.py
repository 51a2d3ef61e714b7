"""The figures: what is in them, and that something can be seen."""

import io
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from cross_check.benchmark import Outcome
from cross_check.benchmark.plots import LAYOUTS, figures, pages, plots, write_plots
from cross_check.benchmark.tables import Width
from rvaft.errors import ToolMissing
from rvaft.model.verdict import Semantics
from tests.comparison.rows import ROW, growing, unable

ROWS = [*growing("rml"), *growing("automaton")]
TREES = [
    replace(ROW, tree=tree, gate=None, children=None, semantics=semantics)
    for tree in ("a_$x$_{1}.rvaft", "樹/木\n.rvaft", "trees/" + "long" * 40 + ".rvaft")
    for semantics in Semantics
]


def test_panels() -> None:
    (figure,) = (figure for figure in figures(ROWS) if figure.name == "gates-symbols-strict")
    assert [panel.title for panel in figure.panels] == ["AND", "VOT ⌈n/2⌉ of n", "VOT k of 6"]
    conjunction, half, most = figure.panels
    points = conjunction.series["rml"]
    assert [(point.x, point.value) for point in points][:3] == [(1, 3), (2, 9), (3, 27)]
    assert [point.outcome for point in points][3:] == [Outcome.NOT_EXPRESSIBLE, Outcome.TOO_LARGE, Outcome.TIMEOUT]
    assert [point.x for point in half.series["automaton"]] == [1, 2, 3, 4, 5, 6]
    assert [point.x for point in most.series["automaton"]] == [1, 2, 3, 4, 5, 6]


def test_a_value_of_a_text_with_other_verdicts_is_marked() -> None:
    figure = next(iter(figures([ROW, replace(ROW, children=4, differing=2)])))
    assert [point.differing for point in figure.points("rml")] == [False, True]


def test_which_figures() -> None:
    """A measure that nobody has is left out; trees are apart from gates."""
    names = [figure.name for figure in figures([*ROWS, *TREES])]
    assert names == [
        *("gates-symbols-strict", "trees-symbols", "gates-seconds-strict", "trees-seconds"),
        *("gates-speed-strict", "trees-speed", "gates-speed-again-strict", "trees-speed-again"),
    ]


@pytest.mark.parametrize("width", Width)
def test_pictures(width: Width) -> None:
    image = pytest.importorskip("matplotlib.image")
    files = dict(islice(plots([*ROWS, *TREES], width), 4))
    assert list(files) == [
        f"{name}.{form}" for name in ("gates-symbols-strict", "trees-symbols") for form in ("pdf", "png")
    ]
    centimetres = 17.4 if width is Width.PAGE else 8.5
    for name, data in files.items():
        if name.endswith(".pdf"):
            assert data.startswith(b"%PDF-")
            assert len(data) > 5_000
        else:
            pixels = image.imread(io.BytesIO(data), format="png")
            assert abs(pixels.shape[1] - centimetres / 2.54 * 300) <= 1
            assert 400 < pixels.shape[0] < 15.5 / 2.54 * 300
            assert 0.005 < (pixels[:, :, :3].min(axis=2) < 0.5).mean() < 0.2


def test_the_same_bytes_every_time() -> None:
    pytest.importorskip("matplotlib")
    assert [*islice(plots([ROW]), 2)] == [*islice(plots([ROW]), 2)]


def test_many_trees_are_several_pages() -> None:
    rows = [replace(ROW, tree=str(number), gate=None) for number in range(14)]
    assert [(page.name, len(page.panels)) for page in islice(pages(rows, LAYOUTS[Width.PAGE]), 2)] == [
        ("trees-symbols-1", 9),
        ("trees-symbols-2", 5),
    ]


def test_nothing_to_draw_makes_no_folder(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    assert write_plots([unable(Outcome.TOO_LARGE)], tmp_path / "new") == []
    assert not (tmp_path / "new").exists()


def test_without_matplotlib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ToolMissing, match=r"pip install 'rvaft\[papers\]'"):
        list(plots(ROWS))
