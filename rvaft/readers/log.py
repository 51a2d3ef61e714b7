"""The interface of log formats: a reader yields the events of a log with their places.

A reader *rejects* records that are no events: it counts them, and reports the first with its place
and reason. For formats with unrelated text (`lenient`) this is a warning, unless no record is an
event; for other formats it is an error after the remaining events. An unreadable log raises
`TraceError` after the events before the damage.
"""

import errno
import os
import re
import shutil
import warnings
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from itertools import count
from math import isfinite
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import BinaryIO, ClassVar, Final, NamedTuple, Self, TypeAlias

from rvaft.core.fields_to_read import Scope, TreeReads
from rvaft.errors import OptionError, TraceError
from rvaft.model.patterns import ObjectPattern
from rvaft.model.values import NUMBER, Json, JsonObject, decimal
from rvaft.support.files import SUFFIXES, damage, opened

MAX_LINE: Final = 64 * 1024 * 1024
MAX_DIGITS: Final = 4300
"""Maximum digits of an integer: conversion takes quadratic time."""
BOM: Final = b"\xef\xbb\xbf"

Source: TypeAlias = str | os.PathLike[str] | BinaryIO
LogSource: TypeAlias = Path | BinaryIO | str
_SCHEME: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_WILD: Final = frozenset("*?[")


class FieldType(StrEnum):
    """The type of a field that a log has as text."""

    NUMBER = "number"
    TEXT = "text"
    BOOL = "bool"

    def value_of(self, text: str) -> Json:
        """Convert a text; raises `ValueError`.

        >>> FieldType.NUMBER.value_of("007"), FieldType.BOOL.value_of("Yes"), FieldType.TEXT.value_of("007")
        (7, True, '007')
        """
        match self:
            case FieldType.TEXT:
                return text
            case FieldType.BOOL:
                if (found := _BOOLEANS.get(text.strip().lower())) is None:
                    raise ValueError("neither true nor false")
                return found
            case FieldType.NUMBER:
                return _number(_ANY_NUMBER, text.strip())


def by_content(text: str) -> Json:
    """Convert a text in the number syntax of JSON to a number, if it fits a double.

    >>> by_content("12.50"), by_content("007"), by_content("1e999"), by_content("true")
    (12.5, '007', '1e999', 'true')
    """
    if text[:1] not in _FIRST_OF_NUMBERS:
        return text
    try:
        found = _number(NUMBER, text)
    except ValueError:
        return text
    return found if isfinite(found) else text


def _number(form: re.Pattern[str], text: str) -> int | float:
    if not form.fullmatch(text):
        raise ValueError("no number")
    if not _WHOLE.fullmatch(text):
        return decimal(text)
    if len(text.lstrip("+-")) > MAX_DIGITS:
        raise ValueError(f"a number of more than {MAX_DIGITS} digits")
    return int(text)


_FIRST_OF_NUMBERS: Final = frozenset("-0123456789")
_ANY_NUMBER: Final = re.compile(
    r"[+-]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?|nan|inf|infinity)", re.IGNORECASE
)
_WHOLE: Final = re.compile(r"[+-]?[0-9]+")
_BOOLEANS: Final = {
    **dict.fromkeys(("true", "yes", "t", "y", "1"), True),
    **dict.fromkeys(("false", "no", "f", "n", "0"), False),
}


PROFILES: Final = Path(__file__).with_name("profiles")
"""The folder of the shipped profiles."""
SHIPPED: Final = sorted(one.name.removesuffix(".toml") for one in PROFILES.iterdir())
"""The names of the shipped profiles."""


@dataclass(frozen=True, slots=True)
class InputOptions:
    """Options of log formats; None or empty if not given.

    `records` is the dotted path of the event list in a JSON document. `types` gives the types of
    fields. `pattern` is a regular expression with named groups. `profile` names a declaration of a product's
    logs. `year` is that of times without one. `dbc` is the file that names the signals of a CAN log,
    and `messages` the folder with message definitions of ROS that a recording lacks.
    """

    records: str | None = None
    types: Mapping[str, FieldType] = field(default_factory=dict)
    pattern: str | None = None
    profile: str | None = None
    year: int | None = None
    dbc: str | None = None
    messages: str | None = None

    @property
    def given(self) -> frozenset[str]:
        """The names of given options."""
        return frozenset(name for name in OF_FORMATS if getattr(self, name))

    def only(self, names: Collection[str]) -> "InputOptions":
        """Return these options only."""
        return replace(InputOptions(year=self.year), **{name: getattr(self, name) for name in self.given & set(names)})


