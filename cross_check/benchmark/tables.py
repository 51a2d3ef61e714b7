r"""Rows as LaTeX tables: floats for each semantics, one line per tree, a group of columns per language.

They are as wide as what they are made for, and never longer than a page: languages that do not fit side by side stand one below the other,
and trees that do not fit a page are in a table of their own. Floats can be used in one column and in two, which a `longtable` cannot.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from itertools import count, groupby
from typing import Any, Final, NamedTuple, TypeAlias

from cross_check.benchmark.measurement import Outcome, Row
from rvaft.errors import LanguageError
from rvaft.export.latex import escaped
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import columns, visible

# Rows as CSV, and back: how a comparison is kept, and how one that was interrupted goes on.

COLUMNS: Final = tuple(field.name for field in fields(Row))
"""The columns, named as the fields of `Row`; what is not known is empty."""

_KINDS: Final[dict[Callable[[str], Any], tuple[str, ...]]] = {
    Gate: ("gate",),
    Semantics: ("semantics",),
    Outcome: ("result", "run"),
    int: (
        *("children", "threshold", "symbols", "subformulas", "states", "edges", "characters"),
        *("events", "first_events", "walks", "differing", "limit", "seed", "memory"),
    ),
    float: ("seconds", "read_seconds", "events_per_second", "again_per_second", "timeout"),
    str: ("tree", "language", "reason", "run_reason", "digest", "version"),
}
_READ: Final = {column: kind for kind, columns in _KINDS.items() for column in columns}
_REQUIRED: Final = frozenset({"tree", "semantics", "language", "result", "timeout", "seed"})
_HEADING: Final = ",".join(COLUMNS)
assert set(_READ) == set(COLUMNS), "every column is read back"


def csv_text(rows: Iterable[Row], *, heading: bool = True) -> str:
    """The rows, below the names of the columns."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    if heading:
        writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow([_written(getattr(row, column)) for column in COLUMNS])
    return stream.getvalue()


def read_rows(text: str, file: str = "<csv>") -> Iterator[Row]:
    """The rows of such a text; a last line that was only begun is left out, as an interrupted run leaves it.

    A column that the text does not have is empty. Raises `LanguageError` for what is no comparison.
    """
    whole = text[: text.rfind("\n") + 1]
    if not whole and _HEADING.startswith(text):
        return
    reader = csv.reader(io.StringIO(whole))
    try:
        heading = next(reader, [])
        if not _REQUIRED <= set(heading) <= set(COLUMNS) or len(heading) > len(set(heading)):
            raise LanguageError("no comparison of languages: its first line should name the columns", file=file)
        for cells in reader:
            yield _row(heading, cells, file, reader.line_num)
    except csv.Error as error:
        raise LanguageError(f"no CSV: {error}", file=file, line=reader.line_num) from error


def _written(value: object) -> str:
    match value:
        case None:
            return ""
        case float():
            return repr(value)
        case _:
            return str(value)


def _row(heading: Sequence[str], cells: Sequence[str], file: str, line: int) -> Row:
    if len(cells) != len(heading):
        raise LanguageError(f"{len(cells)} columns instead of {len(heading)}", file=file, line=line)
    found: dict[str, Any] = {"gate": None, "children": None, "threshold": None}
    for column, cell in zip(heading, cells, strict=True):
        if not cell and column in _REQUIRED:
            raise LanguageError(f"column {column} is empty", file=file, line=line)
        try:
            found[column] = _READ[column](cell) if cell or _READ[column] is str else None
        except ValueError:
            raise LanguageError(f"column {column}: {cell!r} is not what belongs there", file=file, line=line) from None
    return Row(**found)


# Rows as a table for people.

_HEADINGS: Final = ("TREE", "SEMANTICS", "LANGUAGE")
_OTHER: Final = "with other verdicts"
_NUMBERS: Final = ("SYMBOLS", "SUBFORMULAS", "STATES", "EDGES", "MS", "EVENTS/S", "AGAIN/S")


def text_lines(rows: Sequence[Row]) -> list[str]:
    """A line for each row: numbers to the right, how it ended last."""
    numbers = [_NUMBERS, *(_numbers(row) for row in rows)]
    widths = [max(len(cell) for cell in column) for column in zip(*numbers, strict=True)]
    aligned = [[cell.rjust(width) for cell, width in zip(line, widths, strict=True)] for line in numbers]
    named = [_HEADINGS, *((visible(row.tree), row.semantics, row.language) for row in rows)]
    said = ["RESULT", *(ended(row) for row in rows)]
    return columns([*name, *line, end] for name, line, end in zip(named, aligned, said, strict=True))


