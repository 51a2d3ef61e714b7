r"""A specification as a listing in LaTeX, for the package `listings`.

The text stands there as it is, so that what is printed can be copied and run. Only what `listings` cannot read, which is all beyond
ASCII, and what would end the listing early are escaped to LaTeX.
"""

import re
from typing import Final

from rvaft.backend import Highlighting
from rvaft.latex import escaped

_OPEN: Final = "(*@"
_CLOSE: Final = "@*)"
_HARD: Final = re.compile(r"[^\n\t -~]|\\(?=end\{lstlisting\})|" + re.escape(_OPEN[0]) + f"(?={re.escape(_OPEN[1:])})")
_OPTIONS: Final = (
    r"basicstyle=\scriptsize\ttfamily",
    r"columns=fullflexible",
    r"keepspaces=true",
    r"showstringspaces=false",
    r"upquote=true",
    r"breaklines=true",
    r"breakatwhitespace=true",
    rf"escapeinside={{{_OPEN}}}{{{_CLOSE}}}",
)


def listing(text: str, highlighting: Highlighting | None) -> str:
    r"""The text in an `lstlisting` behind the definition of its language, which may move to the preamble.

    Needs the packages `listings` and `textcomp`.
    """
    lines = [r"% Needs \usepackage{listings} and \usepackage{textcomp}."]
    options: tuple[str, ...] = _OPTIONS
    if highlighting is not None:
        lines += highlighting.definition.strip().splitlines()
        options = (*_OPTIONS, f"language={highlighting.name}")  # the last word is the language's
    body = _HARD.sub(lambda found: f"{_OPEN}{escaped(found[0])}{_CLOSE}", text.rstrip("\n"))
    return "\n".join([*lines, f"\\begin{{lstlisting}}[{', '.join(options)}]", body, r"\end{lstlisting}", ""])
