"""What the advice on common slips has in common: what is told, and which word may have been meant."""

from collections.abc import Callable
from difflib import get_close_matches
from typing import NamedTuple, TypeAlias

from rvaft.language.lexemes import Situation


class Advice(NamedTuple):
    """What to tell, and the position in the text that it is about."""

    message: str
    position: int


Hint: TypeAlias = Callable[[Situation], Advice | None]
"""A function that knows one slip: what to tell about it where it is met, else None."""


def meant(word: str, known: tuple[str, ...]) -> str | None:
    """The known word that a misspelt one comes close to."""
    if len(word) > 20:  # difflib would take its time
        return None
    if word.lower() in known:
        return word.lower()
    for candidate in known:
        if sorted(word) == sorted(candidate):  # letters swapped, which difflib finds too far away in short words
            return candidate
    return next(iter(get_close_matches(word, known, 1, 0.75)), None)
