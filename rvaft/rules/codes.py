"""Codes of errors that are no findings on a tree: no rule reports them, and no tree shows them."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Code:
    """A code, and the words that explain it."""

    code: str
    title: str
    explanation: str


SYNTAX: Final = "syntax"
"""The code under which `check --format json` reports a text that is no tree."""

CODES: Final[dict[str, Code]] = {
    code.code: code
    for code in (
        Code(
            SYNTAX,
            "the text is not in the language",
            "The file cannot be read, or its text is not in the language of trees. The message says what was expected at that "
            "place; no rule was looked at.",
        ),
        Code(
            "no-branch",
            "no such branch",
            "The tree has no branch of the number asked for, or no branch of the kind, or the branch asked for does not have the "
            "kind. `rvaft branches TREE` lists all branches with their numbers, from 1, and their kinds.",
        ),
    )
}
