"""φ₁ to φ₄ and φ of section 4.2, extracted from the tree, as LaTeX; and what the Listing of section
4.3 says, φ, in RML that compiles.
"""

from typing import Final

import rvaft
from papers.fmas2022 import tex
from rvaft.backend import backend
from rvaft.export.latex import listing
from rvaft.export.property_text import align_latex
from rvaft.model.tree import RVAFT

_CAPTION: Final = r"$\varphi$ in RML, from the tree: what the Listing of the paper is to express."


def formulas_tex(tree: RVAFT) -> str:
    """The formulas of the branches and that of the whole tree, one below the other; what choices share stands once."""
    return "\n".join([*align_latex([*rvaft.branches(tree), tree]), ""])


def listing_rml(tree: RVAFT) -> str:
    """The specification; under `strict`, as the Listing filters no events."""
    return rvaft.translate(tree, "rml", semantics="strict").text


def listing_tex(tree: RVAFT) -> str:
    """The same as LaTeX, with the definition of the language for the package `listings`."""
    made = listing(listing_rml(tree), backend("rml").highlighting)
    return tex.captioned(made, caption=_CAPTION, label="lst:phi")
