"""The interface of the formats of logs: a reader gives the events of a log in turn, each with its
place, and says what it left out.

Whatever a reader cannot make an event of is *rejected*: counted, told with the place and the reason
of the first, and never an end in silence. Of text that was never meant to be all events (`lenient`)
that is a warning, unless nothing at all fits; of every other format it is an error, after all the
rest was read. What cannot be read on at all (a damaged file) is a `TraceError` after the events
before it.
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
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import count
from math import isfinite
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import BinaryIO, ClassVar, Final, Self, TypeAlias

from rvaft.core.classifier import Scope, TreeReads
from rvaft.errors import OptionError, TraceError
from rvaft.model.patterns import ObjectPattern
from rvaft.model.values import NUMBER, Json, decimal
from rvaft.support.files import SUFFIXES, damage, opened

MAX_LINE: Final = 64 * 1024 * 1024
"""The longest line, in bytes: a log without line ends is refused before it fills the memory."""
MAX_DIGITS: Final = 4300
"""The longest integer; reading one takes time quadratic in its length."""
BOM: Final = b"\xef\xbb\xbf"
"""What may stand before the first line."""

Source: TypeAlias = str | os.PathLike[str] | BinaryIO
LogSource: TypeAlias = Path | BinaryIO | str
"""What a reader reads: a file, a stream or a URL."""
_SCHEME: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_WILD: Final = frozenset("*?[")


class FieldType(StrEnum):
    """What the text in a field of a table stands for."""

    NUMBER = "number"
    TEXT = "text"
    BOOL = "bool"

    def value_of(self, text: str) -> Json:
        """What a text stands for; raises `ValueError` for one that stands for nothing of the type.

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
    """The number that a text is by the grammar of JSON, if a double has room for it, or else the text.

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


@dataclass(frozen=True, slots=True)
class InputOptions:
    """What is said of a log beside its format, each for the readers that take it; None, or no type,
    where nothing is said.

    `records` is the dotted path to the list of events in a JSON document, `types` says what the
    text of fields stands for, `pattern` is a regular expression with named groups.
    """

    records: str | None = None
    types: Mapping[str, FieldType] = field(default_factory=dict)
    pattern: str | None = None

    @property
    def given(self) -> frozenset[str]:
        """The names of those that are said."""
        return frozenset(name for name in ("records", "types", "pattern") if getattr(self, name))

    def only(self, names: Collection[str]) -> "InputOptions":
        """Those of these names."""
        return replace(InputOptions(), **{name: getattr(self, name) for name in self.given & set(names)})


@dataclass(frozen=True, slots=True)
class Interest:
    """What is looked at: these `fields` of an event, or all of it where None; so a reader may leave out the others.

    `may_be(field, value)` says whether an event that has this text in this field may be of interest
    at all. One that cannot be is only counted, so a reader may give None in its place.
    """

    fields: frozenset[str] | None = None
    may_be: Callable[[str, str], bool] = lambda _field, _value: True

    @classmethod
    def of(cls, reads: Scope, also: Iterable[str]) -> Self:
        """What a tree looks at, and fields that are told of its events; everything, where it is not
        only fields of objects.

        >>> import rvaft
        >>> from rvaft.core.classifier import TreeReads
        >>> sorted(Interest.of(TreeReads(rvaft.loads("top or a b;")), ["time"]).fields)
        ['event', 'time']
        """
        patterns = reads.patterns if isinstance(reads, TreeReads) else ()
        objects = [pattern for pattern in patterns if isinstance(pattern, ObjectPattern)]
        if not objects or len(objects) < len(patterns):
            return cls()
        return cls(frozenset([*also, *(name for one in objects for name, _ in one.fields)]))


ALL: Final = Interest()
"""Everything is looked at."""


@dataclass(frozen=True, slots=True)
class Live:
    """How events are waited for that come by themselves: until `stop` says so; `began` is told that
    they may come now, `warn` what may have been missed.
    """

    stop: Callable[[], bool] = lambda: False
    began: Callable[[], object] = lambda: None
    warn: Callable[[str], object] = warnings.warn


@dataclass(slots=True)
class Log:
    r"""A log that is read: by which reader, from what, and what came of it so far.

    `source` is a stream of bytes, or, for a reader that `needs_file`, the path of one, or, for one
    of URLs, the URL; `name` stands for it in messages. `line` is the number of the first line,
    where a stream begins later than its file. Of each of the `needed` tuples one is a field that
    events must have. `reading` is the line that is looked at. `rejected` counts what was left out;
    `first` is the error for the first of it, which is `told` at once where somebody wants to know.

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
    told: Callable[[TraceError], object] | None = None
    live: Live = field(default_factory=Live)

    @property
    def stream(self) -> BinaryIO:
        """The bytes that are read."""
        assert not isinstance(self.source, (Path, str)), "a reader that needs a file is given one"
        return self.source

    @property
    def path(self) -> Path:
        """The file that is read."""
        assert isinstance(self.source, Path), "a reader that needs no file is given a stream"
        return self.source

    @property
    def url(self) -> str:
        """Where the events come from."""
        assert isinstance(self.source, str), "only a reader of URLs is given one"
        return self.source

    def events(self) -> Iterator[dict[str, Json] | None]:
        """The events in turn, None for each that is of no interest.

        Raises `TraceError` where the log cannot be read on, and `ToolMissing`.
        """
        failures = failures_of(self.name)
        try:
            for place, event in self.reader.events(self):
                self.place = place
                self.given += 1
                yield event
        except failures as error:
            raise unreadable(error, self.name, *self._where(self.place + 1)) from error

    def error_at(self, reason: str, place: int | None) -> TraceError:
        """The error for something at a place, or for the whole log."""
        line, where = self._where(place)
        return TraceError(f"{where}{reason}", file=self.name, line=line)

    def _where(self, place: int | None) -> tuple[int | None, str]:
        """The line that a place is, and what an error says of one that is none."""
        if self.reader.unit == "line" or place is None:
            return place, ""
        return None, f"{self.reader.unit} {place}: "

    def reject(self, place: int, reason: str, count: int = 1) -> None:
        """Count what is at a place, so many units of it, and is no event."""
        self.rejected += count
        if self.first is None:
            self.first = self.error_at(reason, place)
            if self.told is not None:
                self.told(self.first)

    def require(self, columns: Collection[str]) -> None:
        """Raise `TraceError` for a table of these columns in which no event has what is needed."""
        for names in self.needed:
            if not set(names) & set(columns):
                raise self.error_at(f"there is no column {names[0]}, so nothing can be told apart by it", None)

    @property
    def fault(self) -> TraceError | None:
        """What was left out, as one error, or None for nothing."""
        if self.first is None:
            return None
        left_out = f"{self.rejected} {self.reader.unit}{'s' * (self.rejected != 1)} left out"
        return TraceError(f"{self.first.message} ({left_out})", file=self.name, line=self.first.line)

    def is_malformed(self, events: int) -> bool:
        """Whether what was left out is an error, of a log that has given so many events, and not
        what is to be expected.
        """
        return self.rejected > 0 and not (self.reader.lenient and events)


