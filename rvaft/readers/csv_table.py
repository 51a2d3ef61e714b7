"""CSV tables: the header names the fields, and each row is an event.

An empty cell means that the event lacks the field. A cell in the number syntax of JSON is a number,
unless `types` gives the type of its column.
"""

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import ClassVar, Final

from rvaft.model.values import Json
from rvaft.readers.json_lines import settled
from rvaft.readers.log import FieldType, Log, LogReader, by_content, lines_of, suffix

_DIVIDED: Final = re.compile(r"sep=(.)\r?\n")
_QUOTED: Final = re.compile(r'"[^"]*(?:"|$)')
_DELIMITERS: Final = ("\t", ";", "|")


class CsvReader(LogReader):
    r"""CSV with a header (RFC 4180), which decides between comma, tab, semicolon and bar as
    delimiters.

    >>> import io
    >>> list(Log(CsvReader(), io.BytesIO(b"event;user;load\nlogin;bob;0.5\nlogout;;"), "day.csv").events())
    [{'event': 'login', 'user': 'bob', 'load': 0.5}, {'event': 'logout'}]
    """

    name: ClassVar[str] = "csv"
    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".tsv")
    takes: ClassVar[frozenset[str]] = frozenset({"types"})

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events with the first lines of their rows."""
        lines = (data.decode(errors="surrogateescape") for _, data in lines_of(log.stream, log.name, log.line))
        head = next(lines, "")
        declared = _DIVIDED.fullmatch(head)
        before, head = (1, next(lines, "")) if declared else (0, head)
        if not head.strip():
            raise log.error_at("there is no header, which names the fields of the rows", 1 + before)
        if head.lstrip()[0] in "{[<":
            raise log.error_at("the first line is JSON or XML, not a header: name the format with --input", 1 + before)
        divider = declared[1] if declared else delimiter(head, Path(log.name))
        rows = csv.reader(chain([head], lines), delimiter=divider, skipinitialspace=True, strict=True)
        try:
            header = [name.strip() for name in next(rows)]
            "".join(header).encode()
        except UnicodeEncodeError:
            raise log.error_at("not UTF-8: convert it, for example with iconv", 1 + before) from None
        except csv.Error as error:
            raise log.error_at(f"the header cannot be read: {str(error).partition(' - ')[0]}", 1 + before) from error
        columns = [(name, self._converter(name, divider)) for name in header]
        self._check(header, log, 1 + before)
        odd = FieldType.NUMBER in self.options.types.values()  # a cell without a type is never NaN
        while True:
            number = rows.line_num + before + 1
            try:
                row = next(rows, None)
            except csv.Error as error:
                count = rows.line_num + before + 1 - number
                log.reject(number, f"no row of a table: {error}; is a quote not closed?", max(1, count))
                continue
            if row is None:
                return
            if not row:
                continue
            if len(row) != len(header):
                fields = f"{len(row)} field{'s' * (len(row) != 1)}"
                log.reject(number, f"{fields}, but the header has {len(header)}")
                continue
            try:
                event = self._event(columns, row)
                event = settled(event, log) if odd else event
            except ValueError as error:
                log.reject(number, str(error))
            else:
                yield number, event

    def _event(self, columns: list[tuple[str, Callable[[str], Json]]], row: list[str]) -> dict[str, Json]:
        event: dict[str, Json] = {}
        try:
            "".join(row).encode()
        except UnicodeEncodeError:
            raise ValueError("not UTF-8") from None
        for (name, convert), cell in zip(columns, row, strict=True):
            if cell or convert is str:
                try:
                    event[name] = convert(cell)
                except ValueError as error:
                    raise ValueError(f"the field {name} is {error}") from None
        return event

    def _converter(self, name: str, divider: str) -> Callable[[str], Json]:
        kind = self.options.types.get(name)
        if kind is FieldType.NUMBER and divider == ";":  # with decimal commas
            return lambda cell: kind.value_of(cell if "." in cell else cell.replace(",", ".", 1))
        return by_content if kind is None else str if kind is FieldType.TEXT else kind.value_of

    def _check(self, header: list[str], log: Log, line: int) -> None:
        if any("\0" in name for name in header):
            raise log.error_at("the header has NUL characters: is it UTF-16? Convert it, for example with iconv", line)
        for name, count in Counter(header).items():
            if count > 1:
                raise log.error_at(f"the header has the field {name!r} twice: give each a name of its own", line)
        log.require(header)
        for name in self.options.types:
            if name not in header:
                raise log.error_at(f"the header has no field {name}, but a type is given for it", line)


def delimiter(head: str, path: Path) -> str:
    r"""Return the delimiter of a table with this header.

    >>> delimiter("event;user\n", Path("day.csv"))
    ';'
    """
    bare, usual = _QUOTED.sub("", head), "\t" if suffix(path) == ".tsv" else ","
    return next((one for one in (usual, ",", *_DELIMITERS) if one in bare), usual)
