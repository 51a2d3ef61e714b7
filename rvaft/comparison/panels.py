"""What the plots show: for each measure the panels of a figure, and in each panel a series of points per language."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from rvaft.comparison.rows import Outcome, Row
from rvaft.model import Gate
from rvaft.verdict import Semantics


@dataclass(frozen=True, slots=True)
class Measure:
    """Something that is measured: its file name, the label of its axis, its value in a row, and how that ended."""

    name: str
    label: str
    value: Callable[[Row], float | None]
    outcome: Callable[[Row], Outcome | None]


def _size(row: Row) -> float | None:
    return row.subformulas if row.subformulas is not None else row.states


def _of_translation(row: Row) -> Outcome | None:
    return row.result


def _of_run(row: Row) -> Outcome | None:
    return row.run if row.result is Outcome.OK else row.result


MEASURES: Final = (
    Measure("symbols", "symbols", lambda row: row.symbols, _of_translation),
    Measure("parts", "subformulas, states or equations", _size, _of_translation),
    Measure("seconds", "seconds to translate", lambda row: row.seconds, _of_translation),
    Measure("speed", "events per second", lambda row: row.events_per_second, _of_run),
    Measure("speed-again", "known events per second", lambda row: row.again_per_second, _of_run),
)


@dataclass(frozen=True, slots=True)
class Point:
    """One cell: its place on the horizontal axis, and a value or how it ended without one.

    `differing` is true where the value is that of a text which gives other verdicts than the tree.
    """

    x: int
    value: float | None
    outcome: Outcome | None
    differing: bool = False

    @property
    def without(self) -> Outcome | None:
        """Why there is no value; None also for what the language does not have at all."""
        return self.outcome if self.value is None and self.outcome is not Outcome.OK else None


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel: `series` has the points of each language; `ticks` names the places where these are no numbers."""

    title: str
    label: str
    series: dict[str, tuple[Point, ...]]
    ticks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Figure:
    """The panels of one figure, which share the vertical axis."""

    name: str
    label: str
    panels: tuple[Panel, ...]

    def points(self, language: str) -> Iterator[Point]:
        """All points of a language."""
        return (point for panel in self.panels for point in panel.series.get(language, ()))

    def languages(self, known: Callable[[Point], object]) -> list[str]:
        """The languages with a point of which this is true, each in the same place in every figure."""
        spoken = sorted({language for panel in self.panels for language in panel.series})
        return [language for language in spoken if any(known(point) for point in self.points(language))]


_TITLES: Final = {
    Gate.OR: "OR",
    Gate.AND: "AND",
    Gate.SAND: "SAND",
    Gate.SAND_RL: "SAND, right to left",
    Gate.VOT: "VOT ⌈n/2⌉ of n",
}


def figures(rows: Sequence[Row]) -> Iterator[Figure]:
    """For each measure a figure of the gates under each semantics, and one of all other trees; those without any value are left out."""
    for measure in MEASURES:
        of_gates = [row for row in rows if row.gate is not None]
        for semantics in dict.fromkeys(row.semantics for row in of_gates):
            chosen = [row for row in of_gates if row.semantics is semantics]
            label = f"{measure.label}, {semantics}"
            yield from _figure(f"gates-{measure.name}-{semantics}", label, list(_gates(chosen, measure)))
        trees = [row for row in rows if row.gate is None]
        yield from _figure(f"trees-{measure.name}", measure.label, list(_trees(trees, measure)))


def _figure(name: str, label: str, panels: list[Panel]) -> Iterator[Figure]:
    points = (point for panel in panels for series in panel.series.values() for point in series)
    if any(point.value is not None for point in points):
        yield Figure(name, label, tuple(panels))


def _gates(rows: Sequence[Row], measure: Measure) -> Iterator[Panel]:
    """A panel per gate over the number of children; VOT has one for thresholds of half of them, and one for all thresholds of the most."""
    for gate in dict.fromkeys(row.gate for row in rows):
        assert gate is not None
        chosen = [row for row in rows if row.gate is gate]
        half = [row for row in chosen if row.threshold in (None, ((row.children or 0) + 1) // 2)]
        yield Panel(_TITLES[gate], "children n", _series(half, measure, lambda row: row.children or 0))
        if gate is Gate.VOT:
            most = max(row.children or 0 for row in chosen)
            whole = [row for row in chosen if row.children == most]
            yield Panel(f"VOT k of {most}", "threshold k", _series(whole, measure, lambda row: row.threshold or 0))


def _trees(rows: Sequence[Row], measure: Measure) -> Iterator[Panel]:
    """A panel per tree over the semantics."""
    order = [choice for choice in Semantics if any(row.semantics is choice for row in rows)]
    for tree, digest in dict.fromkeys((row.tree, row.digest) for row in rows):
        chosen = [row for row in rows if (row.tree, row.digest) == (tree, digest)]
        series = _series(chosen, measure, lambda row: order.index(row.semantics))
        yield Panel(tree, "", series, tuple(order))


def _series(rows: Iterable[Row], measure: Measure, place: Callable[[Row], int]) -> dict[str, tuple[Point, ...]]:
    found: dict[str, list[Point]] = {}
    for row in rows:
        outcome, value = measure.outcome(row), measure.value(row)
        found.setdefault(row.language, []).append(Point(place(row), value, outcome, bool(row.differing)))
    return {language: tuple(sorted(points, key=lambda point: point.x)) for language, points in found.items()}
