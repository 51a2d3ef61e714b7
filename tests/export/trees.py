"""Trees to draw."""

from collections.abc import Sequence
from pathlib import Path

from rvaft import RVAFT, Gate, Node

PINNED = Path(__file__).with_name("pinned")
"""Trees and drawings of them; `every.rvaft` has all gates and all parts of nodes, one node shared."""

AWKWARD = (
    'a "quoted" word',
    r"\N \G \\ back\slash\\",
    "<b>bold</b> & &amp; ]]> -->",
    "line one\nline two\ttab\r\nline three",
    "%$#_{}~^\\ [x] , = ;",
    "日本語のとても長いラベルがここにあります",
    "кириллица العربية",
    "escape \x1b[31m, zero \x00, next line \x85, right to left \u202e",
    "x" * 100,
    "   ",
    "",
    "\\",
    '"];}',
    "}]\\end{forest}",
    "</td></tr></table>",
    "list [ decontaminations ]",
    "]]",
    "a &nbsp; b &lt; c",
    "star\n* [x]\n[y]",
    "Größe ≥ 5 °C → µΩ “½” –",
)
"""Labels that try to leave their place."""


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
