"""What Matplotlib is told to draw."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import pytest

from cross_check.benchmark import Outcome, Row
from cross_check.benchmark.plots import LAYOUTS, MARKS, drawn, figures, look
from cross_check.benchmark.tables import Width
from tests.comparison.rows import ROW, growing, unable

pytest.importorskip("matplotlib")
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing


@pytest.fixture(params=Width)
def width(request: pytest.FixtureRequest) -> Width:
    return Width(request.param)


def first(rows: Sequence[Row], width: Width = Width.COLUMN) -> Drawing:
    return drawn(next(iter(figures(rows))), LAYOUTS[width])


def words(drawing: Drawing) -> list[str]:
    (legend,) = drawing.legends
    return [text.get_text() for text in legend.get_texts()]


def strips(drawing: Drawing) -> Iterator[Axes]:
    return (strip for axes in drawing.axes for strip in axes.child_axes if isinstance(strip, Axes))


def of_one(language: str, *symbols: int | None) -> list[Row]:
    return [replace(ROW, language=language, children=n, symbols=size) for n, size in enumerate(symbols, 1)]


@pytest.mark.parametrize("sizes", [(1, 1000), (10, 10), (600, 900), (1, 10**6)])
def test_no_marker_touches_the_frame(sizes: tuple[int, int]) -> None:
    axes = first(of_one("rml", *sizes)).axes[0]
    low, high = axes.get_ylim()
    assert low < min(sizes) / 1.1
    assert max(sizes) * 1.1 < high
    assert axes.get_xlim() == (0.4, 2.6)
    assert len([tick for tick in axes.get_yticks() if low <= tick <= high]) >= 2


def test_what_has_no_value_stands_in_a_frame_of_its_own(width: Width) -> None:
    """Each language has the same row in every panel, with its name beside it; a frame of its own is no part of the axis of values."""
    drawing = first([*growing("rml"), *growing("automaton"), *of_one("ltlf", 1, 2)], width)
    conjunction, half, most = strips(drawing)
    marks = {MARKS[outcome] for outcome in (Outcome.NOT_EXPRESSIBLE, Outcome.TOO_LARGE, Outcome.TIMEOUT)}
    for strip, expected in (conjunction, marks), (half, marks), (most, {MARKS[Outcome.TIMEOUT]}):
        drawn = [(line.get_ydata()[0], line.get_marker()) for line in strip.lines]  # type: ignore[index]
        assert {row for row, _ in drawn} == {0, 1}
        assert {mark for _, mark in drawn} == expected
    assert [label.get_text() for label in conjunction.get_yticklabels()] == ["automaton", "rml"]


def test_titles_are_on_the_page() -> None:
    drawing = first([*growing("rml")[:6], *growing("automaton")[:6], *growing("ltlf")[:6]])
    drawing.draw_without_rendering()
    tops = [strip.title.get_window_extent().y1 for strip in strips(drawing)]
    assert max(tops) < drawing.bbox.y1


def test_without_gaps_there_is_no_strip() -> None:
    assert list(strips(first(of_one("rml", 1, 2)))) == []


def test_the_legend_has_those_that_are_drawn() -> None:
    """A language without any value is named beside the strip; one that has no such number at all is nowhere."""
    rows = [*of_one("rml", 1, 2), *of_one("ltlf", None), unable(Outcome.TOO_LARGE, "automaton")]
    assert words(first(rows)) == ["rml", "too large"]


def test_other_verdicts_are_ringed() -> None:
    drawing = first([ROW, replace(ROW, children=4, symbols=20, differing=2)])
    assert words(drawing) == ["rml", "other verdicts"]
    (rings,) = (line for line in drawing.axes[0].lines if line.get_markersize() > 7)
    assert list(rings.get_xdata()) == [4]  # type: ignore[arg-type]
    assert list(rings.get_ydata()) == [20]  # type: ignore[arg-type]
    assert words(first([ROW])) == ["rml"]


def test_a_language_looks_the_same_whoever_is_beside_it() -> None:
    alone, both = first(of_one("rml", 1)), first([*of_one("automaton", 1), *of_one("rml", 1)])
    colours = [
        [line.get_color() for line in drawing.axes[0].lines if line.get_linestyle() != "None"]
        for drawing in (alone, both)
    ]
    assert colours == [[look("rml")["color"]], [look("automaton")["color"], look("rml")["color"]]]
    looks = {tuple(look(name).items()) for name in ("automaton", "ltlf", "rml", "rml-paper", "rml-prolog", "other")}
    assert len(looks) == 6
