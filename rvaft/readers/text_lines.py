"""Text logs whose lines are parsed by regular expressions: syslog, and patterns of the user.

Lines that do not match are counted and reported as a warning, unless no line matches.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any, ClassVar, Final, Self

from rvaft.errors import OptionError
from rvaft.model.values import Json
from rvaft.readers.json_lines import settled
from rvaft.readers.log import FieldType, InputOptions, LineReader, Log, by_content
from rvaft.support.budget import Expired, looking

_PATIENCE: Final = 1.0
_FACILITIES: Final = (
    *("kern", "user", "mail", "daemon", "auth", "syslog", "lpr", "news", "uucp", "cron", "authpriv", "ftp"),
    *("ntp", "security", "console", "solaris-cron", *(f"local{number}" for number in range(8))),
)
_SEVERITIES: Final = ("emerg", "alert", "crit", "err", "warning", "notice", "info", "debug")
_MONTHS: Final = {"JanFebMarAprMayJunJulAugSepOctNovDec"[3 * n : 3 * n + 3]: n + 1 for n in range(12)}
_STAMP: Final = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?(?:Z|[+-]\d\d:\d\d)"
_VALUE: Final = r'"(?:[^"\\\]]|\\.)*"'
_PARAMETER: Final = re.compile(rf'([^\s="\]]+)=({_VALUE})')
_ELEMENT: Final = re.compile(rf'\[([^\s="\]]+)((?: +[^\s="\]]+={_VALUE})*) *\]')
_ESCAPED: Final = re.compile(r'\\(["\\\]])')
_RFC5424: Final = re.compile(
    rf"<(?P<priority>\d{{1,3}})>1 (?P<time>-|{_STAMP}) (?P<host>\S+) (?P<app>\S+) (?P<pid>\S+) (?P<id>\S+)"
    rf' (?P<data>-|(?:\[[^\s="\]]+(?: +[^\s="\]]+={_VALUE})* *\])+)(?: \ufeff?(?P<message>.*))?',
    re.DOTALL,
)
_RFC3164: Final = re.compile(
    rf"(?:<(?P<priority>\d{{1,3}})>)?(?:(?P<time>{_STAMP})|(?P<month>{'|'.join(_MONTHS)}) (?P<day>[ 0-3]?\d)"
    r" (?P<clock>[0-2]\d:[0-5]\d:[0-6]\d)) (?P<host>\S+)"
    r" (?:(?P<app>[^\s\[\]:]+)(?:\[(?P<pid>[^\]\s]*)\])?: ?)?(?P<message>.*)",
    re.DOTALL,
)


class SyslogReader(LineReader):
    """Syslog lines (RFC 5424, and RFC 3164 as in files), with or without a priority.

    A time without a year is of `year`, or of the latest year that is not after the file's date; it has no zone.

    >>> import io
    >>> lines = b"<38>1 2026-03-02T08:00:00Z web1 sshd 812 - - Accepted password for deploy"
    >>> next(Log(SyslogReader(), io.BytesIO(lines), "auth.log").events())["message"]
    'Accepted password for deploy'
    """

    name: ClassVar[str] = "syslog"
    suffixes: ClassVar[tuple[str, ...]] = (".syslog",)
    lenient: ClassVar[bool] = True

    def event(self, line: str, log: Log) -> dict[str, Json]:
        """Return the event on a line."""
        found = _RFC5424.fullmatch(line) or _RFC3164.fullmatch(line)
        if found is None:
            raise ValueError("not a syslog line")
        groups = {name: text for name, text in found.groupdict().items() if text is not None}
        event: dict[str, Json] = {}
        new = "data" in groups
        if "month" in groups:
            month, day, year = _MONTHS[groups["month"]], int(groups["day"]), self.options.year
            groups["time"] = f"{_latest(month, day, _written(log)) if year is None else date(year, month, day)}"
            groups["time"] += f"T{groups['clock']}"
        for name in ("time", "host", "app", "pid", "id", "message"):
            if name in groups and not (new and name != "message" and groups[name] == "-"):
                event[name] = by_content(groups[name]) if name == "pid" else groups[name]
        if "priority" in groups:
            facility, severity = divmod(int(groups["priority"]), len(_SEVERITIES))
            if facility >= len(_FACILITIES):
                raise ValueError("not a syslog priority")
            event |= {"severity": _SEVERITIES[severity], "facility": _FACILITIES[facility]}
        if groups.get("data", "-") != "-":
            elements = list(_ELEMENT.finditer(groups["data"]))
            event["data"] = {element[1]: _parameters(element[2]) for element in elements}
            if len(event["data"]) < len(elements):
                raise ValueError("invalid structured data: an element is repeated")
        return event


def _parameters(text: str) -> Json:
    return _collected((name, _ESCAPED.sub(r"\1", value[1:-1])) for name, value in _PARAMETER.findall(text))


def _collected(pairs: Iterable[tuple[str, Json]]) -> dict[str, Json]:
    """Return pairs as an object; the values of a repeated name are a list."""
    found: dict[str, list[Json]] = {}
    for name, value in pairs:
        found.setdefault(name, []).append(value)
    return {name: values if len(values) > 1 else values[0] for name, values in found.items()}


def _written(log: Log) -> date:
    """Return the day after the last change of the log, or after today."""
    last = datetime.now(tz=UTC)
    with suppress(OSError, ValueError):
        if Path(log.name).is_file():
            last = datetime.fromtimestamp(Path(log.name).stat().st_mtime, tz=UTC)
    return last.date() + timedelta(days=1)


def _latest(month: int, day: int, last: date) -> date:
    for year in range(last.year, last.year - 9, -1):
        with suppress(ValueError):
            if (found := date(year, month, day)) <= last:
                return found
    raise ValueError("the date does not exist")


@dataclass(frozen=True, slots=True)
class LinePattern:
    r"""A regular expression that is searched in a text; its named groups are the fields.

    `sets` are constant fields. The group `pairs` is no field but has fields itself, `key=value`.

    >>> pattern = LinePattern.of(r"door (?P<door>\d+): (?P<rest>.*)", {"door": FieldType.NUMBER}, pairs="rest")
    >>> pattern.event('door 7: by="bob" ok=yes')
    {'by': 'bob', 'ok': 'yes', 'door': 7}
    """

    search: Callable[[str], re.Match[str] | None]
    types: Mapping[str, FieldType]
    plain: Callable[[str], Json] = str
    """The conversion of fields without a type."""
    sets: Mapping[str, Json] = field(default_factory=dict)
    pairs: str | None = None

    @classmethod
    def of(
        cls,
        text: str,
        types: Mapping[str, FieldType],
        plain: Callable[[str], Json] = str,
        sets: Mapping[str, Json] | None = None,
        pairs: str | None = None,
    ) -> Self:
        """Return the pattern of a text; raises `OptionError`."""
        found = compiled(text, "the pattern")
        groups = found.groupindex
        if not groups and not sets:
            raise OptionError("the pattern has no named groups, which are the fields: write (?P<user>...)")
        for name in types if pairs is None else ():
            if name not in groups:
                raise OptionError(f"the pattern has no group {name}, but a type is given for it")
        if pairs is not None and pairs not in groups:
            raise OptionError(f"the pattern has no group {pairs}, which `pairs` names")
        return cls(found.search, types, plain, sets or {}, pairs)

    def event(self, text: str) -> dict[str, Json] | None:
        """Return the fields in a text, or None without a match; raises `ValueError` for a wrong type."""
        found = self.search(text)
        if found is None:
            return None
        texts: dict[str, Any] = {name: value for name, value in found.groupdict().items() if value is not None}
        if self.pairs is not None:
            texts = _collected(_pairs(texts.pop(self.pairs, ""))) | texts
        event: dict[str, Json] = dict(self.sets)
        for name, value in texts.items():
            try:
                event[name] = self._value(name, value)
            except ValueError as error:
                raise ValueError(f"the field {name} is {error}") from None
        return event

    def _value(self, name: str, value: Any) -> Json:
        if isinstance(value, list):
            return [self._value(name, one) for one in value]
        return self.plain(value) if (kind := self.types.get(name)) is None else kind.value_of(value)


def compiled(text: object, name: str) -> re.Pattern[str]:
    """Return a regular expression; raises `OptionError` with its name."""
    try:
        return re.compile(text if isinstance(text, str) else "(?")
    except (re.error, OverflowError, RecursionError) as error:
        raise OptionError(f"{name} is not a regular expression: {error}") from error


_PAIR: Final = re.compile(r"""([^\s=,;"']+)=(?:"([^"]*)"|'([^']*)'|([^\s,;]*))""")


def _pairs(text: str) -> Iterator[tuple[str, str]]:
    """Yield `key=value` pairs, also those in single quotes, as auditd nests them."""
    for name, quoted, nested, plain in _PAIR.findall(text):
        if nested and _PAIR.search(nested):
            yield from _pairs(nested)
        else:
            yield name, quoted or nested or plain


class PatternReader(LineReader):
    """Lines that match one of several patterns, tried in order.

    The patterns are searched in the whole line or, on top of `base`, in one `text` field of its event, which
    they replace. The fields in `where` must match their patterns.
    """

    name: ClassVar[str] = "profile"
    lenient: ClassVar[bool] = True

    def __init__(
        self,
        patterns: Sequence[LinePattern],
        options: InputOptions = InputOptions(),  # noqa: B008
        *,
        base: LineReader | None = None,
        text: str = "message",
        where: Mapping[str, re.Pattern[str]] | None = None,
    ) -> None:
        super().__init__(options)
        self._patterns, self._base, self._text, self._where = patterns, base, text, where or {}
        self._searched = self._before = ""

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events; raises `TraceError` if the patterns take too long."""
        with looking(self._look, _PATIENCE):
            try:
                yield from super().events(log)
            except Expired:
                most = f"the pattern takes more than {_PATIENCE:g} s on this line: avoid nested repetition"
                raise log.error_at(most, log.reading) from None

    def _look(self) -> None:
        if self._searched and self._searched is self._before:
            raise Expired
        self._before = self._searched

    def event(self, line: str, log: Log) -> dict[str, Json]:
        """Return the fields of the first pattern that matches, with those of the base."""
        event = {} if self._base is None else self._base.event(line, log)
        for name, wanted in self._where.items():
            if not wanted.fullmatch(str(event.get(name, ""))):
                raise ValueError(f"the field {name} does not match the profile")
        text = line if self._base is None else event.pop(self._text, None)
        self._searched = text if isinstance(text, str) else ""
        found = next((one for each in self._patterns if (one := each.event(self._searched)) is not None), None)
        self._searched = ""
        if found is None:
            raise ValueError("the pattern does not match" if len(self._patterns) == 1 else "no pattern matches")
        return settled({**event, **found}, log)


class RegexReader(PatternReader):
    r"""Lines that match a regular expression; its named groups are the fields.

    >>> import io
    >>> options = InputOptions(pattern=r"(?P<user>\w+) logs (?P<event>in|out)")
    >>> next(Log(RegexReader(options), io.BytesIO(b"08:15 bob logs in"), "door.log").events())
    {'user': 'bob', 'event': 'in'}
    """

    name: ClassVar[str] = "regex"
    takes: ClassVar[frozenset[str]] = frozenset({"pattern", "types"})

    def __init__(self, options: InputOptions = InputOptions()) -> None:  # noqa: B008
        if options.pattern is None:
            raise OptionError("the format regex needs a pattern with named groups: --pattern '(?P<user>...) ...'")
        super().__init__([LinePattern.of(options.pattern, options.types, by_content)], options)
