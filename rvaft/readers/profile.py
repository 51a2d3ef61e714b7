"""Profiles: declarations of a product's logs in TOML, shipped or of the user.

| key | value |
| --- | --- |
| `input` | the format of the log, or `text` |
| `records` | as `--records` |
| `time`, `by` | the time, as the language of trees declares it; the field with the kind of an event |
| `text` | for `syslog`: the field that the patterns search, by default `message` |
| `where` | for `syslog`: patterns that whole fields must match |
| `pattern` | for `text` and `syslog`: tables, tried in order, with `match`, `set`, `types` and `pairs` |
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from rvaft.errors import LanguageError, OptionError
from rvaft.language.parser import parse_time
from rvaft.model.event_time import EventTime
from rvaft.readers.log import FieldType, InputOptions, LineReader, LogReader
from rvaft.readers.registry import reader
from rvaft.readers.text_lines import LinePattern, PatternReader
from rvaft.rules.rule import did_you_mean

_FOLDER: Final = files("rvaft.readers").joinpath("profiles")
_KEYS: Final[Mapping[str, type]] = {
    **dict.fromkeys(("input", "records", "time", "by", "text"), str),
    "where": dict,
    "pattern": list,
}
_PATTERN_KEYS: Final[Mapping[str, type]] = {"match": str, "set": dict, "types": dict, "pairs": str}
_KINDS: Final = {"str": "a text", "dict": "a table", "list": "a list of tables"}
_TEXT: Final = "text"


@dataclass(frozen=True, slots=True)
class Profile:
    """The declaration of a product's logs.

    >>> profile("nginx").by, str(profile("nginx").time.format)
    ('event', '"%d/%b/%Y:%H:%M:%S %z"')
    """

    input: str
    records: str | None
    time: EventTime | None
    by: str | None
    text: str
    where: Mapping[str, re.Pattern[str]]
    patterns: Sequence[LinePattern]

    def reader(self, year: int | None = None) -> LogReader:
        """Return a reader; raises `UnknownFormat`, `ToolFailed` and `OptionError`."""
        options = InputOptions(self.records, year=year)
        if self.input == _TEXT:
            return PatternReader(self.patterns, options)
        base = reader(self.input, options)
        if not self.patterns:
            return base
        if not isinstance(base, LineReader) or base.options.pattern:
            raise OptionError(f"patterns need the input text or syslog, not {self.input}")
        return PatternReader(self.patterns, options, base=base, text=self.text, where=self.where)


def shipped() -> list[str]:
    """Return the names of the shipped profiles.

    >>> "sshd" in shipped()
    True
    """
    return sorted(one.name.removesuffix(".toml") for one in _FOLDER.iterdir() if one.name.endswith(".toml"))


@lru_cache(maxsize=64)
def profile(name: str) -> Profile:
    """Return a shipped profile, or that of a `.toml` file; raises `OptionError` and `OSError`."""
    if name.endswith(".toml"):
        data = Path(name).read_bytes()
    elif name in (known := shipped()):
        data = _FOLDER.joinpath(f"{name}.toml").read_bytes()
    else:
        hint = did_you_mean(name, known) or "; a profile of your own is a .toml file"
        raise OptionError(f"unknown profile {name}; known: {', '.join(known)}{hint}")
    try:
        return _profile(tomllib.loads(data.decode("utf-8-sig")))
    except (OptionError, LanguageError, ValueError, RecursionError) as error:
        reason = error.message if isinstance(error, LanguageError) else str(error)
        raise OptionError(f"{name}: not a profile: {reason}") from None


def _checked(found: Mapping[str, Any], known: Mapping[str, type]) -> Mapping[str, Any]:
    """Return a table without unknown keys and wrong types; raises `OptionError`."""
    for key, value in found.items():
        if key not in known:
            raise OptionError(f"unknown key {key}; known are {', '.join(known)}{did_you_mean(key, known)}")
        if not isinstance(value, known[key]):
            raise OptionError(f"{key} must be {_KINDS[known[key].__name__]}")
    return found


def _profile(found: Mapping[str, Any]) -> Profile:
    given = _checked(found, _KEYS)
    if "input" not in given:
        raise OptionError("`input` is missing: name the format of the log, or text")
    patterns = [_pattern(number, one) for number, one in enumerate(given.get("pattern", ()), 1)]
    if given["input"] == _TEXT and not patterns:
        raise OptionError("the input text needs a table [[pattern]]")
    if not patterns and (unused := given.keys() & {"text", "where"}):
        raise OptionError(f"`{min(unused)}` needs a table [[pattern]]")
    if given["input"] == _TEXT and (unused := given.keys() & {"text", "where"}):
        raise OptionError(f"`{min(unused)}` is for the input syslog")
    where = {}
    for name, text in given.get("where", {}).items():
        where[name] = _compiled(f"where.{name}", text)
    time = None if "time" not in given else parse_time(f"time {given['time']}")
    made = Profile(
        given["input"], given.get("records"), time, given.get("by"), given.get("text", "message"), where, patterns
    )
    made.reader()  # names what is wrong
    return made


def _compiled(name: str, text: object) -> re.Pattern[str]:
    if not isinstance(text, str):
        raise OptionError(f"{name} must be a text")
    try:
        return re.compile(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise OptionError(f"{name} is not a regular expression: {error}") from None


def _pattern(number: int, found: object) -> LinePattern:
    if not isinstance(found, dict):
        raise OptionError("pattern must be a list of tables")
    try:
        given = _checked(found, _PATTERN_KEYS)
        if "match" not in given:
            raise OptionError("`match` is missing: the regular expression")  # noqa: TRY301
        for name, value in given.get("set", {}).items():
            if not isinstance(value, str | int | float | bool):
                raise OptionError(f"set.{name} must be a text, a number or a boolean")  # noqa: TRY301
        types: dict[str, FieldType] = {}
        for name, kind in given.get("types", {}).items():
            if kind not in tuple(FieldType):
                raise OptionError(f"types.{name} must be one of {', '.join(FieldType)}")  # noqa: TRY301
            types[name] = FieldType(kind)
        return LinePattern.of(given["match"], types, sets=given.get("set"), pairs=given.get("pairs"))
    except OptionError as error:
        raise OptionError(f"pattern {number}: {error}") from None
