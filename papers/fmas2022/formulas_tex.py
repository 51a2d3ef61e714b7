"""φ₁ to φ₄ and φ of section 4.2, extracted from the tree, as LaTeX."""

from rvaft.export.property_text import align_latex
from rvaft.model.tree import RVAFT


def formulas_tex(tree: RVAFT) -> str:
    """The formulas of the branches and that of the whole tree, one below the other; what choices share stands once."""
    return "\n".join([*align_latex([*tree.branches(), tree]), ""])
