"""Running a pattern: events become observed data, and stix2-matcher says whether a pattern matches them all.

It is asked about a whole trace, then about beginnings of it by halves: what matches some observations matches them with others beside.
"""

import json
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Any, Final
from uuid import UUID

from backends.stix.objects import EVENT, StixHeader, property_of
from rvaft.errors import LanguageError, TooLarge, TraceError, installed
from rvaft.language.diagnostics import error_at
from rvaft.model.values import Json, at
from rvaft.monitors import DetectionMonitor

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_LAST: Final = 6_000 * 365 * 86_400 * 1_000_000
_WHERE: Final = re.compile(r"(\d+):(\d+): (.*)", re.DOTALL)
_MOST_KNOWN: Final = 5_000
_TOO_DEEP: Final = "expressions in each other for the parser of stix2-matcher"


class StixMonitor(DetectionMonitor):
    """A pattern on a trace; raises `LanguageError`, `ToolMissing`, and `TooLarge` where it is too deep for stix2-matcher."""

    def __init__(self, text: str) -> None:
        program = _StixProgram(text)
        super().__init__(lambda traces: [program.first(trace) for trace in traces], program.left_open)


@lru_cache(maxsize=32)
class _StixProgram:
    """A pattern that is compiled, and what it said of some traces; monitors of one text share it."""

    def __init__(self, text: str) -> None:
        self._known: dict[str, int | None] = {}
        self._header = StixHeader.of(text)
        matcher, exceptions = (installed(name, "stix2-matcher", "pip install '.[stix]'") for name in _MODULES)
        try:
            self._pattern = matcher.Pattern(text, "2.1")
            self._matches([])
        except exceptions.ParseException as error:
            found = _WHERE.match(str(error))
            line, column, message = (int(found[1]), int(found[2]), found[3]) if found else (1, 0, str(error))
            start = sum(map(len, text.splitlines(keepends=True)[: line - 1])) + column
            raise error_at(
                f"no STIX pattern: {' '.join(message.split())}", text, min(start, len(text)), "<stix>"
            ) from None
        except RecursionError:
            raise TooLarge(_TOO_DEEP, limit=250) from None
        except Exception as error:  # noqa: BLE001 -- literals are looked into by the matcher, in many ways
            raise LanguageError(f"no STIX pattern: {' '.join(str(error).split())}", file="<stix>") from None

    def _matches(self, objects: Sequence[Json]) -> bool:
        return bool(self._pattern.match([{"type": "bundle", "id": "bundle--0", "objects": [*objects]}]))

    def left_open(self, trace: Sequence[Json]) -> str:
        """Why the language says nothing of a trace, if that is so."""
        return "STIX orders by times, which have to increase" if times_of(self._header, trace) is None else ""

    def first(self, trace: Sequence[Json]) -> int | None:
        """The number of the event with which the pattern first matches; raises `TraceError` where its language leaves that open."""
        written = json.dumps(trace)
        if written not in self._known:
            if len(self._known) > _MOST_KNOWN:
                self._known.clear()
            self._known[written] = self._first(trace)
        return self._known[written]

    def _first(self, trace: Sequence[Json]) -> int | None:
        observed = observations(self._header, trace)
        low, high = 0, len(trace)
        try:
            if not trace or not self._matches([one for some in observed for one in some]):
                return None
            while high - low > 1:  # no match in the first `low` events, one in the first `high`
                middle = (low + high) // 2
                found = self._matches([one for some in observed[:middle] for one in some])
                low, high = (low, middle) if found else (middle, high)
        except RecursionError:
            raise TooLarge(_TOO_DEEP, limit=250) from None
        return high


_MODULES: Final = ("stix2matcher.matcher", "stix2patterns.exceptions")


def times_of(header: StixHeader, trace: Sequence[Json]) -> list[int] | None:
    """When the events are observed, in microseconds; None where that would not be in their order."""
    if header.time is None:
        return [number * 1_000_000 for number in range(len(trace))]
    found = [-1]
    for time in map(header.time.read, trace):
        if time is None or time % 1_000 or not found[-1] < time // 1_000 < _LAST:
            return None
        found.append(time // 1_000)
    return found[1:]


def observations(header: StixHeader, trace: Sequence[Json]) -> list[list[dict[str, Json]]]:
    """Of each event its observed data, with the objects that this refers to; raises `TraceError` where times do not increase."""
    times = times_of(header, trace)
    if times is None:
        reason = "observations are in the order of their times: each event needs one, of whole microseconds, later than those before"
        raise TraceError(reason, line=None)
    found: list[list[dict[str, Json]]] = []
    for number, (event, time) in enumerate(zip(trace, times, strict=True)):
        unique = UUID(int=number)
        some = [{"id": f"{one['type']}--{unique}", **one} for one in _objects(header, event)]
        stamp = (_EPOCH + timedelta(microseconds=time)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        data = {"type": "observed-data", "spec_version": "2.1", "id": f"observed-data--{unique}", "number_observed": 1}
        data |= dict.fromkeys(("created", "modified", "first_observed", "last_observed"), stamp)
        data["object_refs"] = [one["id"] for one in some]
        found.append([data, *some])
    return found


def _objects(header: StixHeader, event: Json) -> list[dict[str, Json]]:
    """The objects of an observation."""
    if not header.objects:
        return [{**_properties(event), "type": EVENT}]
    found: dict[str, dict[str, Json]] = {}
    for path, way in header.objects.items():
        kind, *steps, last = re.split("[:.]", path)
        if (value := at(event, way, ...)) is not ...:
            inner = found.setdefault(kind, {"type": kind})
            for step in steps:
                inner = inner.setdefault(step, {})
            inner[last] = _properties(value)
    return list(found.values())


def _properties(value: Json) -> Any:
    """A value with its fields named as properties are."""
    if isinstance(value, Mapping):
        return {property_of(name): _properties(inner) for name, inner in value.items()}
    return [_properties(inner) for inner in value] if isinstance(value, list) else value
