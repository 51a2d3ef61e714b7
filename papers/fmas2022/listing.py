"""What the Listing of section 4.3 says, φ, in RML that compiles: the tree, translated by the backend `rml`."""

from typing import Final

import rvaft
from papers.fmas2022 import tex
from rvaft.backend import backend
from rvaft.export.latex import listing
from rvaft.model.tree import RVAFT

_CAPTION: Final = r"$\varphi$ in RML, from the tree: what the Listing of the paper is to express."


def listing_rml(tree: RVAFT) -> str:
    """The specification; under `strict`, as the Listing filters no events."""
    return rvaft.translate(tree, "rml", semantics="strict").text


def listing_tex(tree: RVAFT) -> str:
    """The same as LaTeX, with the definition of the language for the package `listings`."""
    made = listing(listing_rml(tree), backend("rml").highlighting)
    return tex.captioned(made, caption=_CAPTION, label="lst:phi")
