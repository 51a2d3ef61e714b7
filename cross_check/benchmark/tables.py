"""Measurements as a CSV file and back, as a table for people, and as LaTeX tables."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import msgspec

from cross_check.benchmark.measurement import Measurement, Outcome
from rvaft.errors import LanguageError, ToolMissing
from rvaft.export.latex import escaped
from rvaft.support.files import deliver, write_whole
from rvaft.support.terminal import columns, visible

COLUMNS: Final = Measurement.__struct_fields__
"""The columns of the CSV file; what is not known is empty."""
_REQUIRED: Final = frozenset({"tree", "semantics", "language", "result", "timeout", "seed"})


def csv_text(rows: Iterable[Measurement], *, heading: bool = True) -> str:
    """The measurements, below the names of the columns."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([COLUMNS] if heading else [])
    writer.writerows([getattr(row, column) for column in COLUMNS] for row in rows)
    return stream.getvalue()


def read_rows(text: str, file: str = "<csv>") -> Iterator[Measurement]:
    """The measurements of such a text; a last line that was only begun is left out, as an interrupted run leaves it.

    A column that the text does not have is empty. Raises `LanguageError` for what is no comparison.
    """
    whole = text[: text.rfind("\n") + 1]
    if not whole and ",".join(COLUMNS).startswith(text):
        return
    reader = csv.DictReader(io.StringIO(whole))
    heading = reader.fieldnames or ()
    if not _REQUIRED <= set(heading) <= set(COLUMNS) or len(heading) > len(set(heading)):
        raise LanguageError("no comparison of languages: its first line should name the columns", file=file)
    empty = {"gate": None, "children": None, "threshold": None}
    for cells in reader:
        if None in cells or None in cells.values():
            raise LanguageError(f"not {len(heading)} columns", file=file, line=reader.line_num)
        known = {column: cell for column, cell in cells.items() if cell}
        try:
            yield msgspec.convert({**empty, **known}, Measurement, strict=False)
        except msgspec.ValidationError as error:
            raise LanguageError(str(error), file=file, line=reader.line_num) from error


class KeptMeasurements:
    """The CSV file of a comparison: every measurement is in it as soon as it is known, so that an interrupted run can go on.

    With `resume` it keeps what the file has from before. What is no regular file is only written to at the end; None is no file.
    Raises `OSError`, and `LanguageError` for a file with something else than a comparison in it, which nobody wants to lose.
    """

    def __init__(self, file: str | None, *, resume: bool = False) -> None:
        self._file = file
        path = None if file in (None, "-") else Path(file or "")
        self._path = path if path is not None and (path.is_file() or not path.exists()) else None
        self._before: dict[tuple[object, ...], Measurement] = {}
        if self._path is not None:
            text = self._path.read_text("utf-8", "surrogateescape") if self._path.exists() else ""
            found = {row.key: row for row in read_rows(text, str(self._path))}
            self._before = found if resume else {}
            write_whole(self._path, _encoded(self._before.values()))  # without a last line that was only begun

    def known(self, wanted: Measurement) -> Measurement | None:
        """The measurement from before that answers for one."""
        found = self._before.get(wanted.key)
        return found if found is not None and found.serves(wanted) else None

    def add(self, row: Measurement) -> None:
        """Keep a measurement, whatever happens next."""
        if self._path is not None:
            with self._path.open("ab") as stream:
                stream.write(_encoded([row], heading=False))

    def finish(self, rows: Sequence[Measurement]) -> None:
        """Write these measurements in this order, and behind them those from before that no other stands for."""
        if self._path is not None:
            fresh = {row.key for row in rows}
            write_whole(self._path, _encoded([*rows, *(row for key, row in self._before.items() if key not in fresh)]))
        elif self._file is not None:
            deliver(_encoded(rows), self._file)


def _encoded(rows: Iterable[Measurement], *, heading: bool = True) -> bytes:
    return csv_text(rows, heading=heading).encode(errors="surrogateescape")  # names of files need not be UTF-8


# -- for people ---------------------------------------------------------------------------------------------------------

_HEADING: Final = (
    "TREE",
    "SEMANTICS",
    "LANGUAGE",
    "SYMBOLS",
    "SUBFORMULAS",
    "STATES",
    "EDGES",
    "MS",
    "EVENTS/S",
    "AGAIN/S",
)
_OTHER: Final = "with other verdicts"


def text_lines(rows: Sequence[Measurement]) -> list[str]:
    """A line for each measurement: numbers to the right, how it ended last."""
    lines: list[tuple[str, ...]] = [_HEADING]
    for row in rows:
        sizes = ("" if size is None else str(size) for size in (row.symbols, row.subformulas, row.states, row.edges))
        time = "" if row.seconds is None else milliseconds(row.seconds)
        speeds = ("" if speed is None else f"{speed:.0f}" for speed in (row.events_per_second, row.again_per_second))
        lines.append((visible(row.tree), row.semantics, row.language, *sizes, time, *speeds))
    widths = [0, 0, 0, *(max(map(len, column)) for column in list(zip(*lines, strict=True))[3:])]
    aligned = ([cell.rjust(width) for cell, width in zip(line, widths, strict=True)] for line in lines)
    return columns([*line, end] for line, end in zip(aligned, ["RESULT", *map(_ended, rows)], strict=True))


def milliseconds(seconds: float) -> str:
    """A time with three significant digits.

    >>> milliseconds(0.0012345)
    '1.23'
    """
    return f"{1000 * seconds:.3g}" if seconds < 0.9995 else f"{1000 * seconds:.0f}"


