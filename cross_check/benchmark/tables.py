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
from rvaft.model.verdict import Semantics
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
        self._before: list[Measurement] = []
        if self._path is not None:
            text = self._path.read_text("utf-8", "surrogateescape") if self._path.exists() else ""
            found = list(read_rows(text, str(self._path)))
            self._before = found if resume else []
            write_whole(self._path, _encoded(self._before))  # without a last line that was only begun
        self._by_key = {row.key: row for row in self._before}

    def known(self, wanted: Measurement) -> Measurement | None:
        """The measurement from before that answers for one."""
        found = self._by_key.get(wanted.key)
        return found if found is not None and found.serves(wanted) else None

    def add(self, row: Measurement) -> None:
        """Keep a measurement, whatever happens next."""
        if self._path is not None:
            with self._path.open("a", encoding="utf-8", errors="surrogateescape", newline="") as stream:
                stream.write(csv_text([row], heading=False))

    def finish(self, rows: Sequence[Measurement]) -> None:
        """Write these measurements in this order, and behind them those from before that no other stands for."""
        fresh = {row.key for row in rows}
        if self._path is not None:
            write_whole(self._path, _encoded([*rows, *(row for row in self._before if row.key not in fresh)]))
        elif self._file is not None:
            deliver(_encoded(rows), self._file)


def _encoded(rows: Iterable[Measurement]) -> bytes:
    return csv_text(rows).encode(errors="surrogateescape")  # names of files need not be UTF-8


# -- for people ---------------------------------------------------------------------------------------------------------

_NUMBERS: Final = ("SYMBOLS", "SUBFORMULAS", "STATES", "EDGES", "MS", "EVENTS/S", "AGAIN/S")
_OTHER: Final = "with other verdicts"


def text_lines(rows: Sequence[Measurement]) -> list[str]:
    """A line for each measurement: numbers to the right, how it ended last."""
    numbers = [_NUMBERS, *(_numbers(row) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*numbers, strict=True)]
    aligned = [[cell.rjust(width) for cell, width in zip(line, widths, strict=True)] for line in numbers]
    named = [("TREE", "SEMANTICS", "LANGUAGE"), *((visible(row.tree), row.semantics, row.language) for row in rows)]
    said = ["RESULT", *(ended(row) for row in rows)]
    return columns([*name, *line, end] for name, line, end in zip(named, aligned, said, strict=True))


def _numbers(row: Measurement) -> tuple[str, ...]:
    sizes = ("" if size is None else str(size) for size in (row.symbols, row.subformulas, row.states, row.edges))
    time = "" if row.seconds is None else milliseconds(row.seconds)
    speeds = ("" if speed is None else f"{speed:.0f}" for speed in (row.events_per_second, row.again_per_second))
    return (*sizes, time, *speeds)


def milliseconds(seconds: float) -> str:
    """A time with three significant digits.

    >>> milliseconds(0.0012345)
    '1.23'
    """
    return f"{1000 * seconds:.3g}" if seconds < 0.9995 else f"{1000 * seconds:.0f}"


def ended(row: Measurement) -> str:
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
_HEADINGS: Final = {
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
    tables = ["% Needs \\usepackage[T1]{fontenc} and \\usepackage{booktabs,multirow,textcomp}.\n"]
    for semantics in dict.fromkeys(row.semantics for row in rows):
        chosen = [row for row in rows if row.semantics is semantics]
        tables += _tables(semantics, chosen, width)
    return "\n".join(tables)


def _tables(semantics: Semantics, rows: Sequence[Measurement], width: Width) -> Iterator[str]:
    data = pandas()
    trees = {(row.tree, row.digest): escaped(_shortened(visible(row.tree))) for row in rows}
    by_language: dict[str, Any] = {}
    for language in dict.fromkeys(row.language for row in rows):
        own = {(row.tree, row.digest): _latex_cells(row) for row in rows if row.language == language}
        frame = data.DataFrame([dict.fromkeys(_HEADINGS, "") | own.get(tree, {}) for tree in trees])
        by_language[escaped(language)] = frame.loc[:, (frame != "").any()]
    for number, group in enumerate(_side_by_side(by_language, _BROAD[width]), 1):
        table = data.concat({language: by_language[language] for language in group}, axis=1)
        table.index = list(trees.values())
        for start in range(0, len(table), _LONG):
            name = f"tab:languages-{semantics}-{number}-{start // _LONG + 1}"
            shown = {heading for _, heading in table.columns}
            meanings = "; ".join(f"{heading} {text}" for heading, text in _HEADINGS.items() if heading in shown)
            part = table.iloc[start : start + _LONG].style
            yield part.to_latex(
                environment="table*" if width is Width.PAGE else "table",
                position="htbp",
                position_float="centering",
                hrules=True,
                column_format="l" + "r" * table.shape[1],
                multicol_align="c",
                caption=f"Languages under the semantics {semantics}: {meanings}.",
                label=name,
            ).replace(r"\begin{tabular}", "\\scriptsize\\setlength{\\tabcolsep}{2.2pt}\n\\begin{tabular}")


def _side_by_side(by_language: dict[str, Any], room: int) -> Iterator[list[str]]:
    """The languages in groups of at most so many columns."""
    group: list[str] = []
    for language, frame in by_language.items():
        if group and sum(by_language[one].shape[1] for one in group) + frame.shape[1] > room:
            yield group
            group = []
        group.append(language)
    yield group


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
