"""What stands in the LaTeX tables: the numbers of a language, and what their headings mean."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from rvaft.comparison.rows import Outcome, Row

SEP: Final = 2.2
"""Points between a number and the edge of its column."""
_NARROW: Final = 3.1
_LETTER: Final = 4.0
_BROAD: Final = 6.6
MARK: Final = "†"
"""What stands before the numbers of a text that says something else than the tree."""


class Column(NamedTuple):
    """One number of a language; `meaning` explains the heading to the reader of the table."""

    heading: str
    meaning: str
    cell: Callable[[Row], str]


def _count(number: int | None) -> str:
    return "" if number is None else str(number)


def _rounded(number: float) -> str:
    """Two significant digits: times have no more."""
    return f"{float(f'{number:.2g}'):.12g}"


def _speed(row: Row) -> str:
    if row.events_per_second is None:
        return "" if row.run in (Outcome.OK, None) else str(row.run)
    return _rounded(row.events_per_second / 1000)


COLUMNS: Final = (
    Column("symb.", "symbols of the property", lambda row: f"{MARK if row.differing else ''}{_count(row.symbols)}"),
    Column("subf.", "distinct subformulas", lambda row: _count(row.subformulas)),
    Column("states", "states, in RML equations", lambda row: _count(row.states)),
    Column("edges", "edges of the automaton", lambda row: _count(row.edges)),
    Column("ms", "milliseconds to translate", lambda row: "" if row.seconds is None else _rounded(1000 * row.seconds)),
    Column("kev/s", "thousands of events per second, by readers that have met nothing before", _speed),
    Column(
        MARK,
        "a text that does not say what the tree says, and in how many of the traces its verdicts are other ones",
        lambda row: f"{row.differing}/{row.walks}" if row.differing else "",
    ),
)
"""All there are, in their order."""


@dataclass(frozen=True, slots=True)
class Group:
    """The columns of a language; those that are empty in every row are left out, but for one that has room for a word."""

    language: str
    columns: tuple[Column, ...]
    width: float
    """In points, at letters of seven points, spaces at both sides included."""

    def cells(self, row: Row | None) -> tuple[str, ...]:
        """The numbers of a row, or a single word for why there are none."""
        if row is None or row.result is not Outcome.OK:
            return ("" if row is None else str(row.result),)
        return tuple(column.cell(row) for column in self.columns)


def groups(rows: Sequence[Row]) -> Iterator[Group]:
    """The columns of each language."""
    for language in dict.fromkeys(row.language for row in rows):
        own = [row for row in rows if row.language == language]
        shown = tuple(column for column in COLUMNS if any(column.cell(row) for row in own))
        wide = sum(
            max(breadth(text) for text in (column.heading, *(column.cell(row) for row in own))) + 2 * SEP
            for column in shown
        )
        words = [language, *(str(row.result) for row in own if row.result is not Outcome.OK)]
        needed = max(breadth(word) + 2 * SEP for word in words)
        yield Group(language, shown or (Column("", "", lambda _row: ""),), max(wide, needed))


def breadth(text: str) -> float:
    """About how many points a text takes at letters of seven points; rather too many than too few."""
    return sum(map(_breadth, text))


def _breadth(letter: str) -> float:
    if letter in "mwMW@%" or letter.isupper() or letter > "ÿ":
        return _BROAD
    return _NARROW if letter in "fijlrst.,:;'!|()[] " else _LETTER
