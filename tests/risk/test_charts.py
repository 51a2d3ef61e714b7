"""Charts: the points of a curve and of a front stand where the axes say."""

import re
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import pytest

from rvaft.export import Format
from rvaft.export.chart import FORMATS, Chart, chart_text, ticks
from rvaft.risk.model import of_file
from rvaft.risk.probability import Analysis
from tests.cli.runs import failed, run
from tests.tex import unsound

pytest.importorskip("oxidd")

RISK: Final = Path(__file__).parents[2] / "docs" / "risk"
SVG: Final = "{http://www.w3.org/2000/svg}"


class Drawn:
    """A chart as a reader sees it: positions are read against the texts of its axes."""

    def __init__(self, text: str) -> None:
        root = ET.fromstring(text)
        texts = [(float(one.get("x") or 0), float(one.get("y") or 0), one) for one in root.iter(f"{SVG}text")]
        number = re.compile(r"[0-9.e+-]+").fullmatch
        across = [(x, float(one.text or "")) for x, _, one in texts if one.get("class") == "middle"]
        up = [
            (y - 4, float(one.text or ""))
            for _, y, one in texts
            if one.get("class") == "end" and number(one.text or "")
        ]
        self.texts = [one.text or "" for *_, one in texts]
        (path,) = [one.get("d") or "" for one in root.iter(f"{SVG}path") if one.get("class") == "curve"]
        places = [tuple(map(float, one.split())) for one in path.removeprefix("M").split("L")]
        self.points = [(_read(across, x), _read(up, y)) for x, y in places]
        marks = [(float(one.get("cx") or 0), float(one.get("cy") or 0)) for one in root.iter(f"{SVG}circle")]
        self.marks = [(_read(across, x), _read(up, y)) for x, y in marks]


def _read(axis: list[tuple[float, float]], place: float) -> float:
    (a, first), (b, last) = axis[0], axis[-1]
    return first + (place - a) / (b - a) * (last - first)


def test_a_curve_has_the_probabilities(tmp_path: Path) -> None:
    out = tmp_path / "curve.svg"
    assert run("risk", RISK / "pump.rvaft", "--time", "1000 h", "--curve", 10, "-o", out).output == ""
    drawn = Drawn(out.read_text())
    expected = Analysis(of_file(RISK / "pump.rvaft")).curve([360_000 * step for step in range(11)])
    assert [x for x, _ in drawn.points] == pytest.approx([100 * step for step in range(11)], abs=0.1)
    assert [y for _, y in drawn.points] == pytest.approx(expected, abs=1e-5)
    assert {"time t in h", "P(by time t)", "Probability of flooded"} <= set(drawn.texts)


def test_a_front_has_its_attacks(tmp_path: Path) -> None:
    out = tmp_path / "front.svg"
    assert run("attacks", RISK / "vault.rvaft", "--list", "front", "-o", out).output == ""
    drawn = Drawn(out.read_text())
    assert drawn.marks == [pytest.approx(one, abs=1e-3) for one in ((0, 0), (3, 0.5), (4, 0.72), (7, 0.86))]
    steps = [(0, 0), (3, 0), (3, 0.5), (4, 0.5), (4, 0.72), (7, 0.72), (7, 0.86), (8, 0.86)]
    assert drawn.points == [pytest.approx(one, abs=1e-3) for one in steps]
    assert "4: cost 7, P 0.86: a, b, c" in drawn.texts


@pytest.mark.parametrize("points", [[], [(0, 0)], [(0, 0), (1e-9, 3e-15)], [(0, 0), (5e12, 1)]])
def test_extreme_values_are_drawn(points: list[tuple[float, float]]) -> None:
    for form in (Format.SVG, Format.TIKZ):
        text = chart_text(Chart("<T> & _x", "t", "P", points), form).decode()
        assert "nan" not in text
        assert "inf" not in text.replace("\\infty", "")
    for _, y in points:
        assert ticks(y)[-1] >= y


@pytest.mark.parametrize("form", FORMATS)
def test_every_format(form: Format) -> None:
    if form in (Format.PDF, Format.PNG):
        pytest.importorskip("cairosvg")
    made = chart_text(Chart("a_b & <c>", "time in h", "P", [(0, 0), (1, 0.5)], rows=["x_1", "y & z"]), form)
    start = {Format.SVG: b"<?xml", Format.PDF: b"%PDF", Format.PNG: b"\x89PNG", Format.TIKZ: b"\\documentclass"}
    assert made.startswith(start[form])
    if form is Format.TIKZ:
        assert unsound(made.decode()) is None


def test_what_is_no_chart_is_refused(tmp_path: Path) -> None:
    pump, vault = RISK / "pump.rvaft", RISK / "vault.rvaft"
    failed(run("risk", pump, "--time", "1 h", "-o", tmp_path / "x.svg"), "-o draws a curve: add --curve N")
    failed(run("attacks", vault, "-o", tmp_path / "x.svg"), "add --list front")
    failed(run("attacks", vault, "--list", "damage-front", "-o", tmp_path / "x.svg"), "add --list front")
    failed(run("attacks", vault, "--list", "front", "-o", tmp_path / "x.dot"), "has none of the suffixes of a chart")
    failed(run("attacks", vault, "--list", "front", "--format", "csv", "-o", tmp_path / "x.svg"), "not the format csv")
