"""Figures 4a and 4b: the whole tree, and the pruned one with the names of its nodes."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import rvaft
from rvaft.export import Format, Look, draw

FIGURES: Final[Mapping[str, tuple[str, Look]]] = {
    "figure4a": ("full.rvaft", Look(names=False, wrap=12, stagger=True)),
    "figure4b": ("pruned.rvaft", Look(wrap=12)),
}
"""Name of the figure -> file of the tree, and what is shown of it."""
FORMS: Final = (Format.PDF, Format.PNG)


def figures(trees: Path) -> Iterator[tuple[str, bytes]]:
    """The name of each file and what is in it; raises `ToolMissing` without Graphviz, `ToolFailed`, `OSError`."""
    for name, (file, look) in FIGURES.items():
        tree = rvaft.load(trees / file)
        for form in FORMS:
            yield f"{name}.{form}", draw(tree, form, look)