class LogReader(ABC):
    """One format of logs. What it can do is said by class attributes, which are looked at before anything is read.

    >>> from rvaft.readers.registry import reader
    >>> reader("csv").suffixes, reader("csv").unit, reader("syslog").by_lines
    (('.csv', '.tsv'), 'line', True)
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]] = ()
    """Of its files, in small letters; behind each may stand that of a compression."""
    schemes: ClassVar[tuple[str, ...]] = ()
    """Of URLs that it reads in place of files: events that come by themselves, until somebody asks for the end."""
    unit: ClassVar[str] = "line"
    """What is counted: an event's place is the number of one, from 1."""
    takes: ClassVar[frozenset[str]] = frozenset()
    """The names of the `InputOptions` that it knows."""
    by_lines: ClassVar[bool] = False
    """Whether every line stands for itself: then a log can be followed as it grows, and be read on from any line."""
    needs_file: ClassVar[bool] = False
    """Whether it reads a file from several places, so that a stream will not do."""
    lenient: ClassVar[bool] = False
    """Whether what it rejects is to be expected."""

    def __init__(self, options: InputOptions = InputOptions()) -> None:
        """Raises `OptionError` for options that make no sense."""
        self.options = options

    @classmethod
    def suits(cls, path: Path, options: InputOptions) -> bool:  # noqa: ARG003 (for readers that share a suffix)
        """Whether that file looks like one of the format: by its suffix, unless more is known."""
        return suffix(path) in cls.suffixes

    @classmethod
    def shown(cls, name: str) -> str:
        """What stands for a file or URL in messages: of a URL not the password."""
        return name

    @abstractmethod
    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json] | None]]:
        """The events of the log in turn, each with its place, and None in place of one that is of
        no interest to the log.

        What is no event goes to `log.reject`. Raises `TraceError` (`log.error_at` makes one) for a
        log that cannot be read on, and `ToolMissing`.
        """


