"""Logs of Zeek: tables with tabs, whose header lines begin with `#`."""

import re
from collections.abc import Callable, Iterator
from typing import ClassVar, Final

from rvaft.model.values import Json
from rvaft.readers.json_lines import settled
from rvaft.readers.log import FieldType, Log, LogReader, lines_of

_ESCAPE: Final = re.compile(rb"\\x([0-9a-fA-F]{2})|\\\\")
_TYPES: Final = {
    **dict.fromkeys(("time", "interval", "double", "count", "int", "port"), FieldType.NUMBER),
    "bool": FieldType.BOOL,
}
_CONTAINER: Final = re.compile(r"(?:set|vector)\[(\w+)\]")
_USUAL: Final = {"separator": "\t", "path": "", "set_separator": ",", "empty_field": "(empty)", "unset_field": "-"}


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
        header, names = dict(_USUAL), list[str]()
        columns: list[tuple[str, Callable[[str], Json]]] = []
        for number, data in lines_of(log.stream, log.name, log.line):
            try:
                line = data.decode().rstrip("\r\n")
                word, *cells = line.removeprefix("#").split(header["separator"])
                if line.startswith("#separator "):
                    header["separator"] = _unescaped(line.removeprefix("#separator ")) or "\t"
                elif line.startswith("#fields"):
                    names, columns = cells, []
                elif line.startswith("#types"):
                    if len(cells) != len({*names}):
                        raise ValueError("the header has a field twice, or not one type for each")  # noqa: TRY301
                    columns = [(name, _converter(type_, header)) for name, type_ in zip(names, cells, strict=True)]
                elif line.startswith("#"):
                    header |= {word: cells[0]} if len(cells) == 1 else {}
                elif line:
                    yield number, settled(_event(line, columns, header), log)
            except UnicodeDecodeError:
                log.reject(number, "not UTF-8")
            except ValueError as error:
                log.reject(number, str(error))


def _event(line: str, columns: list[tuple[str, Callable[[str], Json]]], header: dict[str, str]) -> dict[str, Json]:
    if not columns:
        raise ValueError("a row without the header lines #fields and #types")
    cells = line.split(header["separator"])
    if len(cells) != len(columns):
        raise ValueError(f"{len(cells)} fields, but the header has {len(columns)}")
    event: dict[str, Json] = {"_path": header["path"]} if header["path"] else {}
    for (name, convert), cell in zip(columns, cells, strict=True):
        if cell != header["unset_field"]:
            try:
                event[name] = convert(cell)
            except ValueError as error:
                raise ValueError(f"the field {name} is {error}") from None
    return event


def _converter(type_: str, header: dict[str, str]) -> Callable[[str], Json]:
    unset, empty, comma = header["unset_field"], header["empty_field"], header["set_separator"]
    if found := _CONTAINER.fullmatch(type_):
        inner = _converter(found[1], header)
        return lambda cell: [
            None if one == unset else inner(one) for one in (cell.split(comma) if cell != empty else ())
        ]
    return kind.value_of if (kind := _TYPES.get(type_)) else lambda cell: "" if cell == empty else _unescaped(cell)


def _unescaped(text: str) -> str:
    r"""Return a text without escapes such as `\x09`; bytes that are no UTF-8 stay escaped."""
    plain = _ESCAPE.sub(lambda found: bytes.fromhex(found[1].decode()) if found[1] else b"\\", text.encode())
    return plain.decode(errors="backslashreplace")
