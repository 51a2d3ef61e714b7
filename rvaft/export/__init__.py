"""Drawings of trees, and trees in other formats: the formats and their suffixes."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import PurePath
from typing import Final


class Format(StrEnum):
    """The formats in which a tree can be drawn or written."""

    TREE = "tree"
    DOT = "dot"
    SVG = "svg"
    PDF = "pdf"
    PNG = "png"
    TIKZ = "tikz"
    JSON = "json"
    GALILEO = "galileo"
    OPEN_PSA = "open-psa"
    RVAFT = "rvaft"

    @property
    def drawing(self) -> bool:
        """Whether this is a drawing, not the complete tree."""
        return self not in WRITTEN


WRITTEN: Final = frozenset({Format.JSON, Format.GALILEO, Format.OPEN_PSA, Format.RVAFT})
"""The formats of the complete tree."""
PICTURES: Final = (Format.SVG, Format.PDF, Format.PNG)
SUFFIXES: Final[Mapping[str, Format]] = {
    ".txt": Format.TREE,
    ".gv": Format.DOT,
    ".tex": Format.TIKZ,
    ".dft": Format.GALILEO,
    ".xml": Format.OPEN_PSA,
    **{f".{form}": form for form in Format if form not in (Format.TREE, Format.OPEN_PSA)},
}


def format_of(file: str) -> Format | None:
    """Return the format for a suffix, if any."""
    return SUFFIXES.get(PurePath(file).suffix.lower())
