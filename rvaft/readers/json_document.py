"""JSON documents: an array of events, or an object with such an array, read incrementally.

Items are decoded as strictly as JSON Lines. (Streaming parsers replace lone surrogates, refuse long
integers, and do not report repeated keys.)
"""

import codecs
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from io import DEFAULT_BUFFER_SIZE, BufferedIOBase
from itertools import count
from pathlib import Path
from typing import ClassVar, Final

from rvaft.errors import TraceError
from rvaft.model.values import Json
from rvaft.readers.json_lines import DECODER, check_depth, checked, decode
from rvaft.readers.log import BOM, MAX_LINE, InputOptions, Log, LogReader, failures_of, source_of, suffix
from rvaft.support.files import SUFFIXES

DEFAULT_PATH: Final = "Records"
"""As in CloudTrail files."""
_BEGINS: Final = re.compile(rb'\s*(?:\[|\{[ \t\r]*\n|\{[^\n]*"Records"[ \t]*:[ \t]*\[)')
_HEAD: Final = 4096
"""Bytes that distinguish a document from JSON Lines."""
_BLOCK: Final = 1 << 18
_SPACE: Final = re.compile(r"[ \t\r\n]*")
_CLOSED: Final = frozenset('[{"')
_WORD: Final = 12
"""An error this close to the end may be due to a torn token."""


