"""Guards in sympy: a simpler form for display, and proofs of contradiction.

Nothing here runs or emits a guard: algebra holds for real numbers, guards are undefined where a value has the wrong type and round
where it is a double. What sympy gets are symbols of its own, never text of a tree. Importing this package imports sympy.
"""

from rvaft.algebra.contradiction import contradictory, contradictory_over_reals
from rvaft.algebra.display import simplified, simplify_text

__all__ = ["contradictory", "contradictory_over_reals", "simplified", "simplify_text"]
