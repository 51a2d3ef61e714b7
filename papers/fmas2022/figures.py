"""Figures 4a and 4b: the whole tree, and the pruned tree with node names."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import rvaft
from rvaft.export import Format
from rvaft.export.drawing import draw
from rvaft.export.layout import Look

FIGURES: Final[Mapping[str, tuple[str, Look]]] = {
    "figure4a": ("full.rvaft", Look(names=False, wrap=12, stagger=True)),
    "figure4b": ("pruned.rvaft", Look(wrap=12)),
}
"""Figure name -> file of the tree, and drawing options."""
FORMS: Final = (Format.PDF, Format.PNG)


def figures(trees: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the name and content of each file; raises `ToolMissing` without CairoSVG, and
    `OSError`.
    """
    for name, (file, look) in FIGURES.items():
        tree = rvaft.load(trees / file)
        for form in FORMS:
            yield f"{name}.{form}", draw(tree, form, look)
