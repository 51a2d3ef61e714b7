"""Where things are in a picture by Graphviz: boxes and lines of text, in points from the left and from above."""

import re
import shutil
from itertools import combinations
from typing import NamedTuple
from xml.dom import minidom

import pytest

needs_dot = pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")


class Box(NamedTuple):
    """A frame, or the place of a line of text (a little less than it may take)."""

    left: float
    right: float
    top: float
    bottom: float

    def overlaps(self, other: "Box") -> bool:
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom

    @property
    def middle(self) -> float:
        return (self.left + self.right) / 2


class Picture(NamedTuple):
    """The frames of nodes by their identifier, all texts with their places, the width, and the
    smallest size of text.
    """

    frames: dict[str, Box]
    texts: list[tuple[str, Box]]
    width: float
    smallest: float

    def size_in(self, centimetres: float) -> float:
        """Points of the smallest text where the picture is set that wide."""
        return self.smallest * min(1.0, centimetres / 2.54 * 72 / self.width)


def measured(svg: bytes) -> Picture:
    document, frames = minidom.parseString(svg), dict[str, Box]()
    for group in document.getElementsByTagName("g"):
        shapes = [*group.getElementsByTagName("polygon"), *group.getElementsByTagName("path")]
        if group.getAttribute("class").split()[:1] == ["node"] and shapes:
            outline = shapes[0].getAttribute("points") or shapes[0].getAttribute("d")
            points = [float(number) for number in re.findall(r"-?[\d.]+", outline)]
            across, down = points[::2], points[1::2]
            frames[_text(group.getElementsByTagName("title")[0])] = Box(min(across), max(across), min(down), max(down))
    elements = document.getElementsByTagName("text")
    texts = [(_text(text), _place(text)) for text in elements if text.firstChild]
    assert document.documentElement is not None
    width = float(document.documentElement.getAttribute("width").removesuffix("pt"))
    return Picture(frames, texts, width, min(float(text.getAttribute("font-size")) for text in elements))


def _text(element: minidom.Element) -> str:
    return "".join(str(child.nodeValue) for child in element.childNodes)


def _place(text: minidom.Element) -> Box:
    x, y, size = (float(text.getAttribute(name)) for name in ("x", "y", "font-size"))
    width = 0.4 * size * len(_text(text))
    left = {"start": x, "middle": x - width / 2, "end": x - width}[text.getAttribute("text-anchor")]
    return Box(left, left + width, y - 0.6 * size, y)


def pdf_width(pdf: bytes) -> float:
    """The width of the page, in points."""
    found = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+)", pdf)
    assert found is not None
    return float(found[1])


def overlaps(picture: Picture) -> list[tuple[str, str]]:
    """The pairs of frames, and of texts, that lie one upon the other."""
    named = [*picture.frames.items()], picture.texts
    return [(a[0], b[0]) for things in named for a, b in combinations(things, 2) if a[1].overlaps(b[1])]
