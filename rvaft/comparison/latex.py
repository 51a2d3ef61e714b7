r"""Rows as LaTeX tables: floats for each semantics, one line per tree, a group of columns per language.

They are as wide as what they are made for, and never longer than a page: languages that do not fit side by side stand one below the other,
and trees that do not fit a page are in a table of their own. Floats can be used in one column and in two, which a `longtable` cannot.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from rvaft.comparison.latex_columns import COLUMNS, SEP, Group, breadth, groups
from rvaft.comparison.latex_names import Name, Tree, short_names
from rvaft.comparison.rows import Row
from rvaft.comparison.width import Width
from rvaft.latex import escaped
from rvaft.model import Gate
from rvaft.verdict import Semantics


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
    said = [f"{escaped(column.heading)}: {escaped(column.meaning)}" for column in COLUMNS if column in shown]
    if said:
        yield f"{'; '.join(said)}."
    yield from (line.name.note() for line in lines if line.name.whole is not None)
