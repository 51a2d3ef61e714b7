"""EQL texts, run by the engine of the package `eql`.

A text has one or more queries in Elasticsearch syntax, separated by `;`. A first line `// time
FIELD as FORMAT` names the time of events (default: `@timestamp as iso8601`). `maxspan` needs traces
in time order; queries with `maxspan` skip events without a time.

The engine evaluates the conditions once per event. Sequences then run on events that hold only
these results. Joins use JSON equality (`true` and 1 differ). Elasticsearch does
not index lists: a text with an index runs here, and other tests of lists are left open.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import groupby, pairwise, permutations, product, takewhile
from threading import Lock
from typing import Any, Final

from backends.eql.queries import CATEGORY, FILE, FUNCTIONS, OPTIONAL, is_missing, parsed, place
from rvaft.errors import LanguageError, ToolFailed, TraceError, error_at, installed
from rvaft.language.parser import parse_time
from rvaft.model.event_time import UNITS, EventTime, TimeFormat
from rvaft.model.expressions import time_text
from rvaft.model.values import Json, key

_TEXTS: Final = r"""\"{3}[^\r\n]*?\"{3,5}|"(?:\\.|[^"\\\r\n])*"|'(?:\\.|[^'\\\r\n])*'|`[^`\r\n]*`"""
_QUERY: Final = re.compile(rf"(?:{_TEXTS}|//[^\n]*|/\*.*?\*/|[^;])+", re.DOTALL)
_TIME: Final = re.compile(r"(?:\s|/\*.*?\*/|//(?![ \t]*time[ \t])[^\n]*\n)*//[ \t]*(time[ \t][^\n]*\S)", re.DOTALL)
_DEFAULT_TIME: Final = EventTime(("@timestamp",), TimeFormat.ISO8601)
_BACKWARDS: Final = "`maxspan` needs events in time order, and the times of this trace decrease"
_ONE_MILLISECOND: Final = "Elasticsearch does not order a missing event and another one in the same millisecond"
_ABSENT: Final = "Elasticsearch does not distinguish null from a missing field"
_LISTS: Final = "Elasticsearch tests each element of a list separately"
_EVENT, _END = "event", "end"
"""Event types; `until` reads an event as `end`, after the sequences have read it as `event`."""
_KEY, _CATEGORIES, _TRACE, _NULL = "key", 0, -1, object()
"""A function, two fields that no JSON event has, and the replacement of null."""
_TRACES: Final = 100
"""Traces per engine; an engine keeps the partial matches of its traces."""


def _at(value: Json, path: Sequence[str | int]) -> Json:
    for name in path:
        at_number = isinstance(value, list) and isinstance(name, int) and name < len(value)
        if not (at_number or (isinstance(value, Mapping) and name in value)):
            return None
        value = value[name]
    return _NULL if value is None else value


def _field(_: Any, node: Any) -> Callable[[Any], Json]:
    """Return a field accessor; the engine's own also indexes strings."""
    path = (node.base, *node.path)
    return lambda scope: _at(scope.event.data, path)


def _categories(event: Json) -> list[Json]:
    nested = event["event"].get("category") if isinstance(event.get("event"), Mapping) else None
    found = event.get("event_type"), event.get("event.category"), nested
    return [each for one in found for each in (one if isinstance(one, list) else [one])]


