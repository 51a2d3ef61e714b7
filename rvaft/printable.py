"""Text that comes from a file or an event, made safe to show: on one line and without control codes."""

import unicodedata
from typing import Final

_JOINERS: Final = "\u200c\u200d"
"""Invisible, but parts of words in several scripts."""


def visible(text: str) -> str:
    """The text with every character that could move, hide or reorder others on a screen written as an escape."""
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(character: str) -> str:
    if character.isprintable() or character in _JOINERS:
        return character
    if unicodedata.category(character) == "Zs":
        return " "
    return character.encode("unicode_escape").decode("ascii")
