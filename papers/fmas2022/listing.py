"""φ₁ to φ₄ and φ of section 4.2 as LaTeX, and the Listing of section 4.3 as RML."""

from typing import Final

import rvaft
from papers.fmas2022 import tex
from rvaft.backend import backend
from rvaft.export.latex import listing
from rvaft.export.property_text import align_latex
from rvaft.model.tree import RVAFT

_CAPTION: Final = r"$\varphi$ in RML, from the tree: what the Listing of the paper is to express."


def formulas_tex(tree: RVAFT) -> str:
    """Return the formulas of the branches and of the whole tree, one below the other."""
    return "\n".join([*align_latex([*rvaft.branches(tree), tree]), ""])


def listing_rml(tree: RVAFT) -> str:
    """Return the specification under `strict`, because the Listing filters no events."""
    return rvaft.translate(tree, "rml", semantics="strict").text


def listing_tex(tree: RVAFT) -> str:
    """Return the specification as LaTeX, with its definition for the package `listings`."""
    made = listing(listing_rml(tree), backend("rml").highlighting)
    return tex.captioned(made, caption=_CAPTION, label="lst:phi")