OF_FORMATS: Final = tuple(option.name for option in fields(InputOptions) if option.name != "year")
"""The names of the options that only some formats take."""


@dataclass(frozen=True, slots=True)
class Interest:
    """The parts of events that are used: these `fields`, or all if None.

    `may_be(field, value)` returns whether an event with this text may be relevant; for another, a
    reader may yield None.
    """

    fields: frozenset[str] | None = None
    may_be: Callable[[str, str], bool] = lambda _field, _value: True

    @classmethod
    def of(cls, reads: Scope, also: Iterable[str]) -> Self:
        """Return the interest of a tree with further fields; all fields if a pattern is no object.

        >>> import rvaft
        >>> from rvaft.core.fields_to_read import TreeReads
        >>> sorted(Interest.of(TreeReads(rvaft.loads("top or a b;")), ["time"]).fields)
        ['event', 'time']
        """
        patterns = reads.patterns if isinstance(reads, TreeReads) else ()
        objects = [pattern for pattern in patterns if isinstance(pattern, ObjectPattern)]
        if not objects or len(objects) < len(patterns):
            return cls()
        return cls(frozenset([*also, *(name for one in objects for name, _ in one.fields)]))


ALL: Final = Interest()


@dataclass(frozen=True, slots=True)
class Live:
    """Callbacks for live events: to stop waiting, report readiness, and warn of lost events."""

    stop: Callable[[], bool] = lambda: False
    began: Callable[[], object] = lambda: None
    warn: Callable[[str], object] = warnings.warn


@dataclass(slots=True)
class Log:
    r"""A log that is being read: reader, input and results so far.

    `source` is a binary stream; for a reader with `needs_file` a path, for a URL reader the URL.
    `name` replaces it in messages. `line` is the number of the first line. Events must have one
    field of each `needed` tuple. `reading` is the current line. `rejected` counts rejected records;
    the error for the `first` one is passed to `on_reject` at once.

    >>> import io
    >>> from rvaft.readers.registry import reader
    >>> log = Log(reader("csv"), io.BytesIO(b"event,load\nstart,2\nstop\n"), "day.csv")
    >>> list(log.events()), log.rejected
    ([{'event': 'start', 'load': 2}], 1)
    >>> print(log.fault)
    day.csv:3: 1 field, but the header has 2 (1 line left out)
    """

    reader: "LogReader"
    source: LogSource
    name: str
    reads: Scope | None = None
    strict: bool = False
    line: int = 1
    needed: Sequence[tuple[str, ...]] = ()
    interest: Interest = ALL
    place: int = 0
    reading: int | None = None
    given: int = 0
    rejected: int = 0
    first: TraceError | None = None
    on_reject: Callable[[TraceError], object] | None = None
    live: Live = field(default_factory=Live)

    @property
    def stream(self) -> BinaryIO:
        """The input stream."""
        assert not isinstance(self.source, (Path, str)), "a reader that needs a file is given one"
        return self.source

    @property
    def path(self) -> Path:
        """The input file."""
        assert isinstance(self.source, Path), "a reader that needs no file is given a stream"
        return self.source

    @property
    def url(self) -> str:
        """The input URL."""
        assert isinstance(self.source, str), "only a reader of URLs is given one"
        return self.source

    @property
    def line_read(self) -> int | None:
        """The line, or the row of a table, of the last event; None for other formats."""
        return self.place if self.reader.unit in ("line", "row") else None

    def events(self) -> Iterator[dict[str, Json] | None]:
        """Yield the events, None if irrelevant; raises `TraceError` and `ToolMissing`."""
        failures = failures_of(self.name)
        try:
            for place, event in self.reader.events(self):
                self.place = place
                self.given += 1
                yield event
        except failures as error:
            raise unreadable(error, self.name, *self._where(self.place + 1)) from error

    def error_at(self, reason: str, place: int | None) -> TraceError:
        """Return the error for a place, or for the whole log."""
        line, where = self._where(place)
        return TraceError(f"{where}{reason}", file=self.name, line=line)

    def _where(self, place: int | None) -> tuple[int | None, str]:
        if self.reader.unit == "line" or place is None:
            return place, ""
        return None, f"{self.reader.unit} {place}: "

    def reject(self, place: int, reason: str, count: int = 1) -> None:
        """Reject `count` records at a place."""
        self.rejected += count
        if self.first is None:
            self.first = self.error_at(reason, place)
            if self.on_reject is not None:
                self.on_reject(self.first)

    def require(self, columns: Collection[str]) -> None:
        """Raise `TraceError` if a table lacks a needed column."""
        for names in self.needed:
            if not set(names) & set(columns):
                raise self.error_at(f"there is no column {names[0]}, but --key needs it", None)

    @property
    def fault(self) -> TraceError | None:
        """The summary of rejected records, or None."""
        if self.first is None:
            return None
        left_out = f"{self.rejected} {self.reader.unit}{'s' * (self.rejected != 1)} left out"
        return TraceError(f"{self.first.message} ({left_out})", file=self.name, line=self.first.line)

    def is_malformed(self, events: int) -> bool:
        """Whether rejected records are an error, given the number of events."""
        return self.rejected > 0 and not (self.reader.lenient and events)


