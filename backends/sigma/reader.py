"""Running a correlation: pySigma compiles the rules to one query, and SQLite asks it of a table with a row for each event.

A trace is left open where Sigma would take different values for the same: null for what is absent, and values that differ in type or case, or beyond 15 digits,
where events are grouped by them; and where the times of the events do not increase.
"""

import json
import sqlite3
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import combinations
from typing import Any, Final

from rvaft.errors import LanguageError, TraceError, installed
from rvaft.language.parser import parse_time
from rvaft.model.event_time import EventTime
from rvaft.model.values import Json, at, equal
from rvaft.monitors import DetectionMonitor

_LAST: Final = 2**32
_MOST_KNOWN: Final = 5_000
_REMEDY: Final = "pip install '.[sigma]' in a checkout of rvaft"
_TIME: Final = "rvaft_time"


class SigmaMonitor(DetectionMonitor):
    """A correlation on a trace; raises `LanguageError` and `ToolMissing`."""

    def __init__(self, text: str) -> None:
        program = _SigmaProgram(text)
        super().__init__(lambda traces: [program.first(trace) for trace in traces], program.left_open)


@lru_cache(maxsize=64)
class _SigmaProgram:
    """The query of a text, and what it said of some traces; monitors of one text share it."""

    def __init__(self, text: str) -> None:
        self._known: dict[str, int | None] = {}
        yaml = installed("yaml", "PyYAML", _REMEDY)
        sigma = installed("sigma.collection", "pySigma", _REMEDY)
        sqlite = installed("sigma.backends.sqlite", "pysigma-backend-sqlite", _REMEDY)
        correlations = installed("sigma.correlations", "pySigma", _REMEDY)
        try:
            documents = [one for one in yaml.safe_load_all(text) if one is not None]
            _require_mappings(documents)
            said = next((one["rvaft"] for one in documents if "rvaft" in one), None)
            self._time: EventTime | None = None if said is None else parse_time(str(said))
            rules = sigma.SigmaCollection.from_yaml(text)
            backend = sqlite.sqliteBackend(
                timestamp_field=_TIME, timestamp_seconds_expression="{field}", collate_nocase=True
            )
            queries = backend.convert(rules)
            roots = [rule for rule in rules.rules if isinstance(rule, correlations.SigmaCorrelationRule)]
            root = _only(roots)
            self._query = _only(queries)
            fields = {item.field for rule in rules.rules if rule is not root for item in _items(rule)}
            mapped = {field for alias in root.aliases for field in alias.mapping.values()}
            grouped = {field for field in root.group_by or [] if field not in {one.alias for one in root.aliases}}
            self._grouped = sorted(mapped | grouped)
            self._fields = sorted({*(one for one in fields if one), *self._grouped})
            self._table = sqlite3.connect(":memory:", check_same_thread=False)
            columns = "".join(f", `{name.replace('`', '``')}`" for name in self._fields)
            self._table.execute(f"CREATE TABLE logs ({_TIME}{columns})")
            self._insert = f"INSERT INTO logs VALUES (?{', ?' * len(self._fields)})"  # noqa: S608 -- the query of SQLite's own signs
            self._table.execute(self._query)
        except yaml.MarkedYAMLError as error:
            line, column = (error.problem_mark.line, error.problem_mark.column) if error.problem_mark else (0, 0)
            message = f"no YAML, and so no Sigma correlation: {error.problem}"
            raise LanguageError(message, file="<sigma>", line=line + 1, column=column + 1) from None
        except Exception as error:  # noqa: BLE001 -- pySigma and SQLite say in many ways what is wrong with a text
            message = error.message if isinstance(error, LanguageError) else str(error)
            raise LanguageError(f"no Sigma correlation: {' '.join(message.split())[:500]}", file="<sigma>") from None

    def _times(self, trace: Sequence[Json]) -> list[float] | None:
        """When the events are; None where that would not be in their order.

        A microsecond is the 2**-20th part of a second there, so that whole seconds are added exactly and the order is kept.
        """
        if self._time is None:
            return [float(number) for number in range(len(trace))]
        found = [-1.0]
        for time in map(self._time.read, trace):
            if time is None or time % 1_000:
                return None
            seconds, part = divmod(time // 1_000, 1_000_000)
            now = seconds + part / 2**20
            if not found[-1] < now < _LAST:
                return None
            found.append(now)
        return found[1:]

    def left_open(self, trace: Sequence[Json]) -> str:
        """Why the language says nothing of a trace, if that is so."""
        if self._times(trace) is None:
            return "Sigma orders by times, which have to increase"
        if any(at(event, name.split("."), 0) is None for event in trace for name in self._fields):
            return "Sigma takes null for absent"
        values = [
            value for name in self._grouped for event in trace if (value := at(event, name.split("."), ...)) is not ...
        ]
        if any(isinstance(one, float) and float(f"{one:.15g}") != one for one in map(_stored, values)):
            return "SQLite groups by 15 digits of a number"
        known: dict[object, Json] = {}
        for value in values:
            if not equal(known.setdefault(_alike(value), value), value):
                return "Sigma groups without types and case"
        compound = [value for value in known.values() if isinstance(value, Mapping | list)]
        if any(equal(one, other) for one, other in combinations(compound, 2)):
            return "SQLite groups objects and lists as they are written"
        return ""

    def first(self, trace: Sequence[Json]) -> int | None:
        """The number of the event at which the correlation first holds; raises `TraceError` where its language leaves that open."""
        written = json.dumps(trace)
        if written not in self._known:
            if why := self.left_open(trace):
                raise TraceError(f"this log says nothing to Sigma: {why}", line=None)
            if len(self._known) > _MOST_KNOWN:
                self._known.clear()
            self._known[written] = self._first(trace)
        return self._known[written]

    def _first(self, trace: Sequence[Json]) -> int | None:
        times = self._times(trace) or []
        rows = [
            (time, *(_stored(at(event, name.split("."), None)) for name in self._fields))
            for time, event in zip(times, trace, strict=True)
        ]
        self._table.execute("DELETE FROM logs")
        self._table.executemany(self._insert, rows)
        cursor = self._table.execute(self._query)
        column = [one[0] for one in cursor.description].index("occurrence_time")
        ends = [row[column] for row in cursor]
        return times.index(min(ends)) + 1 if ends else None


def _only(several: list[Any]) -> Any:
    if len(several) != 1:
        raise ValueError(f"there has to be one correlation, of all the rules, and there are {len(several)}")
    return several[0]


def _require_mappings(documents: Sequence[object]) -> None:
    for one in documents:
        if not isinstance(one, dict):
            raise TypeError(f"a rule is a mapping of YAML, and here is a {type(one).__name__}")


def _items(rule: Any) -> list[Any]:
    """The items of all detections of a rule."""
    found, todo = [], [*rule.detection.detections.values()]
    while todo:
        one = todo.pop()
        if hasattr(one, "detection_items"):
            todo += one.detection_items
        else:
            found.append(one)
    return found


def _alike(value: Json) -> object:
    """What values have in common that Sigma takes for the same."""
    stored = _stored(value)
    return stored.lower() if isinstance(stored, str) else stored


def _stored(value: Json) -> str | float | None:
    """A value as a table holds it."""
    if value is None or isinstance(value, str):
        return value if value is None else value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, bool | Mapping | list):
        return json.dumps(value)
    number: int | float = value
    if abs(number) < 2**53 or isinstance(number, float):
        return number
    return float(number) if abs(number) < 2**1023 else f"integer {number:x}"
