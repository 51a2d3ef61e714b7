"""Figures 4a and 4b: what stands in them, and that a print of them is not blank and can be read."""

import re
import zlib

import pytest

import rvaft
from papers.fmas2022.figures import FIGURES, figures
from papers.fmas2022.making import PRINTED
from papers.fmas2022.places import TREES
from rvaft.export import Format
from rvaft.export.drawing import draw
from tests.export.geometry import drawn, pdf_width

pytest.importorskip("cairosvg")

POINTS_PER_CM = 72 / 2.54
SMALLEST = 7.0
"""Points of the smallest text in print."""


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return dict(figures(TREES))


def test_every_label_is_there_and_gates_are_as_in_the_paper() -> None:
    """The events of the pruned tree are named, and those of the whole are not."""
    for name, gates in (("figure4a", [2, 4, 2, 1]), ("figure4b", [2, 3, 2, 0])):
        tree = rvaft.load(TREES / FIGURES[name][0])
        svg = draw(tree, Format.SVG, FIGURES[name][1])
        shown = " ".join(text for text, _ in drawn(svg).texts)
        assert all((node.label or node.name) in shown for node in tree.top_down())
        assert [svg.count(f'class="gate {gate}"'.encode()) for gate in ("or", "and", "sand", "vot")] == gates
        assert ("new_message" in shown, "2/3" in shown) == (False, name == "figure4a")
    assert {f"ev{n}" for n in range(1, 11)} <= set(shown.split())


@pytest.mark.parametrize("name", FIGURES)
def test_a_pdf_is_one_page_with_strokes_and_text(files: dict[str, bytes], name: str) -> None:
    data = files[f"{name}.pdf"]
    assert data.startswith(b"%PDF")
    assert len(data) > 8_000
    assert len(re.findall(rb"/Type\s*/Page\b", data)) == 1
    streams = [_inflated(found[1]) for found in re.finditer(rb"stream\r?\n(.*?)endstream", data, re.DOTALL)]
    page = max(streams, key=lambda stream: stream.count(b"Tj") + stream.count(b"TJ"))
    assert page.count(b"TJ") + page.count(b"Tj") > 20
    assert len(re.findall(rb"\bS\b", page)) > 20


def _inflated(stream: bytes) -> bytes:
    try:
        return zlib.decompressobj().decompress(stream)
    except zlib.error:
        return b""


@pytest.mark.parametrize(("name", "width"), [(name, width) for name, width, _ in PRINTED if name in FIGURES])
def test_text_can_be_read_at_the_width_of_the_document(files: dict[str, bytes], name: str, width: float) -> None:
    file, look = FIGURES[name]
    found = drawn(draw(rvaft.load(TREES / file), Format.SVG, look))
    printed = pdf_width(files[f"{name}.pdf"])
    assert printed == pytest.approx(found.width, abs=2), "the PDF is what is printed, and has no margin of its own"
    assert found.smallest * min(width * POINTS_PER_CM / printed, 1.0) >= SMALLEST


def test_a_pdf_has_the_same_bytes_whenever_it_is_drawn(
    files: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")  # as if drawn on another day, where a program heeds that
    file, look = FIGURES["figure4b"]
    assert draw(rvaft.load(TREES / file), Format.PDF, look) == files["figure4b.pdf"]
    assert b"/CreationDate (D:19700101000000" in files["figure4b.pdf"]