class BatchTimes(NamedTuple):
    """The values of a time field in each event of a batch that lacks irrelevant ones; None if missing.

    They may have lost digits; `exact` returns that of an event by its place, and `event` the event. `known`
    is for what is derived from them for several trees.
    """

    values: Sequence[Json]
    exact: Callable[[int], Json]
    event: Callable[[int], JsonObject]
    known: dict[object, object]


class Batch(NamedTuple):
    """Consecutive events: the total, and the possibly relevant ones with their places, from 0.

    If a reader keeps fields of all events, `passed` has the places of the others, and `kept` their
    values (or tuples of values), with `msgspec.UNSET` for missing ones. `lines` has the line of each
    event, or is empty. `times` has the times of all events, if a reader was asked for them.
    """

    total: int
    events: Sequence[tuple[int, JsonObject]]
    passed: Sequence[int] = ()
    kept: Sequence[Json] = ()
    lines: Sequence[int | None] = ()
    times: BatchTimes | None = None


class LogReader(ABC):
    """A log format; class attributes describe it.

    >>> from rvaft.readers.registry import reader
    >>> reader("csv").suffixes, reader("csv").unit, reader("syslog").by_lines
    (('.csv', '.tsv'), 'line', True)
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]] = ()
    """The suffixes of files in lower case, before that of a compression."""
    schemes: ClassVar[tuple[str, ...]] = ()
    """The schemes of URLs with live events."""
    unit: ClassVar[str] = "line"
    """The unit of places, which count from 1."""
    takes: ClassVar[frozenset[str]] = frozenset()
    by_lines: ClassVar[bool] = False
    """Whether lines are independent, so that reading can resume anywhere."""
    needs_file: ClassVar[bool] = False
    """Whether the reader needs a file, for random access."""
    lenient: ClassVar[bool] = False

    def __init__(self, options: InputOptions = InputOptions()) -> None:
        self.options = options

    @classmethod
    def suits(cls, path: Path, options: InputOptions) -> bool:  # noqa: ARG003 (for readers that share a suffix)
        """Whether a file seems to have the format; by default, by its suffix."""
        return suffix(path) in cls.suffixes

    @classmethod
    def shown(cls, name: str) -> str:
        """Return a file or URL for messages, without a password."""
        return name

    @abstractmethod
    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json] | None]]:
        """Yield the events with their places, None if irrelevant.

        Call `log.reject` for records that are no events. Raises `TraceError` for an unreadable log,
        and `ToolMissing`.
        """


class LineReader(LogReader):
    """A format of independent lines."""

    by_lines: ClassVar[bool] = True

    @abstractmethod
    def event(self, line: str, log: Log) -> dict[str, Json]:
        """Return the event on a line; raises `ValueError` with the reason."""

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events; invalid UTF-8 becomes backslash escapes."""
        for number, data in lines_of(log.stream, log.name, log.line):
            log.reading = number
            text = data.decode(errors="backslashreplace").rstrip("\r\n")
            if not text.strip():
                continue
            try:
                event = self.event(text, log)
            except ValueError as error:
                log.reject(number, str(error))
            else:
                yield number, event


def lines_of(stream: BinaryIO, file: str, line: int = 1) -> Iterator[tuple[int, bytes]]:
    """Yield lines with their numbers, without a byte order mark."""
    failures = failures_of(file)
    for number in count(line):
        try:
            data = stream.readline(len(BOM) + MAX_LINE + 1)
        except failures as error:
            raise unreadable(error, file, number) from error
        if not data:
            return
        if number == 1:
            data = data.removeprefix(BOM)
        if len(data) > MAX_LINE and len(data.removesuffix(b"\n")) > MAX_LINE:
            raise TraceError(f"the line is longer than {MAX_LINE // 1024**2} MiB", file=file, line=number)
        yield number, data