class JsonReader(LogReader):
    """A JSON array of events, or an object with one at the path `records`.

    A `.json` file with another beginning is JSON Lines.

    >>> import io
    >>> list(Log(JsonReader(), io.BytesIO(b'{"Records": [{"event": "a"}, {"event": "b"}]}'), "trail.json").events())
    [{'event': 'a'}, {'event': 'b'}]
    """

    name: ClassVar[str] = "json"
    suffixes: ClassVar[tuple[str, ...]] = (".json",)
    unit: ClassVar[str] = "record"
    takes: ClassVar[frozenset[str]] = frozenset({"records"})

    @classmethod
    def suits(cls, path: Path, options: InputOptions) -> bool:
        """Whether a `.json` file begins like a document, or `records` is given."""
        if suffix(path) not in cls.suffixes or not path.is_file():
            return False
        if options.records is not None:
            return True
        with suppress(*failures_of(str(path))), source_of(cls(), str(path)) as source:
            assert not isinstance(source, (Path, str)), "it needs no file"
            return _BEGINS.match(source.read(_HEAD).removeprefix(BOM)) is not None
        return False

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the objects in the array with their numbers."""
        window = _Window(log)
        path = self.options.records if self.options.records is not None else DEFAULT_PATH
        yield from self._inside(window, log, [path], first=True)
        if window.next():
            raise window.wrong("there is data after the end of the document")

    def _inside(
        self, window: "_Window", log: Log, path: Sequence[str], *, first: bool
    ) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events in the next value: the array, or an object on the path."""
        begin = window.next()
        if begin == "[" and (first or not path):
            yield from self._items(window, log)
        elif begin == "{" and path:
            yield from self._member(window, log, path)
        else:
            kind = "an array" if not path else "an array or an object" if first else "an object"
            hint = "" if first else ": say where the events are with --records PATH"
            raise window.wrong(f"expected {kind} here{hint}" if begin else "the document ends too early")

    def _member(self, window: "_Window", log: Log, path: Sequence[str]) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events in the member at `path`; keys may contain dots."""
        found = False
        for _ in window.parts("{", "}"):
            name, _ = window.value()
            window.expect(":")
            whole = ".".join(path)
            left = None if not isinstance(name, str) else () if name == whole else _after(name, whole)
            if left is None:
                window.value()
            elif found:
                raise window.wrong(f"the key {json.dumps(name)} is repeated")
            else:
                found = True
                yield from self._inside(window, log, left, first=False)
        if not found:
            hint = "say where the events are with --records PATH"
            raise log.error_at(f"the document has no value at {'.'.join(path)}: {hint}", None)

    def _items(self, window: "_Window", log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        for number in window.parts("[", "]"):
            value, text = window.value()
            if not isinstance(value, dict):
                log.reject(number, "not an object")
                continue
            try:
                check_depth(text)
                event = decode(text.encode(), reads=log.reads, strict=True) if log.strict else value
                event = checked(event, text, log.reads, strict=log.strict)
            except ValueError as error:
                log.reject(number, str(error).partition("; ")[0])
            else:
                yield number, event


def _after(name: str, path: str) -> tuple[str, ...] | None:
    return (path.removeprefix(f"{name}."),) if path.startswith(f"{name}.") else None


class _Window:
    """The current part of a document; values are consumed from its start."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._decode = codecs.getincrementaldecoder("utf-8-sig")().decode
        self._text = ""
        self._place = 0
        self._line = 1
        self._failure: TraceError | None = None
        self._ended = False

    def next(self) -> str:
        """Return the next character that is not space, or "" at the end."""
        while True:
            space = _SPACE.match(self._text, self._place)
            self._place = space.end() if space else self._place
            if self._place < len(self._text):
                return self._text[self._place]
            if not self._more():
                return ""

    def expect(self, mark: str) -> None:
        """Consume this character; raises `TraceError` for another one."""
        if (found := self.next()) != mark:
            raise self.wrong(f"not JSON: expecting {mark!r}" if found else "the document ends too early")
        self._place += 1

    def parts(self, begin: str, end: str) -> Iterator[int]:
        """Iterate over the parts of an array or object, which the caller consumes."""
        self.expect(begin)
        for number in count(1) if self.next() != end else ():
            yield number
            if self.next() == end:
                break
            self.expect(",")
        self.expect(end)

    def value(self) -> tuple[Json, str]:
        """Consume a value and return it with its text."""
        if not (begin := self.next()):
            raise self.wrong("the document ends too early")
        least = _BLOCK
        while True:
            try:
                found, end = DECODER.raw_decode(self._text, self._place)
            except RecursionError:
                raise self.wrong("nested too deeply for the space left on the stack") from None
            except json.JSONDecodeError as error:
                torn = error.msg.startswith("Unterminated")
                early, behind = torn or error.pos >= len(self._text), error.pos - self._place
                if not ((torn or error.pos + _WORD >= len(self._text)) and self._more(least)):
                    reason = f"{error.msg[:1].lower()}{error.msg[1:]}".removesuffix(" at").removesuffix(" starting")
                    message = "the document ends too early" if early else f"not JSON: {reason}"
                    raise self.wrong(message, self._place + behind) from None
            except ValueError as error:
                raise self.wrong(str(error)) from None
            else:
                # a number could continue in the unread text
                if begin in _CLOSED or end < len(self._text) or not self._more():
                    text, self._place = self._text[self._place : end], end
                    return found, text
            least = len(self._text)
            if least - self._place > MAX_LINE:
                raise self.wrong(f"a value is longer than {MAX_LINE // 1024**2} MiB")

    def wrong(self, reason: str, place: int | None = None) -> TraceError:
        """Return the error for a place, by default the current one."""
        line = self._line + self._text.count("\n", 0, self._place if place is None else place)
        return TraceError(reason, file=self._log.name, line=line)

    def _more(self, least: int = 1) -> bool:
        """Read `least` bytes, if available, and drop the consumed text; return False at the end."""
        if self._failure is not None:
            raise self._failure
        self._line += self._text.count("\n", 0, self._place)
        pieces, self._place = [self._text[self._place :]], 0
        stream, read = self._log.stream, 0
        while read < least and not self._ended and self._failure is None:
            data = stream.read1(self._at_once) if isinstance(stream, BufferedIOBase) else stream.read(self._at_once)
            self._ended = not data
            read += len(data)
            try:
                pieces.append(self._decode(data, self._ended))
            except UnicodeDecodeError as error:
                pieces.append(error.object[: error.start].decode("utf-8"))
                line = self._line + "".join(pieces).count("\n")
                self._failure = TraceError("not UTF-8", file=self._log.name, line=line)
        self._text = "".join(pieces)
        return read > 0

    @property
    def _at_once(self) -> int:
        """Bytes per read; few for compressed files, where a failing call loses data."""
        return DEFAULT_BUFFER_SIZE if Path(self._log.name).suffix.lower() in SUFFIXES else _BLOCK