class Queries:
    """The queries of a text. An engine runs many traces; the trace number is a key of sequences."""

    def __init__(self, module: Any, queries: Sequence[Any], time: EventTime | None) -> None:
        mended = {"_convert_field": _field, "lowercase": staticmethod(lambda compare, **_: compare)}
        functions = {**FUNCTIONS, _KEY: lambda value: frozenset([key(value)])}  # keys stay case-sensitive
        self._module, self._lock = module, Lock()
        self._asker = type("Asker", (module.PythonEngine,), mended)({"functions": functions})
        self._asked: dict[str, int] = {}
        self._answers: list[Callable[[Any], Json]] = []
        self._fields: set[tuple[str | int, ...]] = set()
        self._missing: list[MissingEvents] = []
        made = [one for query in queries for one in self._sequences(query)]
        timed = [one for one in made if getattr(one.first, "max_span", None)]
        self._queries = [one for one in made if one not in timed], timed
        self._types = [_EVENT, _END] if any(getattr(one.first, "close", None) for one in made) else [_EVENT]
        self._time = time or (_DEFAULT_TIME if timed or self._missing else None)
        self._by_number = any(isinstance(part, int) for path in self._fields for part in path)
        self._engines, self._found, self._traces = list[Any](), list[Any](), 0

    @property
    def fields(self) -> tuple[tuple[str, ...], ...]:
        """The paths of fields that the queries read, up to an index of a list."""
        read = (takewhile(lambda part: isinstance(part, str), path) for path in self._fields)
        timed = self._time is not None and (self._queries[1] or self._missing)
        times = [self._time.field] if timed and self._time else []
        return tuple(sorted({*(tuple(map(str, path)) for path in read), *times}))

    def _sequences(self, query: Any) -> Iterator[Any]:
        ast = self._module.ast
        if any(map(is_missing, getattr(query, "queries", ()))):
            self._missing.append(self._missing_events(query))
            return
        if isinstance(query, ast.EventQuery):
            yield ast.PipedQuery(ast.EventQuery(_EVENT, self._number(query, [])))
            return
        terms = [self._term(one, _EVENT) for one in query.queries]
        close, span = getattr(query, "close", None), getattr(query, "max_span", None)
        close = close and self._term(close, _END)
        span = span and ast.TimeRange(span.as_milliseconds(), ast.TimeUnit.Seconds)  # the engine counts whole seconds
        for order in permutations(terms) if isinstance(query, ast.Sample) else [terms]:
            yield ast.PipedQuery(ast.Sequence([*order], span, close))

    def _missing_events(self, query: Any) -> "MissingEvents":
        *missing, event = query.queries

        def asked(term: Any) -> tuple[int, ...]:
            condition, *joined = self._asks(term)
            return (condition.base, *(one.base for one in joined))

        span = query.max_span.as_milliseconds() * UNITS["ms"]
        return MissingEvents(asked(event), tuple(map(asked, missing)), span)

    def _asks(self, term: Any) -> list[Any]:
        """Return the condition of a term, and its keys."""
        ast = self._module.ast
        optional = [isinstance(one, ast.FunctionCall) and one.name == OPTIONAL for one in term.join_values]
        keys = [one.arguments[0] if free else one for one, free in zip(term.join_values, optional, strict=True)]
        needed = [ast.IsNotNull(one) for one, free in zip(keys, optional, strict=True) if not free]
        return [self._number(term.query, needed), *(self._answer(ast.FunctionCall(_KEY, [one])) for one in keys)]

    def _term(self, term: Any, kind: str) -> Any:
        ast = self._module.ast
        condition, *joined = self._asks(term)
        return ast.SubqueryBy(ast.EventQuery(kind, condition), [*joined, ast.Field(_TRACE)])

    def _number(self, query: Any, more: Sequence[Any]) -> Any:
        ast, kind = self._module.ast, query.event_type
        within = [] if kind == "any" else [ast.FunctionCall(CATEGORY, [ast.Field(_CATEGORIES), ast.String(kind)])]
        parts = [*within, *more, query.query]
        return self._answer(ast.And(parts) if len(parts) > 1 else parts[0])

    def _answer(self, expression: Any) -> Any:
        number = self._asked.setdefault(repr(expression), len(self._asked) + 1)
        if number > len(self._answers):
            self._answers.append(self._asker.convert(expression, scoped=True))
            fields = (one for one in expression if isinstance(one, self._module.ast.Field))
            self._fields |= {(one.base, *one.path) for one in fields if one.base != _CATEGORIES}
        return self._module.ast.Field(number)

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """Return for each trace the number of the event that completes the first match, or None."""
        with self._lock:
            return [self._first(trace) for trace in traces]

    def _first(self, trace: Sequence[Json]) -> int | None:
        if self._traces % _TRACES == 0:
            self._engines = [self._engine(queries) for queries in self._queries]
        self._traces += 1
        self._found.clear()
        if why := self.left_open(trace):
            raise TraceError(why, line=None)
        missing = [one.started() for one in self._missing]
        for number, event in enumerate(trace, 1):
            moment = None if self._time is None else self._time.read(event)
            try:
                given = self._module.Event(_EVENT, 0, {**event, _CATEGORIES: _categories(event)})
                answers = {place: answer(given) for place, answer in enumerate(self._answers, 1)}
                for kind in self._types:
                    answers[_TRACE] = self._traces
                    for engine in self._engines[: 1 if moment is None else 2]:
                        engine.stream_event(self._module.Event(kind, moment or 0, answers))
            except Exception as error:  # errors of the engine on unexpected values
                self._traces = 0
                raise ToolFailed("eql", reason=f"event {number}: {type(error).__name__}: {error}") from error
            if self._found or (moment is not None and any(one.step(moment, answers) for one in missing)):
                return number
        return None

    def left_open(self, trace: Sequence[Json]) -> str:
        """Return why the trace has no verdict, or an empty string."""
        timed = self._time is not None and (self._queries[1] or self._missing)
        times = [time for one in trace if timed and self._time and (time := self._time.read(one)) is not None]
        if any(later < earlier for earlier, later in pairwise(times)):
            return _BACKWARDS
        if self._missing and any(len(some) > 1 and self._collide(some) for some in self._by_millisecond(trace)):
            return _ONE_MILLISECOND
        if any(_at(event, path) is _NULL for path, event in product(self._fields, trace)):
            return _ABSENT
        ends = () if self._by_number else {path[:end] for path in self._fields for end in range(1, len(path) + 1)}
        return _LISTS if any(isinstance(_at(event, path), list) for path, event in product(ends, trace)) else ""

    def _by_millisecond(self, trace: Sequence[Json]) -> Iterator[list[Json]]:
        """Iterate over the events of each millisecond."""
        assert self._time is not None, "queries with missing events have times"
        timed = [(time, event) for event in trace if (time := self._time.read(event)) is not None]
        for _, some in groupby(timed, lambda one: one[0] // UNITS["ms"]):
            yield [event for _, event in some]

    def _collide(self, events: Sequence[Json]) -> bool:
        """Whether one of the events may be a missing event, and another one the event after it."""
        given = [self._module.Event(_EVENT, 0, {**event, _CATEGORIES: _categories(event)}) for event in events]

        def hits(number: int) -> set[int]:
            return {place for place, event in enumerate(given) if self._answers[number - 1](event)}

        return any(
            {(one, other) for one, other in product(hits(query.event[0]), hits(term[0])) if one != other}
            for query in self._missing
            for term in query.missing
        )

    def _engine(self, queries: Sequence[Any]) -> Any:
        engine = self._module.PythonEngine({"time_unit": UNITS["ms"]})
        engine.add_output_hook(self._found.append)
        engine.add_queries(queries)
        return engine


@dataclass
class MissingEvents:
    """Missing events before a single event, as Elasticsearch looks for them.

    The event detects unless one of the `missing` with its keys came at most `span` ns before it. Each is the
    number of a condition and those of keys. `last` has the last time of each by its keys.
    """

    event: tuple[int, ...]
    missing: tuple[tuple[int, ...], ...]
    span: int
    last: dict[tuple[int, tuple[Json, ...]], int] = field(default_factory=dict)

    def started(self) -> "MissingEvents":
        """Return the same for a new trace."""
        return replace(self, last={})

    def step(self, time: int, answers: Mapping[int, Json]) -> bool:
        """Return whether an event of a later time detects."""
        condition, *keys = self.event
        values = tuple(answers[one] for one in keys)
        times = (self.last.get((number, values)) for number in range(len(self.missing)))
        found = bool(answers[condition]) and not any(one is not None and time - one <= self.span for one in times)
        for number, (other, *own) in enumerate(self.missing):
            if answers[other]:
                self.last[number, tuple(answers[one] for one in own)] = time
        return found


def with_time(text: str, time: EventTime) -> str:
    """Return the text with a first line that defines the time of events, unless it has one."""
    return text if _TIME.match(text) else f"// {time_text(time)}\n{text}"


@lru_cache(maxsize=32)
def compiled(text: str) -> Queries:
    """Return the queries of a text; raises `LanguageError`, `ToolMissing`."""
    eql = installed("eql", "eql", "pip install '.[eql]' in a checkout of rvaft")
    time, queries = None, []
    if line := _TIME.match(text):
        try:
            time = parse_time(line[1])
        except LanguageError as error:
            raise error_at(error.message, text, line.start(1) + error.column - 1, FILE) from None
    for begin, source in [(one.start(), one[0]) for one in _QUERY.finditer(text) if one[0].strip()] or [(0, "")]:
        try:
            queries.append(parsed(source))
        except LanguageError as error:
            at = begin + place(source, error.line - 1, error.column - 1)
            raise error_at(error.message, text, at, FILE) from None
    return Queries(eql, queries, time)