class LineReader(LogReader):
    """A format in which every line stands for itself."""

    by_lines: ClassVar[bool] = True

    @abstractmethod
    def event(self, line: str, log: Log) -> dict[str, Json]:
        """The event on a line, which is not blank; raises `ValueError` with the reason for what is none."""

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """The events of all lines; bytes that are no UTF-8 become escapes of their numbers."""
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
    """The lines of a stream with their numbers, without a byte order mark.

    Raises `TraceError` where the file cannot be read on, and for a line without end.
    """
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


# -- files that are logs -----------------------------------------------------------------------------------------------


def suffix(path: Path) -> str:
    """The suffix of a file, in small letters, without that of a compression.

    >>> suffix(Path("logs/Monday.CSV.gz"))
    '.csv'
    """
    last = path.suffix.lower()
    return Path(path.stem).suffix.lower() if last in SUFFIXES else last


def scheme(name: str) -> str:
    """The scheme of a URL, in small letters; nothing for the name of a file.

    >>> scheme("MQTT://localhost/doors/#"), scheme("c:/day.csv")
    ('mqtt', '')
    """
    found = _SCHEME.match(name)
    return found[1].lower() if found else ""


def failures_of(file: str) -> tuple[type[Exception], ...]:
    """What reading from a file of that name may raise that is not the reader's fault."""
    return (OSError, *damage()) if Path(file).suffix.lower() in SUFFIXES else (OSError,)


def unreadable(error: Exception, file: str, line: int | None = None, where: str = "") -> TraceError:
    """A trace that cannot be read from that line on, or from a place that is no line."""
    return TraceError(f"cannot be read: {where}{getattr(error, 'strerror', None) or error}", file=file, line=line)


def expanded(name: str) -> list[str]:
    """The files that a name stands for: itself, or, where there is no such file, those that match it as a pattern.

    In a pattern `**` stands for any folders, none included. Raises `FileNotFoundError` where
    nothing matches. A URL stands for itself.
    """
    if _WILD.isdisjoint(name) or scheme(name) or os.path.lexists(name):
        return [name]
    from glob import iglob  # noqa: PLC0415 -- imported on use

    found = sorted(path for path in iglob(name, recursive=True) if not _is_folder(Path(path)))  # noqa: PTH207
    if not found:
        raise FileNotFoundError(errno.ENOENT, "no file matches the pattern", name)
    return found


def _is_folder(path: Path) -> bool:
    """Whether it is a folder, and not a recording that consists of several files."""
    return path.is_dir() and not (path / BAG_METADATA).is_file()


BAG_METADATA: Final = "metadata.yaml"
"""The file that makes a folder a recording of ROS 2."""


def open_log(name: str, usual: str = ".jsonl") -> AbstractContextManager[BinaryIO]:
    """The bytes of a log, decompressed; raises `OSError` and `ToolMissing`.

    Of a folder it is said which logs are in it, or else that those with the `usual` suffix may be.
    """
    if Path(name).is_dir():
        suffixes = Counter(path.suffix for path in sorted(Path(name).iterdir()) if path.suffix and path.is_file())
        usual = suffixes.most_common(1)[0][0] if suffixes and usual == ".jsonl" not in suffixes else usual
        hint = f"'{os.path.join(name, f'*{usual}')}'"  # noqa: PTH118 (as typed)
        raise IsADirectoryError(errno.EISDIR, f"Is a directory; name the logs in it, for example {hint}", name)
    return opened(Path(name))


@contextmanager
def source_of(reader: LogReader, name: str) -> Iterator[LogSource]:
    """What a reader is to read of a file: its bytes, decompressed, or, if it needs one, a file with
    them; a URL as it is.

    Raises `OSError`, `ToolMissing`, and `TraceError` for a compressed file that is damaged.
    """
    path = Path(name)
    if reader.schemes:
        if scheme(name) not in reader.schemes:
            raise OptionError(f"{name}: {reader.name} is read from a URL that begins with {reader.schemes[0]}://")
        yield name
        return
    if reader.needs_file and path.suffix.lower() not in SUFFIXES and not _is_folder(path):
        if not path.exists():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        yield path
        return
    with open_log(name, next(iter(reader.suffixes), "")) as stream:
        if not reader.needs_file:
            yield stream
            return
        with NamedTemporaryFile(prefix="rvaft-", suffix=Path(path.stem).suffix) as whole:
            try:
                shutil.copyfileobj(stream, whole)
                whole.flush()
            except failures_of(name) as error:
                raise unreadable(error, name) from error
            yield Path(whole.name)


def required_stream(reader: LogReader, stream: BinaryIO) -> BinaryIO:
    """Standard input, which the reader has to be able to read; raises `OptionError`."""
    if reader.needs_file or reader.schemes:
        what = "a URL" if reader.schemes else "a file"
        raise OptionError(f"<stdin>: {reader.name} is read from {what}, not from standard input: name one")
    return stream
