"""Text that comes from a file or an event, made safe to show: on one line and without control codes."""

import io
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Final

_JOINERS: Final = "\u200c\u200d"
"""Invisible, but parts of words in several scripts."""
_WIDEST: Final = 1_000_000
"""Columns of a terminal that is never too narrow."""


def visible(text: str) -> str:
    """The text with every character that could move, hide or reorder others on a screen written as an escape."""
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(character: str) -> str:
    if character.isprintable() or character in _JOINERS:
        return character
    if unicodedata.category(character) == "Zs":
        return " "
    return character.encode("unicode_escape").decode("ascii")


def columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows of cells as lines with aligned columns, two spaces between them; nothing is ever cut or wrapped."""
    from rich.console import Console  # noqa: PLC0415 -- imported on use
    from rich.table import Table  # noqa: PLC0415 -- imported on use
    from rich.text import Text  # noqa: PLC0415 -- imported on use

    table = Table.grid(padding=(0, 2))
    for row in rows:
        table.add_row(*(Text(visible(cell), no_wrap=True) for cell in row))
    console = Console(file=io.StringIO(), width=_WIDEST, color_system=None, legacy_windows=False, force_jupyter=False)
    with console.capture() as captured:
        console.print(table)
    return [line.rstrip() for line in captured.get().splitlines()]
