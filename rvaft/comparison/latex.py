"""Rows as LaTeX tables: a `longtable` for each semantics, one row per tree, a group of columns per language."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from rvaft.comparison.rows import Outcome, Row
from rvaft.comparison.text import milliseconds
from rvaft.drawing.tikz import escaped
from rvaft.verdict import Semantics


class Column(NamedTuple):
    """One number of a language."""

    heading: str
    cell: Callable[[Row], str]


def _count(number: int | None) -> str:
    return "" if number is None else str(number)


def _speed(row: Row) -> str:
    if row.events_per_second is None:
        return "" if row.run in (Outcome.OK, None) else escaped(str(row.run))
    return (
        f"{row.events_per_second / 1000:.3g}"
        if row.events_per_second < 999_500
        else f"{row.events_per_second / 1000:.0f}"
    )


_COLUMNS: Final = (
    Column("symb.", lambda row: _count(row.symbols)),
    Column("subf.", lambda row: _count(row.subformulas)),
    Column("states", lambda row: _count(row.states)),
    Column("edges", lambda row: _count(row.edges)),
    Column("ms", lambda row: "" if row.seconds is None else milliseconds(row.seconds)),
    Column("kev/s", _speed),
)

_HEAD: Final = r"""% Needs \usepackage[T1]{fontenc} and \usepackage{booktabs,longtable,textcomp}; other scripts than Latin need LuaLaTeX or XeLaTeX.
% symb.: tokens of the property; subf.: distinct subformulas; ms: milliseconds to translate;
% kev/s: thousands of events per second, all met for the first time, by the language's own reader.
\begingroup\scriptsize\setlength{\tabcolsep}{2.5pt}
"""
_TAIL: Final = r"""\endgroup
"""


def latex_text(rows: Sequence[Row]) -> str:
    r"""The tables, to be read by `\input`; text of trees and languages keeps no special meaning."""
    semantics = dict.fromkeys(row.semantics for row in rows)
    tables = [_table(choice, [row for row in rows if row.semantics is choice]) for choice in semantics]
    return _HEAD + "\n".join(tables) + _TAIL


def _table(semantics: Semantics, rows: Sequence[Row]) -> str:
    shown = {
        language: [column for column in _COLUMNS if any(column.cell(row) for row in rows if row.language == language)]
        for language in dict.fromkeys(row.language for row in rows)
    }
    for language, columns in shown.items():
        shown[language] = columns or [Column("", lambda _row: "")]
    by_tree: dict[str, dict[str, Row]] = {}
    for row in rows:
        by_tree.setdefault(row.tree, {})[row.language] = row
    heading = _heading(shown)
    lines = [
        rf"\begin{{longtable}}{{@{{}}l{_layout(shown)}@{{}}}}",
        rf"\caption{{Languages under the semantics {escaped(semantics)}.}}\\",
        *(r"\toprule", *heading, r"\midrule", r"\endfirsthead"),
        *(r"\toprule", *heading, r"\midrule", r"\endhead"),
        *(r"\bottomrule", r"\endfoot"),
        *_body(by_tree, shown),
        r"\end{longtable}",
    ]
    return "\n".join(lines) + "\n"


def _layout(shown: Mapping[str, Sequence[Column]]) -> str:
    return "".join("r" * len(columns) for columns in shown.values())


def _heading(shown: Mapping[str, Sequence[Column]]) -> list[str]:
    groups, rules, start = [], [], 2
    for language, columns in shown.items():
        groups.append(rf"\multicolumn{{{len(columns)}}}{{c}}{{{escaped(language)}}}")
        rules.append(rf"\cmidrule(lr){{{start}-{start + len(columns) - 1}}}")
        start += len(columns)
    words = [escaped(column.heading) for columns in shown.values() for column in columns]
    return [f"& {' & '.join(groups)} \\\\", "".join(rules), f"tree & {' & '.join(words)} \\\\"]


def _body(by_tree: Mapping[str, Mapping[str, Row]], shown: Mapping[str, Sequence[Column]]) -> Iterable[str]:
    gate = None
    for number, (tree, row_of) in enumerate(by_tree.items()):
        first = next(iter(row_of.values())).gate
        if number and first is not gate:
            yield r"\addlinespace"
        gate = first
        cells = [_cells(row_of.get(language), columns) for language, columns in shown.items()]
        name = escaped(tree)
        name = f"{{{name}}}" if name.startswith("*") else name  # no argument of the end of the line before
        yield f"{name} & {' & '.join(cells)} \\\\"


def _cells(row: Row | None, columns: Sequence[Column]) -> str:
    """The numbers of a language, or one word for why there are none."""
    if row is not None and row.result is Outcome.OK:
        return " & ".join(column.cell(row) for column in columns)
    word = "" if row is None else escaped(str(row.result))
    return rf"\multicolumn{{{len(columns)}}}{{c}}{{\emph{{{word}}}}}"