def ended(row: Row) -> str:
    """How a cell ended, in a few words."""
    if row.result is not Outcome.OK:
        return _because(row.result, row.reason)
    if row.run is not Outcome.OK:
        return f"run: {_because(row.run, row.run_reason)}"
    if row.differing:
        return f"{row.differing} of {row.walks} traces get other verdicts"
    return _because(row.result, row.run_reason)


def headline(rows: Sequence[Row]) -> str:
    """How many measurements ended how; a text that says something else than the tree is none that is ok."""
    counts = Counter(_word(row) for row in rows)
    words = [Outcome.OK, _OTHER, *(outcome for outcome in Outcome if outcome is not Outcome.OK)]
    said = ", ".join(f"{counts[word]} {word}" for word in words if counts[word])
    return f"{len(rows)} measurement{'' if len(rows) == 1 else 's'}: {said or 'none'}"


def _word(row: Row) -> str | None:
    if row.differing:
        return _OTHER
    return row.result if row.result is not Outcome.OK else row.run


def milliseconds(seconds: float) -> str:
    """A time with three significant digits."""
    return f"{1000 * seconds:.3g}" if seconds < 0.9995 else f"{1000 * seconds:.0f}"


def _numbers(row: Row) -> tuple[str, ...]:
    sizes = (row.symbols, row.subformulas, row.states, row.edges)
    time = "" if row.seconds is None else milliseconds(row.seconds)
    speeds = ("" if speed is None else f"{speed:.0f}" for speed in (row.events_per_second, row.again_per_second))
    return (*("" if size is None else str(size) for size in sizes), time, *speeds)


def _because(outcome: Outcome | None, reason: str) -> str:
    return f"{outcome}: {reason}" if reason else f"{outcome}"


# How wide a figure or a table is in a paper.


class Width(StrEnum):
    """A page of A4 with usual margins, or one of its two columns."""

    PAGE = "page"
    COLUMN = "column"


# What stands in the LaTeX tables: the numbers of a language, and what their headings mean.

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


