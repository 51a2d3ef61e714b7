"""Reading JSON Lines: one object per line (RFC 8259), line by line.

Allowed are a byte order mark, CRLF, blank lines, a missing last newline, and an empty trace. Other
lines that are not one object raise `TraceError`, as do lone surrogates, deep nesting, and endless
lines and numbers. Messages never quote the line. A repeated key is an error where it is read. NaN,
infinities and overflowing numbers become null, or an undefined value with a `NonFiniteEvent` where
they are read. `strict` refuses them: the words everywhere, numbers where they are read.
"""

import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from io import BufferedIOBase
from pathlib import Path
from typing import BinaryIO, Final

from rvaft.core.fields_to_read import Reads, Scope
from rvaft.errors import TraceError
from rvaft.model.values import Exact, Json, decimal, is_finite
from rvaft.readers.log import MAX_DIGITS, MAX_LINE, Log, LogReader, Source, lines_of, suffix
from rvaft.support.files import opened
from rvaft.support.terminal import cut

MAX_DEPTH: Final = 500
"""Maximum nesting, below the limits of all decoders."""
BLANK: Final = b" \t\r\n"

HINT: Final = "a trace has one JSON object per line"
_OTHER: Final = "; for lines of text name a --profile, --input syslog, or --input regex and a --pattern"
_STRING_OR_BRACKET: Final = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[\[\]{}]', re.DOTALL)
_SURROGATE: Final = re.compile(r"\\u[dD][89a-fA-F]")
_ESCAPE: Final = re.compile(r"\\(?:u[dD][89abAB]..\\u[dD][c-fC-F]..|(u[dD][89a-fA-F]..)|.)")
_PERHAPS_WORD: Final = re.compile(r"NaN|Infinity")
_PERHAPS_HUGE: Final = re.compile(r"[0-9][eE]\+?0*[1-9][0-9][0-9]|[0-9]{200}")
_HUGE: Final = "a number beyond the range of a double"
_SHOWN: Final = 40


def read(
    source: Source, *, name: str | None = None, reads: Scope | None = None, line: int = 1, strict: bool = False
) -> Iterator[dict[str, Json]]:
    """Yield the events of a trace; raises `TraceError`, `ToolMissing` and `OSError`.

    `source` is a path (`.gz` and `.zst` are decompressed) or a binary stream; `name` replaces it in
    errors. Without `reads`, repeated keys are refused everywhere.

    >>> import io
    >>> list(read(io.BytesIO(b'{"event": "a"}')))
    [{'event': 'a'}]
    """
    if isinstance(source, (str, os.PathLike)):
        with opened(Path(source)) as stream:
            yield from read(stream, name=name or os.fspath(source), reads=reads, line=line, strict=strict)
        return
    for _, event in numbered(source, name or "<trace>", reads, line, strict=strict):
        yield event


