"""Measurements as CSV (written and read), as a text table, and as LaTeX tables."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import partial
from typing import Any, Final

import msgspec
from msgspec.structs import astuple

from cross_check.results import DETECTIONS_ONLY
from papers.languages.measurement import SIZES, Measurement, Outcome
from rvaft.errors import LanguageError, installed
from rvaft.export.latex import escaped
from rvaft.support.terminal import FORMULAS, columns, spreadsheet_cell, visible

COLUMNS: Final = Measurement.__struct_fields__
"""The columns of the CSV file; unknown values are empty."""
_REQUIRED: Final = frozenset({"tree", "semantics", "language", "result", "timeout", "seed"})


def csv_text(rows: Iterable[Measurement], *, heading: bool = True) -> str:
    """Return the measurements as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([COLUMNS] if heading else [])
    for row in rows:
        writer.writerow([spreadsheet_cell(one) if isinstance(one, str) else one for one in astuple(row)])
    return stream.getvalue()


def _without_quote(cell: str) -> str:
    """Return the text of a cell that `spreadsheet_cell` made."""
    return cell[1:] if cell.startswith("'") and cell.lstrip("'").startswith(FORMULAS) else cell


def read_rows(text: str, file: str = "<csv>") -> Iterator[Measurement]:
    """Yield the measurements of a CSV text without an incomplete last line, as an interrupt leaves
    it.

    Missing columns are empty. Raises `LanguageError` for other texts.
    """
    whole = text[: text.rfind("\n") + 1]
    if not whole and ",".join(COLUMNS).startswith(text):
        return
    reader = csv.DictReader(io.StringIO(whole))
    heading = reader.fieldnames or ()
    if not _REQUIRED <= set(heading) <= set(COLUMNS) or len(heading) > len(set(heading)):
        raise LanguageError("not a comparison of languages: the first line must name the columns", file=file)
    empty = {"gate": None, "children": None, "threshold": None}
    for cells in reader:
        if None in cells or None in cells.values():
            raise LanguageError(f"not {len(heading)} columns", file=file, line=reader.line_num)
        known = {column: _without_quote(cell) for column, cell in cells.items() if cell}
        try:
            yield msgspec.convert({**empty, **known}, Measurement, strict=False)
        except msgspec.ValidationError as error:
            raise LanguageError(str(error), file=file, line=reader.line_num) from error


_OTHER: Final = "with other verdicts"


def text_lines(rows: Sequence[Measurement]) -> list[str]:
    """Return a line per measurement: numbers right-aligned, the outcome last."""
    lines = [("TREE", "SEMANTICS", "LANGUAGE", *map(str.upper, SIZES), "MS", "READ", "EVENTS/S", "AGAIN/S")]
    for row in rows:
        sizes = ("" if size is None else str(size) for size in map(partial(getattr, row), SIZES))
        times = ("" if time is None else milliseconds(time) for time in (row.seconds, row.read_seconds))
        speeds = ("" if speed is None else f"{speed:.0f}" for speed in (row.events_per_second, row.again_per_second))
        lines.append((visible(row.tree), row.semantics, row.language, *sizes, *times, *speeds))
    widths = [0, 0, 0, *(max(map(len, column)) for column in list(zip(*lines, strict=True))[3:])]
    aligned = ([cell.rjust(width) for cell, width in zip(line, widths, strict=True)] for line in lines)
    return columns([*line, end] for line, end in zip(aligned, ["RESULT", *map(_ended, rows)], strict=True))


def milliseconds(seconds: float) -> str:
    """Return a time with three significant digits.

    >>> milliseconds(0.0012345)
    '1.23'
    """
    return f"{1000 * seconds:.3g}" if seconds < 0.9995 else f"{1000 * seconds:.0f}"


def _ended(row: Measurement) -> str:
    if row.result is not Outcome.OK:
        return f"{row.result}: {row.reason}" if row.reason else f"{row.result}"
    reason = f": {row.run_reason}" if row.run_reason else ""
    if row.run is not Outcome.OK:
        return f"run: {row.run}{reason}"
    return f"{row.differing} of {row.walks} traces get other verdicts" if row.differing else f"{row.run}{reason}"


def headline(rows: Sequence[Measurement]) -> str:
    """Return the number of measurements per outcome; texts with other verdicts are not `ok`."""
    counts = Counter(_OTHER if row.differing else row.ended for row in rows)
    words = [Outcome.OK, _OTHER, *(outcome for outcome in Outcome if outcome is not Outcome.OK)]
    counted = ", ".join(f"{counts[word]} {word}" for word in words if counts[word])
    return f"{len(rows)} measurement{'' if len(rows) == 1 else 's'}: {counted or 'none'}"


class Width(StrEnum):
    """The width of a figure or table: an A4 page with usual margins, or one of its two columns."""

    PAGE = "page"
    COLUMN = "column"