def suffix(path: Path) -> str:
    """Return the suffix of a file in lower case, before that of a compression.

    >>> suffix(Path("logs/Monday.CSV.gz"))
    '.csv'
    """
    last = path.suffix.lower()
    return Path(path.stem).suffix.lower() if last in SUFFIXES else last


def scheme(name: str) -> str:
    """Return the scheme of a URL in lower case; "" for a file name.

    >>> scheme("MQTT://localhost/doors/#"), scheme("c:/day.csv")
    ('mqtt', '')
    """
    found = _SCHEME.match(name)
    return found[1].lower() if found else ""


def failures_of(file: str) -> tuple[type[Exception], ...]:
    """Return the exceptions of reading such a file."""
    return (OSError, *damage()) if Path(file).suffix.lower() in SUFFIXES else (OSError,)


def unreadable(error: Exception, file: str, line: int | None = None, where: str = "") -> TraceError:
    """Return the error for a log that is unreadable from there on."""
    return TraceError(f"cannot be read: {where}{getattr(error, 'strerror', None) or error}", file=file, line=line)


def expanded(name: str) -> list[str]:
    """Return the files for a name: the file, or, if there is none, those that match the pattern.

    In a pattern `**` matches any folders. Raises `FileNotFoundError` without a match. A URL stands
    for itself.
    """
    if _WILD.isdisjoint(name) or scheme(name) or os.path.lexists(name):
        return [name]
    from glob import iglob  # noqa: PLC0415

    found = sorted(path for path in iglob(name, recursive=True) if not _is_folder(Path(path)))  # noqa: PTH207
    if not found:
        raise FileNotFoundError(errno.ENOENT, "no file matches the pattern", name)
    return found


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not (path / BAG_METADATA).is_file()


BAG_METADATA: Final = "metadata.yaml"
"""Marks a rosbag2 folder."""


def open_log(name: str, usual: str = ".jsonl", within: Path | None = None) -> AbstractContextManager[BinaryIO]:
    """Open a log, decompressed; raises `OSError` and `ToolMissing`.

    The error for a folder suggests a pattern for the logs in it, or for the `usual` suffix.
    """
    if Path(name).is_dir():
        suffixes = Counter(path.suffix for path in sorted(Path(name).iterdir()) if path.suffix and path.is_file())
        usual = suffixes.most_common(1)[0][0] if suffixes and usual == ".jsonl" not in suffixes else usual
        hint = f"'{os.path.join(name, f'*{usual}')}'"  # noqa: PTH118
        raise IsADirectoryError(errno.EISDIR, f"Is a directory; name the logs in it, for example {hint}", name)
    return opened(Path(name), within)


@contextmanager
def source_of(reader: LogReader, name: str, within: Path | None = None) -> Iterator[LogSource]:
    """Open the input of a reader: a stream, a temporary or given file, or a URL.

    With `within`, only a regular file inside that folder. Raises `OSError`, `ToolMissing`, and
    `TraceError` for a damaged compressed file.
    """
    path = Path(name)
    if reader.schemes:
        if scheme(name) not in reader.schemes:
            raise OptionError(f"{name}: {reader.name} is read from a URL that begins with {reader.schemes[0]}://")
        yield name
        return
    given_file = path.suffix.lower() not in SUFFIXES and within is None
    if reader.needs_file and given_file and not _is_folder(path):
        if not path.exists():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        yield path
        return
    with open_log(name, next(iter(reader.suffixes), ""), within) as stream:
        if not reader.needs_file:
            yield stream
            return
        with NamedTemporaryFile(prefix="rvaft-", suffix=suffix(path)) as whole:
            try:
                shutil.copyfileobj(stream, whole)
                whole.flush()
            except failures_of(name) as error:
                raise unreadable(error, name) from error
            yield Path(whole.name)


def required_stream(reader: LogReader, stream: BinaryIO) -> BinaryIO:
    """Return standard input if possible; raises `OptionError`."""
    if reader.needs_file or reader.schemes:
        what = "a URL" if reader.schemes else "a file"
        raise OptionError(f"<stdin>: {reader.name} is read from {what}, not from standard input: name one")
    return stream
