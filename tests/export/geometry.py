"""Where things are in a picture by Graphviz: boxes and lines of text, in points from the left and from above."""

import re
from dataclasses import dataclass
from itertools import combinations
from xml.dom import minidom


@dataclass(frozen=True)
class Box:
    """A frame, or the place of a line of text (a little less than it may take)."""

    left: float
    right: float
    top: float
    bottom: float

    def overlaps(self, other: "Box") -> bool:
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )

    @property
    def middle(self) -> float:
        return (self.left + self.right) / 2


@dataclass(frozen=True)
class Picture:
    """The frames of nodes by their identifier, all texts with their places, the width, and the smallest size of text."""

    frames: dict[str, Box]
    texts: list[tuple[str, Box]]
    width: float
    smallest: float

    def size_in(self, centimetres: float) -> float:
        """Points of the smallest text where the picture is set that wide."""
        return self.smallest * min(1.0, centimetres / 2.54 * 72 / self.width)


def measured(svg: bytes) -> Picture:
    document = minidom.parseString(svg)
    frames: dict[str, Box] = {}
    for group in document.getElementsByTagName("g"):
        shapes = [*group.getElementsByTagName("polygon"), *group.getElementsByTagName("path")]
        if group.getAttribute("class").split()[:1] == ["node"] and shapes:
            title = group.getElementsByTagName("title")[0].firstChild
            assert title is not None
            outline = shapes[0].getAttribute("points") or shapes[0].getAttribute("d")
            points = [float(number) for number in re.findall(r"-?[\d.]+", outline)]
            frames[str(title.nodeValue)] = Box(min(points[::2]), max(points[::2]), min(points[1::2]), max(points[1::2]))
    texts = [
        (str(text.firstChild.nodeValue), _place(text))
        for text in document.getElementsByTagName("text")
        if text.firstChild
    ]
    assert document.documentElement is not None
    width = float(document.documentElement.getAttribute("width").removesuffix("pt"))
    sizes = [float(text.getAttribute("font-size")) for text in document.getElementsByTagName("text")]
    return Picture(frames, texts, width, min(sizes))


def _place(text: minidom.Element) -> Box:
    x, y = float(text.getAttribute("x")), float(text.getAttribute("y"))
    size = float(text.getAttribute("font-size"))
    assert text.firstChild is not None
    width = 0.4 * size * len(str(text.firstChild.nodeValue))
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