_DAGGER: Final = r"\textdagger{}"
"""The mark before the symbols of a text with other verdicts."""
_MEANINGS: Final = {
    "symb.": "symbols of the property",
    "subf.": "subformulas",
    "states": "states, in RML equations",
    "edges": "edges of the automaton",
    "ms": "milliseconds to translate",
    "read": "milliseconds to read",
    "kev/s": "thousands of events per second, by readers that have met nothing before",
    _DAGGER: "traces in which a text gives other verdicts than the tree",
}
_BROAD: Final = {Width.PAGE: 18, Width.COLUMN: 6}
"""Columns of numbers in one table."""
_LONG: Final = 48  # trees in one table, to fit a page
_NAME: Final = 24  # letters of a tree name; the end of a path is kept


def pandas() -> Any:
    """Return pandas; raises `ToolMissing`."""
    remedy = "pip install '.[papers]' in a checkout, or leave --latex out"
    installed("jinja2", "pandas", remedy)  # pandas needs it for LaTeX
    return installed("pandas", "pandas", remedy)


def latex_text(rows: Sequence[Measurement], width: Width = Width.PAGE) -> str:
    r"""Return tables for `\input`, per semantics: a row per tree, a group of columns per language.

    Further languages and trees go to further tables. Raises `ToolMissing`.
    """
    data = pandas()
    tables = ["% Needs \\usepackage[T1]{fontenc} and \\usepackage{booktabs,multirow,textcomp}.\n"]
    for semantics in dict.fromkeys(row.semantics for row in rows):
        chosen = [row for row in rows if row.semantics is semantics]
        trees = {(row.tree, row.digest): escaped(_shortened(visible(row.tree))) for row in chosen}
        languages = {
            name: [row for row in chosen if row.language == name]
            for name in dict.fromkeys(row.language for row in chosen)
        }
        mute = unable(chosen)
        groups: list[dict[str, Any]] = [{}]  # the languages side by side
        for language, its in languages.items():
            if language in mute and len(mute) < len(languages):
                continue
            own = {(row.tree, row.digest): _latex_cells(row) for row in its}
            frame = data.DataFrame([own.get(tree, {}) for tree in trees], trees.values(), _MEANINGS).dropna(
                axis=1, how="all"
            )
            if groups[-1] and sum(one.shape[1] for one in groups[-1].values()) + frame.shape[1] > _BROAD[width]:
                groups.append({})
            groups[-1][escaped(language)] = frame
        for number, group in enumerate(groups, 1):
            table = data.concat(group, axis=1).fillna("")
            shown = {heading for _, heading in table.columns}
            meanings = "; ".join(f"{heading} {text}" for heading, text in _MEANINGS.items() if heading in shown)
            remarks = "".join(f" {escaped(one)}." for one in _remarks(chosen, [*group], mute))
            for start in range(0, len(table), _LONG):
                written = table.iloc[start : start + _LONG].style.to_latex(
                    environment="table*" if width is Width.PAGE else "table",
                    position="htbp",
                    position_float="centering",
                    hrules=True,
                    column_format="l" + "r" * table.shape[1],
                    multicol_align="c",
                    caption=f"Languages under the semantics {semantics}: {meanings}.{remarks}",
                    label=f"tab:languages-{semantics}-{number}-{start // _LONG + 1}",
                )
                small = "\\scriptsize\\setlength{\\tabcolsep}{2.2pt}\n\\begin{tabular}"
                tables.append(written.replace(r"\begin{tabular}", small))
    return "\n".join(tables)


def unable(rows: Iterable[Measurement]) -> dict[str, str]:
    """Return the languages that can express none of these trees, each with a reason."""
    able = {row.language for row in rows if row.result is not Outcome.NOT_EXPRESSIBLE}
    return {row.language: row.reason for row in rows if row.language not in able}


def _remarks(rows: Sequence[Measurement], shown: Sequence[str], mute: Mapping[str, str]) -> Iterator[str]:
    """Yield remarks on the languages in a table, and on excluded ones."""
    some = {
        DETECTIONS_ONLY: [row.language for row in rows if row.detections_only],
        "only emitted": [row.language for row in rows if row.only_emitted],
    }
    for remark, languages in some.items():
        if names := [name for name in dict.fromkeys(languages) if escaped(name) in shown]:
            yield f"{remark.capitalize()}: {', '.join(names)}"
    for reason in dict.fromkeys(mute.values()):
        yield f"Not expressible in {', '.join(name for name, why in mute.items() if why == reason)}: {reason}"


def _latex_cells(row: Measurement) -> dict[str, str]:
    if row.result is not Outcome.OK:
        return {"symb.": str(row.result)}
    known = {"subf.": row.subformulas, "states": row.states, "edges": row.edges}
    cells = {"symb.": f"{_DAGGER if row.differing else ''}{row.symbols}"}
    cells |= {heading: str(size) for heading, size in known.items() if size is not None}
    if row.seconds is not None:
        cells["ms"] = _two_digits(1000 * row.seconds)
    if row.read_seconds is not None:
        cells["read"] = _two_digits(1000 * row.read_seconds)
    if row.events_per_second is not None:
        cells["kev/s"] = _two_digits(row.events_per_second / 1000)
    elif row.run is not Outcome.OK:
        cells["kev/s"] = str(row.run)
    return cells | ({_DAGGER: f"{row.differing}/{row.walks}"} if row.differing else {})


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.2g}'):.12g}"


def _shortened(name: str) -> str:
    return name if len(name) <= _NAME else f"…{name[1 - _NAME :]}"