class JsonLinesReader(LogReader):
    """JSON Lines; a malformed line ends the log, since the file is probably damaged.

    >>> import io
    >>> list(Log(JsonLinesReader(), io.BytesIO(b'{"event": "a"}'), "log.jsonl").events())
    [{'event': 'a'}]
    """

    name = "jsonl"
    suffixes = (".jsonl", ".ndjson")
    by_lines = True

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events with their line numbers."""
        return numbered(log.stream, log.name, log.reads, log.line, strict=log.strict)


def numbered(
    source: BinaryIO, file: str, reads: Scope | None, line: int, *, strict: bool
) -> Iterator[tuple[int, dict[str, Json]]]:
    """Yield the events with their line numbers, as `read` does."""
    for number, text in lines_of(source, file, line):
        event = event_on(text.removesuffix(b"\n"), file, number, reads, strict=strict)
        if event is not None:
            yield number, event


def event_on(
    line: bytes, file: str, number: int, reads: Scope | None, *, strict: bool = False
) -> dict[str, Json] | None:
    """Return the event on a line, None if blank; raises `TraceError`."""
    if len(line) <= MAX_LINE and not line.strip(BLANK):
        return None
    try:
        return decode(line, reads=reads, strict=strict)
    except ValueError as error:
        other = number == 1 and suffix(Path(file)) in (".log", ".txt") and not line.lstrip(BLANK).startswith(b"{")
        raise TraceError(f"{error}{_OTHER if other else ''}", file=file, line=number) from None


def decode(
    line: bytes,
    *,
    reads: Scope | None = None,
    strict: bool = False,
    passed_on: bool = False,
    placed: Callable[[dict[str, Json]], dict[str, Json]] | None = None,
) -> dict[str, Json]:
    """Return the event on a line; raises `ValueError`, with a message that does not quote the line.

    `passed_on` keeps all numbers, or, with `strict`, refuses those that are not JSON. `placed`
    converts the decoded object.

    >>> event = decode(b'{"v": NaN}')
    >>> event, event.field, event.number
    ({'v': nan}, 'v', 'NaN')
    """
    if len(line) > MAX_LINE:
        raise ValueError(f"the line is longer than {MAX_LINE // 1024**2} MiB")
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 (byte {error.start + 1} of the line); {HINT}") from None
    check_depth(text)
    try:
        event = (_STRICT if strict else DECODER).decode(text)
    except json.JSONDecodeError as error:
        reason = (error.msg[:1].lower() + error.msg[1:]).removesuffix(" at").removesuffix(" starting")
        raise ValueError(f"not JSON: {reason} (column {error.colno}); {HINT}") from None
    except RecursionError:
        raise ValueError("nested too deeply for the space left on the stack") from None
    if placed is not None and isinstance(event, dict):
        event = placed(event)
    return checked(event, text, reads, strict=strict, passed_on=passed_on)


def checked(
    event: Json, text: str, reads: Scope | None, *, strict: bool = False, passed_on: bool = False
) -> dict[str, Json]:
    """Check a value decoded by `DECODER` and return it as an event; raises as `decode` does.

    >>> checked({"v": 1}, '{"v": 1}', None)
    {'v': 1}
    """
    if _SURROGATE.search(text) and any(escape[1] for escape in _ESCAPE.finditer(text)):
        raise ValueError("a lone surrogate: \\ud800 to \\udfff stand only in pairs")
    if not isinstance(event, dict):
        raise ValueError(f"not a JSON object but {_KINDS[type(event)]}; {HINT}")  # noqa: TRY004 (the text is wrong)
    _check_read(event, Reads(whole=True) if reads is None else reads.of(event))
    if _PERHAPS_WORD.search(text) or _PERHAPS_HUGE.search(text):
        return marked(event, reads, strict=strict, kept=passed_on)
    return event


class NonFiniteEvent(dict[str, Json]):
    """An event with a number that is not finite in a `field` that is read; `number` is its
    spelling.
    """

    __slots__ = ("field", "number")
    field: str
    number: str


class RepeatingObject(dict[str, Json]):
    """An object with repeated keys."""

    __slots__ = ("repeated",)
    repeated: frozenset[str]


def _object(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    made = dict(pairs)
    if len(made) == len(pairs):
        return made
    repeating = RepeatingObject(made)
    repeating.repeated = frozenset(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
    return repeating


def _constant(name: str) -> Json:
    raise ValueError(f"not JSON: {name} is not a JSON number")


def _integer(digits: str) -> int:
    if len(digits.removeprefix("-")) > MAX_DIGITS:
        raise ValueError(f"a number of more than {MAX_DIGITS} digits")
    return int(digits)


_STRICT: Final = json.JSONDecoder(
    object_pairs_hook=_object, parse_constant=_constant, parse_int=_integer, parse_float=decimal
)
DECODER: Final = json.JSONDecoder(object_pairs_hook=_object, parse_int=_integer, parse_float=decimal)
"""Accepts NaN and infinities."""


def described(value: Json) -> str:
    """Return the type and the value of a value as a short text.

    >>> described("yesterday"), described(None)
    ('a string ("yesterday")', 'null')
    """
    text = json.dumps(value, ensure_ascii=False)
    kind = "an object" if isinstance(value, dict) else _KINDS[type(value)]
    return kind if value is None else f"{kind} ({cut(text)})"


_NAMES: Final = {
    list: "a list",
    str: "a string",
    int: "a number",
    float: "a number",
    Exact: "a number",
    bool: "a boolean",
}
_KINDS: Final[Mapping[type, str]] = {**_NAMES, type(None): "null"}


def check_depth(text: str) -> None:
    """Raise `ValueError` for text that is nested too deeply."""
    if text.count("{") + text.count("[") <= MAX_DEPTH:
        return
    depth = 0
    for token in _STRING_OR_BRACKET.finditer(text):
        depth += (token[0] in "{[") - (token[0] in "}]")
        if depth > MAX_DEPTH:
            raise ValueError(f"nested more than {MAX_DEPTH} levels deep")


def _check_read(event: dict[str, Json], reads: Reads) -> None:
    agenda: list[tuple[Json, Reads]] = [(event, reads)]
    while agenda:
        value, here = agenda.pop()
        if isinstance(value, dict):
            for key in sorted(value.repeated) if isinstance(value, RepeatingObject) else ():
                if here.whole or key in here.fields:
                    raise ValueError(f"the key {json.dumps(cut(key))} is repeated")
            if here.whole:
                agenda.extend((inner, here) for inner in value.values())
            else:
                agenda.extend((value[key], inner) for key, inner in here.fields.items() if key in value)
        elif isinstance(value, list):
            items = here if here.whole else here.items
            if items is not None:
                agenda.extend((item, items) for item in value)


def marked(event: dict[str, Json], reads: Scope | None, *, strict: bool = False, kept: bool = True) -> dict[str, Json]:
    """Return the event, as a `NonFiniteEvent` if a number that is read is not finite.

    Other numbers that are not finite become null, unless `kept`.
    """
    first: tuple[str, float] | None = None
    read = Reads(whole=True) if reads is None else reads.of(event)
    agenda: list[tuple[Json, Reads | None, str]] = [(event, read, "")]
    while agenda:
        value, here, path = agenda.pop()
        for place, part in value.items() if isinstance(value, dict) else enumerate(value):
            inner = here
            if here is not None and not here.whole:
                inner = here.fields.get(place) if isinstance(place, str) else here.items
            name = f"{path}.{place}" if path else str(place)
            if isinstance(part, (dict, list)):
                agenda.append((part, inner, name))
            elif not is_finite(part):
                if strict and (kept or inner is not None):
                    raise ValueError(_HUGE)
                if inner is not None:
                    first = first or (name, part)
                elif not kept:
                    value[place] = None
    if first is None:
        return event
    found = NonFiniteEvent(event)
    found.field, found.number = first[0], json.dumps(first[1])
    return found


class LinesRead(BufferedIOBase):
    """The lines of a stream, with the position: `offset` bytes and `line` lines."""

    def __init__(self, stream: BinaryIO, *, offset: int = 0, line: int = 0) -> None:
        super().__init__()
        self._stream = stream
        self.offset = offset
        self.line = line

    def readline(self, size: int | None = -1) -> bytes:
        """Return the next line, or its first `size` bytes."""
        line = self._stream.readline(-1 if size is None else size)
        self.offset += len(line)
        self.line += line.endswith(b"\n")
        return line

    def read1(self, size: int | None = -1) -> bytes:
        """Return up to `size` bytes; the caller then calls `reach`."""
        return self._stream.read1(-1 if size is None else size)  # type: ignore[attr-defined, no-any-return]

    def fileno(self) -> int:
        """Return the file descriptor of the stream."""
        return self._stream.fileno()

    def tell(self) -> int:
        """Return the number of consumed bytes."""
        return self.offset

    def reach(self, size: int, lines: int) -> None:
        """Advance the position."""
        self.offset += size
        self.line += lines


def settled(event: dict[str, Json], log: Log) -> dict[str, Json]:
    """Return the event of another format, as `marked` does.

    Raises `ValueError` if the log is read strictly.

    >>> from io import BytesIO
    >>> settled({"v": float("nan")}, Log(JsonLinesReader(), BytesIO(), "log")).number
    'NaN'
    """
    if is_finite(event):
        return event
    try:
        return marked(event, log.reads, strict=log.strict, kept=False)
    except ValueError:
        raise ValueError("a number in it is not finite") from None
