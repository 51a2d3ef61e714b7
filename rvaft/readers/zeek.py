"""Logs of Zeek: tables with tabs, whose header lines begin with `#`."""

import re
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar, Final

from rvaft.model.values import Json
from rvaft.readers.json_lines import settled
from rvaft.readers.log import FieldType, Log, LogReader, lines_of

_ESCAPE: Final = re.compile(rb"\\x([0-9a-fA-F]{2})|\\\\")
_NUMBERS: Final = frozenset({"time", "interval", "double", "count", "int", "port"})
_CONTAINER: Final = re.compile(r"(?:set|vector|table)\[(\w+)\]")
_MARKS: Final = ("set_separator", "empty_field", "unset_field")


class ZeekReader(LogReader):
    r"""Rows by the header lines `#separator`, `#fields` and `#types`; `_path` is the name of the log.

    An unset field is absent. Sets and vectors are lists.

    >>> import io
    >>> head = b"#separator \\x09\n#path\tdns\n#fields\tts\tport\tnames\n#types\ttime\tport\tset[string]\n"
    >>> list(Log(ZeekReader(), io.BytesIO(head + b"1.5\t53\ta,b\n2\t-\t(empty)\n"), "dns.log").events())
    [{'_path': 'dns', 'ts': 1.5, 'port': 53, 'names': ['a', 'b']}, {'_path': 'dns', 'ts': 2, 'names': []}]
    """

    name: ClassVar[str] = "zeek"

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the rows with the numbers of their lines."""
        header = _Header()
        for number, data in lines_of(log.stream, log.name, log.line):
            try:
                line = data.decode().rstrip("\r\n")
                if line.startswith("#"):
                    header.read(line)
                elif line:
                    yield number, settled(header.event(line), log)
            except UnicodeDecodeError:
                log.reject(number, "not UTF-8")
            except ValueError as error:
                log.reject(number, str(error))


class _Header:
    """The header lines so far."""

    def __init__(self) -> None:
        self._separator, self._path = "\t", ""
        self._marks = dict(zip(_MARKS, (",", "(empty)", "-"), strict=True))
        self._names: Sequence[str] = ()
        self._columns: Sequence[tuple[str, Callable[[str], Json]]] = ()

    def read(self, line: str) -> None:
        """Read a header line; raises `ValueError`."""
        if line.startswith("#separator "):
            self._separator = _unescaped(line.removeprefix("#separator "))
            if not self._separator:
                raise ValueError("the header has an empty separator")
            return
        word, *values = line.removeprefix("#").split(self._separator)
        if word == "path" and len(values) == 1:
            self._path = values[0]
        elif word in _MARKS and len(values) == 1:
            self._marks[word] = values[0]
        elif word == "fields":
            self._names, self._columns = values, ()
            if len(set(values)) < len(values):
                raise ValueError("the header has a field twice")
        elif word == "types":
            if len(values) != len(self._names):
                raise ValueError(f"the header has {len(self._names)} fields, but {len(values)} types")
            self._columns = [(name, self._converter(type_)) for name, type_ in zip(self._names, values, strict=True)]

    def event(self, line: str) -> dict[str, Json]:
        """Return the event of a row; raises `ValueError`."""
        if not self._columns:
            raise ValueError("a row without the header lines #fields and #types: is it a log of Zeek with tabs?")
        cells = line.split(self._separator)
        if len(cells) != len(self._columns):
            raise ValueError(f"{len(cells)} fields, but the header has {len(self._columns)}")
        event: dict[str, Json] = {"_path": self._path} if self._path else {}
        for (name, convert), cell in zip(self._columns, cells, strict=True):
            if cell != self._marks["unset_field"]:
                try:
                    event[name] = convert(cell)
                except ValueError as error:
                    raise ValueError(f"the field {name} is {error}") from None
        return event

    def _converter(self, type_: str) -> Callable[[str], Json]:
        if found := _CONTAINER.fullmatch(type_):
            inner, separator, empty = (
                self._converter(found[1]),
                self._marks["set_separator"],
                self._marks["empty_field"],
            )
            unset = self._marks["unset_field"]
            return lambda cell: (
                [] if cell == empty else [None if one == unset else inner(one) for one in cell.split(separator)]
            )
        if type_ in _NUMBERS:
            return FieldType.NUMBER.value_of
        if type_ == "bool":
            return FieldType.BOOL.value_of
        empty_text = self._marks["empty_field"]
        return lambda cell: "" if cell == empty_text else _unescaped(cell)


def _unescaped(text: str) -> str:
    r"""Return a text without escapes such as `\x09`; bytes that are no UTF-8 stay escaped."""
    if "\\" not in text:
        return text
    return _ESCAPE.sub(lambda found: bytes.fromhex(found[1].decode()) if found[1] else b"\\", text.encode()).decode(
        errors="backslashreplace"
    )
