"""Where things are in a picture: boxes and lines of text, in points from the left and from above."""

import re
import shutil
from itertools import combinations
from typing import NamedTuple
from urllib.parse import unquote
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


def drawn(svg: bytes) -> Picture:
    """A picture of a tree: frames of boxes, by their nodes, and of symbols, by `gate of`, `leaf of`; texts."""
    document, frames, root = minidom.parseString(svg), dict[str, Box](), minidom.parseString(svg).documentElement
    assert root is not None
    size = float(re.findall(r"font-size: ([\d.]+)px", svg.decode())[0])
    scale = float(root.getAttribute("width").removesuffix("pt")) / float(root.getAttribute("viewBox").split()[2])
    for group in document.getElementsByTagName("g"):
        name = unquote(group.getAttribute("id")).removeprefix("node-")
        for shape in (one for one in group.childNodes if isinstance(one, minidom.Element) and name):
            kind = shape.getAttribute("class").split()[:1]
            if kind == ["box"]:
                x, y, wide, high = (float(shape.getAttribute(one)) for one in ("x", "y", "width", "height"))
                frames[name] = Box(x, x + wide, y, y + high)
            elif kind in (["gate"], ["leaf"]):
                points = [float(number) for number in re.findall(r"-?[\d.]+", shape.getAttribute("d"))]
                # the controls of the curves are inside, but for the arch of AND, which is lower by a sixth
                across, down = points[::2], points[1::2]
                arch = (max(down) - min(down)) / 7 if "C" in shape.getAttribute("d") and kind == ["gate"] else 0
                frames[f"{kind[0]} of {name}"] = Box(min(across), max(across), min(down) + arch, max(down))
    elements = document.getElementsByTagName("text")
    texts = [(_text(text), _line(text, size)) for text in elements if text.firstChild]
    return Picture(frames, texts, float(root.getAttribute("width").removesuffix("pt")), size * scale)


def _line(text: minidom.Element, size: float) -> Box:
    x, y = (float(text.getAttribute(name)) for name in ("x", "y"))
    words, width = text.getAttribute("class").split(), 0.4 * size * len(_text(text))
    left = x if "start" in words else x - width if "end" in words else x - width / 2
    return Box(left, left + width, y - 0.6 * size, y)


def edges(svg: bytes) -> dict[tuple[int, int], list[tuple[float, float]]]:
    """The corners of the edges by the numbers of their ends; the controls of curves are corners, too."""
    found = {}
    for path in minidom.parseString(svg).getElementsByTagName("path"):
        if path.getAttribute("data-line"):
            numbers = [float(number) for number in re.findall(r"-?[\d.]+", path.getAttribute("d"))]
            first, last = path.getAttribute("data-line").split()
            found[int(first), int(last)] = list(zip(numbers[::2], numbers[1::2], strict=True))
    return found


def measured(svg: bytes) -> Picture:
    """A picture by Graphviz."""
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
