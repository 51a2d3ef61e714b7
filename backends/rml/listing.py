"""RML for the package `listings` of LaTeX: words, comments and strings, in styles that survive print without colour."""

from typing import Final

from backends.rml.words import FUNCTIONS, KEYWORDS, TYPES, VALUES
from rvaft.backend import Highlighting


def _words(words: frozenset[str]) -> str:
    return f"{{{','.join(sorted(words))}}}"


HIGHLIGHTING: Final = Highlighting(
    "RML",
    rf"""
\lstdefinelanguage{{RML}}{{
  morekeywords={_words(KEYWORDS | TYPES)},
  morekeywords=[2]{_words(FUNCTIONS | VALUES)},
  keywordstyle=\bfseries,
  keywordstyle=[2]\itshape,
  sensitive=true,
  morecomment=[l]{{//}},
  commentstyle=\itshape,
  morestring=[b]',
}}
""",
)