def _ended(row: Measurement) -> str:
    """How a cell ended, in a few words."""
    if row.result is not Outcome.OK:
        return f"{row.result}: {row.reason}" if row.reason else f"{row.result}"
    reason = f": {row.run_reason}" if row.run_reason else ""
    if row.run is not Outcome.OK:
        return f"run: {row.run}{reason}"
    return f"{row.differing} of {row.walks} traces get other verdicts" if row.differing else f"{row.run}{reason}"


def headline(rows: Sequence[Measurement]) -> str:
    """How many measurements ended how; a text that says something else than the tree is none that is ok."""
    counts = Counter(_OTHER if row.differing else row.ended for row in rows)
    words = [Outcome.OK, _OTHER, *(outcome for outcome in Outcome if outcome is not Outcome.OK)]
    said = ", ".join(f"{counts[word]} {word}" for word in words if counts[word])
    return f"{len(rows)} measurement{'' if len(rows) == 1 else 's'}: {said or 'none'}"


# -- for papers ---------------------------------------------------------------------------------------------------------


class Width(StrEnum):
    """How wide a figure or a table is in a paper: a page of A4 with usual margins, or one of its two columns."""

    PAGE = "page"
    COLUMN = "column"


_DAGGER: Final = r"\textdagger{}"
"""What stands before the symbols of a text that says something else than the tree."""
_MEANINGS: Final = {
    "symb.": "symbols of the property",
    "subf.": "distinct subformulas",
    "states": "states, in RML equations",
    "edges": "edges of the automaton",
    "ms": "milliseconds to translate",
    "kev/s": "thousands of events per second, by readers that have met nothing before",
    _DAGGER: "traces in which a text gives other verdicts than the tree",
}
_BROAD: Final = {Width.PAGE: 18, Width.COLUMN: 6}
"""Columns of numbers in one table."""
_LONG: Final = 48
"""Trees in one table, so that it fits a page."""
_NAME: Final = 24
"""Letters of the name of a tree; of a path the end tells trees apart."""


def pandas() -> Any:
    """The library pandas; raises `ToolMissing`."""
    try:
        import jinja2  # noqa: F401, PLC0415 (an extra, which pandas needs for LaTeX)
        import pandas  # noqa: PLC0415 (an extra)
    except ImportError:
        raise ToolMissing("pandas", remedy="pip install '.[papers]' in a checkout, or leave --latex out") from None
    return pandas


def latex_text(rows: Sequence[Measurement], width: Width = Width.PAGE) -> str:
    r"""Floats to be read by `\input`, for each semantics: a row for each tree, a group of columns for each language.

    Languages that do not fit side by side and trees that do not fit a page stand in further tables. Raises `ToolMissing`.
    """
    data = pandas()
    tables = ["% Needs \\usepackage[T1]{fontenc} and \\usepackage{booktabs,multirow,textcomp}.\n"]
    for semantics in dict.fromkeys(row.semantics for row in rows):
        chosen = [row for row in rows if row.semantics is semantics]
        trees = {(row.tree, row.digest): escaped(_shortened(visible(row.tree))) for row in chosen}
        groups: list[dict[str, Any]] = [{}]  # the languages that stand side by side
        for language in dict.fromkeys(row.language for row in chosen):
            own = {(row.tree, row.digest): _latex_cells(row) for row in chosen if row.language == language}
            frame = data.DataFrame([dict.fromkeys(_MEANINGS, "") | own.get(tree, {}) for tree in trees])
            frame = frame.loc[:, (frame != "").any()]
            if groups[-1] and sum(one.shape[1] for one in groups[-1].values()) + frame.shape[1] > _BROAD[width]:
                groups.append({})
            groups[-1][escaped(language)] = frame
        for number, group in enumerate(groups, 1):
            table = data.concat(group, axis=1)
            table.index = list(trees.values())
            shown = {heading for _, heading in table.columns}
            meanings = "; ".join(f"{heading} {text}" for heading, text in _MEANINGS.items() if heading in shown)
            for start in range(0, len(table), _LONG):
                written = table.iloc[start : start + _LONG].style.to_latex(
                    environment="table*" if width is Width.PAGE else "table",
                    position="htbp",
                    position_float="centering",
                    hrules=True,
                    column_format="l" + "r" * table.shape[1],
                    multicol_align="c",
                    caption=f"Languages under the semantics {semantics}: {meanings}.",
                    label=f"tab:languages-{semantics}-{number}-{start // _LONG + 1}",
                )
                small = "\\scriptsize\\setlength{\\tabcolsep}{2.2pt}\n\\begin{tabular}"
                tables.append(written.replace(r"\begin{tabular}", small))
    return "\n".join(tables)


def _latex_cells(row: Measurement) -> dict[str, str]:
    if row.result is not Outcome.OK:
        return {"symb.": str(row.result)}
    speed = str(row.run) if row.events_per_second is None else _two_digits(row.events_per_second / 1000)
    return {
        "symb.": f"{_DAGGER if row.differing else ''}{row.symbols}",
        "subf.": "" if row.subformulas is None else str(row.subformulas),
        "states": "" if row.states is None else str(row.states),
        "edges": "" if row.edges is None else str(row.edges),
        "ms": "" if row.seconds is None else _two_digits(1000 * row.seconds),
        "kev/s": "" if row.run is Outcome.OK and row.events_per_second is None else speed,
        _DAGGER: f"{row.differing}/{row.walks}" if row.differing else "",
    }


def _two_digits(number: float) -> str:
    """Times have no more significant digits."""
    return f"{float(f'{number:.2g}'):.12g}"


def _shortened(name: str) -> str:
    return name if len(name) <= _NAME else f"…{name[1 - _NAME :]}"
