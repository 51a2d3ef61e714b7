"""Trees to draw."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rvaft import RVAFT, Gate, Node
from tests.tables import rows

PINNED = Path(__file__).with_name("pinned")
"""Trees and drawings of them; `every.rvaft` has all gates and all parts of nodes, one node shared."""

AWKWARD: Final[list[str]] = rows(__file__, "awkward.txt")


def awkward(texts: Sequence[str] = AWKWARD) -> RVAFT:
    """Every text as a label, and as the name of a node."""
    leaves = [Node(f"leaf {number}", label=text) for number, text in enumerate(texts)]
    named = [Node(text) for text in texts if text.strip()]
    top = Node('top "<&nbsp;\\', Gate.SAND_RL, tuple(node.name for node in leaves + named))
    return RVAFT(top.name, [top, *leaves, *named])


def chain(length: int) -> RVAFT:
    """A chain of gates."""
    gates = [Node(f"g{number}", Gate.AND, (f"g{number + 1}",)) for number in range(length)]
    return RVAFT("g0", [*gates, Node(f"g{length}")])
