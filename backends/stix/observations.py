"""Events as observed data: property names, times, and the header of a pattern.

STIX reserves `type`, `id` and names that end in `_ref`, `_refs`, `_hex` or `_bin`. A field with
such a name, also followed by underscores, gets one more underscore.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import Any, Final, TypeAlias
from uuid import UUID

from rvaft.errors import LanguageError, OptionError, TraceError
from rvaft.language.parser import parse_time
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import time_text
from rvaft.model.values import Json, at

EVENT: Final = "x-rvaft"
"""The object type of events without a mapping."""
Way: TypeAlias = tuple[str, ...]
"""Field names, outermost first."""

_MEANT: Final = re.compile(r"(type|id|.*(_refs?|_hex|_bin))_*", re.DOTALL)
_PATH: Final = re.compile(r"[a-z][a-z0-9-]*:[a-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_HEADER: Final = re.compile(r"(?:\s*/\*(?!\s*rvaft\b).*?\*/)*\s*/\*\s*rvaft\b(.*?)\*/", re.DOTALL)
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_LAST: Final = 6_000 * 365 * 86_400 * 1_000_000


def property_of(name: str) -> str:
    """Return the property name for a field of an event.

    >>> property_of("user"), property_of("type"), property_of("type_"), property_of("pid_hex")
    ('user', 'type_', 'type__', 'pid_hex_')
    """
    return f"{name}_" if _MEANT.fullmatch(name) else name


@dataclass(frozen=True, slots=True)
class StixHeader:
    """The header of a pattern: the time of events, and the field of each object path.

    `types` maps event types and fields to object paths, for a user mapping only.
    """

    time: EventTime | None = None
    objects: Mapping[str, Way] = field(default_factory=dict)
    types: Mapping[str, Mapping[Way, str]] = field(default_factory=dict)

    @classmethod
    def mapped(cls, mapping: Mapping[str, Any]) -> "StixHeader":
        """Return the header for a user mapping; raises `OptionError`."""
        if not mapping:
            raise OptionError("the mapping is empty, so it lacks every event type")
        types = {name: dict(_fields(below, ())) for name, below in mapping.items()}
        objects: dict[str, Way] = {}
        for name, paths in types.items():
            for way, path in paths.items():
                if objects.setdefault(path, way) != way:
                    both = f"{'.'.join(objects[path])}, {'.'.join(way)}"
                    raise OptionError(f"the mapping has two fields for {path}: {both}")
            if len({path.partition(":")[0] for path in paths.values()}) > 1:
                raise OptionError(f"the mapping of {name} has objects of two types, and an event is one object")
        if inside := [path for path in objects for other in objects if path.startswith(f"{other}.")]:
            raise OptionError(f"the mapping has {inside[0]} inside another mapped field")
        return cls(None, objects, types)

    def path(self, kind: str, way: Way) -> str:
        """Return the object path of a field of an event type; raises `OptionError` if it is
        missing.
        """
        if kind not in self.types:
            raise OptionError(f"the mapping lacks the event type {kind}: map each of its fields to a property")
        if way not in self.types[kind]:
            raise OptionError(f"the mapping of {kind} lacks the field {'.'.join(way)}: map it to a property")
        return self.types[kind][way]

    def __str__(self) -> str:
        content: dict[str, Any] = {} if self.time is None else {"time": time_text(self.time)}
        content |= {"objects": self.objects} if self.objects else {}
        text = json.dumps(content, separators=(",", ":")).replace("/", r"\u002f")
        return f"/* rvaft {text} */ " if content else ""

    @classmethod
    def of(cls, text: str) -> "StixHeader":
        """Return the header of a text, if any; raises `LanguageError`."""
        found = _HEADER.match(text)
        try:
            content = json.loads(found[1]) if found else {}
            objects = {_checked(path): tuple(map(str, way)) for path, way in content.get("objects", {}).items()}
            return cls(parse_time(content["time"]) if "time" in content else None, objects)
        except (ValueError, AttributeError, TypeError) as error:
            reason = error.message if isinstance(error, LanguageError) else str(error)
            raise LanguageError(f"invalid header comment: {reason}", file="<stix>") from None

    @classmethod
    def timed(cls, text: str, time: EventTime) -> str:
        """Return the text with this time in its header, unless it has one."""
        header, found = cls.of(text), _HEADER.match(text)
        rest = text if found is None else text[found.end() :]
        return text if header.time is not None else f"{replace(header, time=time)}{rest}"

    def _times(self, trace: Sequence[Json]) -> list[int]:
        found = [-1]
        for number, event in enumerate(trace):
            time = number * 1_000_000_000 if self.time is None else self.time.read(event)
            if time is None or time % 1_000 or not found[-1] < time // 1_000 < _LAST:
                break
            found.append(time // 1_000)
        return found[1:]

    def left_open(self, trace: Sequence[Json]) -> str:
        """Return why the trace has no verdict, or an empty string."""
        if len(self._times(trace)) < len(trace):
            return "STIX orders events by time, and the times do not increase"
        return self._without_null(trace)

    def _without_null(self, trace: Sequence[Json]) -> str:
        ways = self.objects.values()
        null = (any(at(event, way, ...) is None for way in ways) if ways else _has_null(event) for event in trace)
        return "STIX has no null" if any(null) else ""

    def observations(self, trace: Sequence[Json]) -> list[list[Json]]:
        """Return for each event its observed data and the objects that it refers to.

        Raises `TraceError` if times do not increase.
        """
        times = self._times(trace)
        if len(times) < len(trace):
            reason = (
                "observations are ordered by time: each event needs a time in whole "
                "microseconds that is later than all earlier times"
            )
            raise TraceError(reason, line=None)
        if why := self._without_null(trace):
            raise TraceError(why, line=None)
        found: list[list[Json]] = []
        for number, (event, time) in enumerate(zip(trace, times, strict=True)):
            unique = UUID(int=number)
            some = [{"id": f"{one['type']}--{unique}", **one} for one in self._objects(event)]
            stamp = (_EPOCH + timedelta(microseconds=time)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
            data = {"type": "observed-data", "spec_version": "2.1", "id": f"observed-data--{unique}"}
            data |= dict.fromkeys(("created", "modified", "first_observed", "last_observed"), stamp)
            found.append([data | {"number_observed": 1, "object_refs": [one["id"] for one in some]}, *some])
        return found

    def _objects(self, event: Json) -> list[dict[str, Any]]:
        if not self.objects:
            return [{**_properties(event), "type": EVENT}]
        found: dict[str, dict[str, Any]] = {}
        for path, way in self.objects.items():
            kind, *steps, last = re.split("[:.]", path)
            if (value := at(event, way, ...)) is not ...:
                inner = found.setdefault(kind, {"type": kind})
                for step in steps:
                    inner = inner.setdefault(step, {})
                inner[last] = _properties(value)
        return list(found.values())


def _fields(below: Any, above: Way) -> Iterator[tuple[Way, str]]:
    if not isinstance(below, Mapping):
        yield above, _checked(below)
    else:
        for step, inner in below.items():
            yield from _fields(inner, (*above, step))


def _checked(path: Any) -> str:
    if not isinstance(path, str) or not _PATH.fullmatch(path):
        raise OptionError(f"{path!r} is not an object path such as user-account:account_login")
    if odd := [step for step in re.split("[:.]", path)[1:] if property_of(step) != step]:
        reason = "which STIX reserves: map the field to another property"
        raise OptionError(f"{path} has {odd[0]}, {reason}")
    return path


def _properties(value: Json) -> Any:
    if isinstance(value, Mapping):
        return {property_of(name): _properties(inner) for name, inner in value.items()}
    return [_properties(inner) for inner in value] if isinstance(value, list) else value


def _has_null(value: Json) -> bool:
    inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
    return value is None or any(map(_has_null, inner))
