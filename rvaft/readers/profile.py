"""Profiles: declarations of a product's logs in TOML; `docs/how-to/logs.md` lists the keys."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from rvaft.errors import LanguageError, OptionError
from rvaft.language.parser import parse_time
from rvaft.model.event_time import EventTime
from rvaft.readers.log import PROFILES, SHIPPED, FieldType
from rvaft.readers.text_lines import LinePattern, compiled
from rvaft.support.wording import did_you_mean

_KEYS: Final = {"input": str, "records": str, "time": str, "by": str, "text": str, "where": dict, "pattern": list}
_PATTERN_KEYS: Final = {"match": str, "set": dict, "types": dict, "pairs": str}
_KINDS: Final = {"str": "a text", "dict": "a table", "list": "a list of tables"}


@dataclass(frozen=True, slots=True)
class Profile:
    """The declaration of a product's logs.

    >>> profile("nginx").by, str(profile("nginx").time.format)
    ('event', '"%d/%b/%Y:%H:%M:%S %z"')
    """

    input: str
    records: str | None = None
    time: EventTime | None = None
    by: str | None = None
    text: str | None = None
    where: Mapping[str, re.Pattern[str]] | None = None
    pattern: Sequence[LinePattern] = ()


@lru_cache(maxsize=64)
def profile(name: str) -> Profile:
    """Return a shipped profile, or that of a `.toml` file; raises `OptionError` and `OSError`."""
    if not name.endswith(".toml") and name not in SHIPPED:
        hint = did_you_mean(name, SHIPPED) or "; a profile of your own is a .toml file"
        raise OptionError(f"unknown profile {name}; known: {', '.join(SHIPPED)}{hint}")
    file = Path(name) if name.endswith(".toml") else PROFILES / f"{name}.toml"
    try:
        given = _checked(tomllib.loads(file.read_bytes().decode("utf-8-sig")), _KEYS, "input")
        if "time" in given:
            given["time"] = parse_time(f"time {given['time']}")
        where = given.get("where", {})
        given |= {"where": {one: compiled(where[one], f"where.{one}") for one in where}} if where else {}
        given["pattern"] = [_pattern(number, one) for number, one in enumerate(given.get("pattern", ()), 1)]
        return Profile(**given)
    except LanguageError as error:
        raise OptionError(f"{name}: {error.message}") from None
    except (OptionError, ValueError, RecursionError) as error:
        raise OptionError(f"{name}: {error}") from None


def _checked(found: object, known: Mapping[str, type], needed: str) -> dict[str, Any]:
    """Return a table with known keys of the right types; raises `OptionError`."""
    if not isinstance(found, dict):
        raise OptionError("pattern must be a list of tables")
    for key, value in found.items():
        if key not in known:
            raise OptionError(f"unknown key {key}; known are {', '.join(known)}")
        if not isinstance(value, known[key]):
            raise OptionError(f"{key} must be {_KINDS[known[key].__name__]}")
    if needed not in found:
        raise OptionError(f"the key {needed} is missing")
    return found


def _pattern(number: int, found: object) -> LinePattern:
    try:
        given = _checked(found, _PATTERN_KEYS, "match")
        sets, types = given.get("set", {}), given.get("types", {})
        if wrong := [one for one in sets if not isinstance(sets[one], str | int | float | bool)]:
            raise OptionError(f"set.{wrong[0]} must be a text, a number or a boolean")  # noqa: TRY301
        if wrong := [one for one in types if types[one] not in tuple(FieldType)]:
            raise OptionError(f"types.{wrong[0]} must be one of {', '.join(FieldType)}")  # noqa: TRY301
        kinds = {one: FieldType(types[one]) for one in types}
        return LinePattern.of(given["match"], kinds, sets=sets, pairs=given.get("pairs"))
    except OptionError as error:
        raise OptionError(f"pattern {number}: {error}") from None
