"""Names of trees in the first column of a LaTeX table: what is too long for it stands below the table, with a number."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Final, TypeAlias

from rvaft.comparison.latex_columns import breadth
from rvaft.latex import escaped
from rvaft.printable import visible

_PIECE: Final = re.compile(r"[^\W_]{1,20}[\W_]{0,20}|[\W_]{1,20}")
"""Where a line may end: behind what is no letter, or digit, and at last within a long word."""


Tree: TypeAlias = tuple[str, str]
"""A name and a digest: two trees may have one name."""


@dataclass(frozen=True, slots=True)
class Name:
    """What stands in the table, and the whole name where that is a part of it."""

    shown: str
    whole: str | None = None

    def lines(self, room: float) -> int:
        """How many lines of so many points the note takes."""
        return 0 if self.whole is None else 1 + int(1.1 * breadth(self.whole) / room)

    def note(self) -> str:
        """The note in LaTeX; empty where none is needed."""
        if self.whole is None:
            return ""
        number, _, _ = self.shown.partition(" ")
        whole = r"\allowbreak{}".join(escaped(piece) for piece in _PIECE.findall(self.whole))
        return rf"{number}\ {whole}"


def short_names(trees: Iterable[Tree], room: float) -> Mapping[Tree, Name]:
    """Each name, its end and a number if it takes more than so many points: of a path the end is what tells trees apart."""
    number = count(1)
    return {tree: _short(visible(tree[0]), room, number) for tree in trees}


def _short(text: str, room: float, number: Iterator[int]) -> Name:
    if breadth(text) <= room:
        return Name(text)
    start = f"({next(number)}) …"
    ends = [end for place in range(1, len(text)) if breadth(start + (end := text[place:])) <= room]
    end = next((end for end in ends if end.startswith("/")), ends[0] if ends else "")
    return Name(start + end, text)