LATEX_COLUMNS_COLUMNS: Final = (
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
        shown = tuple(column for column in LATEX_COLUMNS_COLUMNS if any(column.cell(row) for row in own))
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


# Names of trees in the first column of a LaTeX table: what is too long for it stands below the table, with a number.

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


@dataclass(frozen=True, slots=True)
class _Shape:
    """The environment, and in points how wide a table and the names of trees may be."""

    environment: str
    room: float
    names: float


_SHAPES: Final = {
    Width.PAGE: _Shape("table*", room=450, names=110),  # 16 cm
    Width.COLUMN: _Shape("table", room=238, names=60),  # 8.5 cm
}
_LINES: Final = 52
"""How many lines of nine points a page has room for, besides the caption and the meaning of the columns."""
_ABOVE: Final = 4
"""How many lines the heading and the rules of a block take."""
_HEAD: Final = r"""% \input this where a paragraph may stand, in one column or two. Needs \usepackage[T1]{fontenc} and \usepackage{booktabs,textcomp};
% other scripts than Latin need LuaLaTeX or XeLaTeX.
"""


@dataclass(frozen=True, slots=True)
class _Line:
    """A tree with its rows by language."""

    name: Name
    rows: Mapping[str, Row]

    @property
    def gate(self) -> Gate | None:
        return next(iter(self.rows.values())).gate


def latex_text(rows: Sequence[Row], width: Width = Width.PAGE) -> str:
    r"""The tables, to be read by `\input`; text of trees and languages keeps no special meaning."""
    semantics = dict.fromkeys(row.semantics for row in rows)
    shape = _SHAPES[width]
    tables = [table for choice in semantics for table in _tables(choice, rows, shape)]
    return "\n".join([_HEAD, *tables])


def _tables(semantics: Semantics, rows: Sequence[Row], shape: _Shape) -> Iterator[str]:
    by_tree: dict[Tree, dict[str, Row]] = {}
    for row in rows:
        if row.semantics is semantics:
            by_tree.setdefault((row.tree, row.digest), {})[row.language] = row
    names = short_names(by_tree, shape.names)
    lines = [_Line(names[tree], row_of) for tree, row_of in by_tree.items()]
    blocks = _blocks([row for line in lines for row in line.rows.values()], lines, shape)
    pages = list(_pages(lines, len(blocks), shape))
    for number, page in enumerate(pages, 1):
        part, label = (f" ({number} of {len(pages)})", f"-{number}") if len(pages) > 1 else ("", "")
        caption = f"Languages under the semantics {escaped(semantics)}{part}."
        yield "\n".join(
            [
                rf"\begin{{{shape.environment}}}[htbp]",
                rf"\centering\caption{{{caption}}}\label{{tab:languages-{semantics}{label}}}\par\smallskip",
                rf"\fontsize{{7}}{{8.5}}\selectfont\setlength{{\tabcolsep}}{{{SEP}pt}}",
                "\n\\par\\medskip\n".join(_tabular(block, page) for block in blocks),
                r"\par\smallskip\raggedright",
                *(rf"{note}\par" for note in _notes(blocks, page)),
                rf"\end{{{shape.environment}}}",
                "",
            ]
        )


def _blocks(rows: Sequence[Row], lines: Sequence[_Line], shape: _Shape) -> list[list[Group]]:
    """The languages that stand side by side: as few blocks as there is room for, all about as wide."""
    found = list(groups(rows))
    room = shape.room - max(breadth(line.name.shown) for line in lines)
    fewest = len(_packed(found, room))
    narrower = sorted(sum(group.width for group in found[a:b]) for b in range(len(found) + 1) for a in range(b))
    return next((blocks for width in narrower if len(blocks := _packed(found, width)) == fewest), [found])


def _packed(found: Sequence[Group], room: float) -> list[list[Group]]:
    blocks: list[list[Group]] = []
    for group in found:
        if blocks and sum(one.width for one in blocks[-1]) + group.width <= room:
            blocks[-1].append(group)
        else:
            blocks.append([group])
    return blocks


def _pages(lines: Sequence[_Line], blocks: int, shape: _Shape) -> Iterator[list[_Line]]:
    """As many trees as a page has room for; those of a gate stay together where they can."""
    room = _LINES - _ABOVE * blocks
    page: list[_Line] = []
    for _, same in groupby(lines, key=lambda line: line.gate):
        gate = list(same)
        if page and _height([*page, *gate], blocks, shape) > room >= _height(gate, blocks, shape):
            yield page
            page = []
        for line in gate:
            if page and _height([*page, line], blocks, shape) > room:
                yield page
                page = []
            page.append(line)
    if page:
        yield page


def _height(lines: Sequence[_Line], blocks: int, shape: _Shape) -> float:
    gates = sum(1 for _ in groupby(line.gate for line in lines))
    return blocks * (len(lines) + 0.5 * gates) + sum(line.name.lines(shape.room) for line in lines)


def _tabular(block: Sequence[Group], lines: Sequence[_Line]) -> str:
    layout = "".join("r" * len(group.columns) for group in block)
    body = [rf"\begin{{tabular}}{{@{{}}l{layout}@{{}}}}", r"\toprule", *_heading(block), r"\midrule"]
    for number, line in enumerate(lines):
        if number and line.gate is not lines[number - 1].gate:
            body.append(r"\addlinespace")
        cells = [_cells(group, line.rows.get(group.language)) for group in block]
        body.append(f"{_first(line.name.shown)} & {' & '.join(cells)} \\\\")
    return "\n".join([*body, r"\bottomrule", r"\end{tabular}"])


def _heading(block: Sequence[Group]) -> Iterator[str]:
    titles, rules, start = [], [], 2
    for group in block:
        titles.append(rf"\multicolumn{{{len(group.columns)}}}{{c}}{{{escaped(group.language)}}}")
        rules.append(rf"\cmidrule(lr){{{start}-{start + len(group.columns) - 1}}}")
        start += len(group.columns)
    words = [escaped(column.heading) for group in block for column in group.columns]
    yield f"& {' & '.join(titles)} \\\\"
    yield "".join(rules)
    yield f"tree & {' & '.join(words)} \\\\"


def _first(name: str) -> str:
    """A name that is no argument of the end of the line before."""
    text = escaped(name)
    return f"{{{text}}}" if text.startswith(("*", "[")) else text


def _cells(group: Group, row: Row | None) -> str:
    cells = [escaped(cell) for cell in group.cells(row)]
    if len(cells) == len(group.columns):
        return " & ".join(cells)
    return rf"\multicolumn{{{len(group.columns)}}}{{c}}{{\emph{{{cells[0]}}}}}"


def _notes(blocks: Sequence[Sequence[Group]], lines: Sequence[_Line]) -> Iterator[str]:
    """What the headings mean, and the whole of names that are shortened."""
    shown = {column for block in blocks for group in block for column in group.columns}
    said = [
        f"{escaped(column.heading)}: {escaped(column.meaning)}" for column in LATEX_COLUMNS_COLUMNS if column in shown
    ]
    if said:
        yield f"{'; '.join(said)}."
    yield from (line.name.note() for line in lines if line.name.whole is not None)
