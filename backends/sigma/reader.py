"""A monitor for correlations: pySigma compiles rules to queries for SQLite.

A trace is left open if Sigma would confuse values: null with a missing field, or group values that
differ only in type, case, or beyond 15 digits. It is also left open if times do not increase.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

from backends.sqlite import SqliteConnection
from rvaft.errors import LanguageError, TraceError, installed
from rvaft.language.parser import parse_time
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import time_text
from rvaft.model.values import EXACT_INTEGERS, Json, at, equal
from rvaft.monitors import DetectionMonitor

_LAST: Final = 2**32
_REMEDY: Final = "pip install '.[sigma]' in a checkout of rvaft"
_TIME: Final = "rvaft_time"
_RELEVANT: Final = ("action", "correlation", "detection", "filter", "id", "logsource", "name", "rvaft", "title")
"""The relevant keys of a document, without author, date and purpose."""


def fields(text: str) -> tuple[tuple[str, ...], ...]:
    """Return the paths of the fields that rules read; raises `LanguageError` and `ToolMissing`."""
    return _SigmaProgram(text).fields


class SigmaMonitor(DetectionMonitor):
    """A monitor for a correlation; raises `LanguageError` and `ToolMissing`."""

    def __init__(self, text: str) -> None:
        program = _SigmaProgram(text)
        super().__init__(lambda traces: [program.known(json.dumps(trace)) for trace in traces], program.left_open)


def with_time(text: str, time: EventTime) -> str:
    """Return the rules with this declaration of times in the last one, unless a rule has one."""
    yaml = installed("yaml", "PyYAML", _REMEDY)
    documents = [one for one in yaml.safe_load_all(text) if isinstance(one, dict)]
    if not documents or any("rvaft" in one for one in documents):
        return text
    found: str = yaml.safe_dump_all([*documents[:-1], {**documents[-1], "rvaft": time_text(time)}], sort_keys=False)
    return found


@lru_cache(maxsize=64)
class _SigmaProgram:
    def __init__(self, text: str) -> None:
        self.known = lru_cache(5_000)(self.first)
        yaml = installed("yaml", "PyYAML", _REMEDY)
        sigma = installed("sigma.collection", "pySigma", _REMEDY)
        sqlite = installed("sigma.backends.sqlite", "pysigma-backend-sqlite", _REMEDY)
        try:
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            documents = _relevant_parts(yaml.load_all(text, Loader=loader))
            time = next((one["rvaft"] for one in documents if "rvaft" in one), None)
            self._time: EventTime | None = None if time is None else parse_time(str(time))
            rules = sigma.SigmaCollection.from_dicts(documents)
            backend = sqlite.sqliteBackend(
                timestamp_field=_TIME, timestamp_seconds_expression="{field}", collate_nocase=True
            )
            plan = _root(json.loads(backend.convert(rules, output_format="zircolite")))["correlation_plan"]
            self._fields = [one for fields in plan["required_fields"].values() for one in fields if one != _TIME]
            self._grouped = sorted({*self._fields} & {one for rule in rules.rules for one in _grouped(rule)})
            self._table = SqliteConnection(cached_statements=10_000)
            self._table.create_function("REGEXP", 2, _is_found, deterministic=True)
            columns = "".join(f", `{name.replace('`', '``')}`" for name in self._fields)
            self._table.execute(f"CREATE TABLE logs ({_TIME}{columns})")
            self._insert = f"INSERT INTO logs VALUES (?{', ?' * len(self._fields)})"  # noqa: S608
            self._steps, self._query = list[str](), plan["query"]
            for name, select in ((one["name"], one["select"]) for one in plan["prepare"]):
                self._table.execute(f"CREATE TEMP TABLE {name} AS {select}")
                self._steps += [f"DELETE FROM {name}", f"INSERT INTO {name} {select}"]  # noqa: S608
            self._table.ask(self._query)
        except yaml.MarkedYAMLError as error:
            line, column = (error.problem_mark.line, error.problem_mark.column) if error.problem_mark else (0, 0)
            message = f"not a Sigma correlation, because it is not YAML: {error.problem}"
            raise LanguageError(message, file="<sigma>", line=line + 1, column=column + 1) from None
        except Exception as error:  # noqa: BLE001 -- pySigma and SQLite raise many types of errors
            message = error.message if isinstance(error, LanguageError) else str(error)
            if "fulltext_field" in message:
                message = "a rule searches words without a field; name the field"
            raise LanguageError(f"not a Sigma correlation: {' '.join(message.split())[:500]}", file="<sigma>") from None

    @property
    def fields(self) -> tuple[tuple[str, ...], ...]:
        """The paths of the fields that the rules read, and that of the time if they declare it."""
        times = [] if self._time is None else [self._time.field]
        return tuple(dict.fromkeys([*(tuple(name.split(".")) for name in self._fields), *times]))

    def _times(self, trace: Sequence[Json]) -> list[float]:
        """Return the times of the events, up to the first that does not increase.

        A microsecond is stored as 2**-20 s, so that whole seconds add exactly and the order is
        kept.
        """
        if self._time is None:
            return [float(number) for number in range(len(trace))]
        found = [-1.0]
        for time in map(self._time.read, trace):
            seconds, part = divmod((time or 0) // 1_000, 1_000_000)
            now = seconds + part / 2**20
            if time is None or time % 1_000 or not found[-1] < now < _LAST:
                break
            found.append(now)
        return found[1:]

    def left_open(self, trace: Sequence[Json]) -> str:
        if len(self._times(trace)) < len(trace):
            return "Sigma orders events by time, and the times do not increase"
        if any(at(event, name.split("."), 0) is None for event in trace for name in self._fields):
            return "Sigma does not distinguish null from a missing field"
        if any(_has_dotted(event, name) for event in trace for name in self._fields if "." in name):
            return "Sigma does not distinguish a key with a dot from a field inside"
        known: dict[object, Json] = {}
        for name in self._grouped:
            for event in trace:
                value = at(event, name.split("."), ...)
                if value is not ... and not equal(known.setdefault(_alike(value), value), value):
                    return "Sigma groups values without type, case and digits after the 15th"
        return ""

    def first(self, written: str) -> int | None:
        """Return the number of the first event at which the correlation holds, or None."""
        trace = json.loads(written)
        if why := self.left_open(trace):
            raise TraceError(f"Sigma has no verdict for this trace: {why}", line=None)
        times = self._times(trace)
        rows = [
            (time, *(_stored(at(event, name.split("."), None)) for name in self._fields))
            for time, event in zip(times, trace, strict=True)
        ]
        self._table.execute("DELETE FROM logs")
        self._table.executemany(self._insert, rows)
        for step in self._steps:
            self._table.execute(step)
        columns, found = self._table.ask(self._query)
        column = columns.index("occurrence_time")
        end = min((row[column] for row in found), default=_LAST)
        return next((number for number, time in enumerate(times, 1) if time >= end), None)


def _has_dotted(event: Json, name: str) -> bool:
    """Whether some key of an event with a dot may be (the beginning of) a field.

    >>> _has_dotted({"id.orig_h": 1}, "id.orig_h"), _has_dotted({"id": {"orig_h": 1}}, "id.orig_h")
    (True, False)
    """
    todo = [(event, name.split("."))]
    while todo:
        value, steps = todo.pop()
        if isinstance(value, Mapping):
            for end in range(1, len(steps) + 1):
                if (key := ".".join(steps[:end])) in value:
                    if end > 1:
                        return True
                    todo.append((value[key], steps[end:]))
    return False


def _relevant_parts(documents: Iterable[Any]) -> list[Any]:
    """Return the relevant parts of documents; a single rule gets a correlation that counts to 1."""
    found = list[Any]()
    for one in documents:
        if not isinstance(one, dict | None):
            raise TypeError(f"a rule must be a YAML mapping, not {type(one).__name__}")
        found += [{key: one[key] for key in _RELEVANT if key in one}] if one else []
    match found:
        case [{"detection": _} as rule]:
            name = str(rule.get("name", "rule"))
            alone = {"type": "event_count", "rules": [name], "timespan": "1s", "condition": {"gte": 1}}
            return [{**rule, "name": name}, {"title": name, "correlation": alone}]
        case _:
            return found


def _root(converted: list[Any]) -> Any:
    if len(converted) != 1:
        found = ", ".join(one["title"] for one in converted) or "none"
        raise ValueError(f"expected one correlation that refers to all other rules and correlations; found: {found}")
    return converted[0]


def _grouped(rule: Any) -> list[str]:
    counted = getattr(getattr(rule, "condition", None), "fieldref", None)
    aliases = [field for alias in getattr(rule, "aliases", ()) for field in alias.mapping.values()]
    return [*(getattr(rule, "group_by", None) or ()), *([counted] if isinstance(counted, str) else ()), *aliases]


def _is_found(pattern: str, value: object) -> bool:
    return value is not None and re.search(pattern, str(value)) is not None


def _alike(value: Json) -> object:
    """Return a key, equal for values that Sigma confuses; SQLite writes groups with 15 digits."""
    stored = _stored(value)
    return stored.lower() if isinstance(stored, str) else stored if stored is None else float(f"{stored:.15g}")


def _stored(value: Json) -> str | int | float | None:
    if value is None or isinstance(value, str):
        return value if value is None else value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, bool | Mapping | list):
        return json.dumps(_numbered(value), sort_keys=True)
    number: int | float = value
    if abs(number) < EXACT_INTEGERS:
        return int(number) if number == int(number) else number  # whole numbers are stored as integers
    if isinstance(number, float):
        return number
    return float(number) if abs(number) < 2**1023 else f"integer {number:x}"


def _numbered(value: Json) -> Json:
    if isinstance(value, Mapping):
        return {name: _numbered(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_numbered(inner) for inner in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value
