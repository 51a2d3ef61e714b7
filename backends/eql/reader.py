"""Texts of EQL, and their run by the engine of the package `eql`.

A text is one query, or several with `;` between them, of which any is a detection, in the syntax of Elasticsearch. A line `// time FIELD as FORMAT`
before the first says where events have their time; without it that is `@timestamp as iso8601`. `maxspan` is about logs in the order of their times; an event without a time
is none to queries with a `maxspan`.

The engine is told to mind the case of letters, as Elasticsearch does. What it reads otherwise than Elasticsearch in spite of that is refused.
Events are joined by what is equal in JSON (`true` and 1 are not), and a null is a value.
"""

import re
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

from rvaft.errors import LanguageError, ToolFailed, TraceError, installed
from rvaft.language.diagnostics import error_at
from rvaft.language.parser import parse_time
from rvaft.model.event_time import UNITS, EventTime, TimeFormat
from rvaft.model.values import Json, key

_PIECE: Final = re.compile(
    r"""(?P<end>;)|(?P<skip>//[^\n]*|/\*.*?\*/|\s+)|\"{3}[^\r\n]*?\"{3,5}|"(?:\\.|[^"\\\r\n])*"|'(?:\\.|[^'\\\r\n])*'|`[^`\r\n]*`|.""",
    re.DOTALL,
)
_TIME: Final = re.compile(r"//[ \t]*(time[ \t].*\S)")
_DEFAULT_TIME: Final = EventTime(("@timestamp",), TimeFormat.ISO8601)
_BACKWARDS: Final = "`maxspan` is about logs in the order of their times, and those of this trace go back"
_CASE_ALIKE: Final = "the engine cannot mind the case of letters here and not there"
_DEVIATIONS: Final = {
    ":": f"{_CASE_ALIKE}: write ==, or like",
    "like~": f"{_CASE_ALIKE}: write like",
    "in~": f"{_CASE_ALIKE}: write in",
    "regex": "the engine asks for a match at the beginning, and not of the whole text",
    "regex~": _CASE_ALIKE,
    "![": "the engine does not wait until a missing event is missing",
}
"""What the engine reads otherwise than Elasticsearch, and how."""
_FILE: Final = "<eql>"
_KINDS: Final = ("event_type", "event.category")
_KEY, _TRACE, _NULL = "key", 0, object()
"""A function, a field that no event of JSON has, and what stands for a null."""
_TRACES: Final = 100
"""So many traces are looked at by one engine, which keeps what is left of each."""
_LOCK: Final = threading.RLock()


class _Object(dict[Any, Json]):
    """An object of JSON whose fields the engine gets."""

    def get(self, name: str, default: Json = None) -> Json:
        return document(self[name]) if name in self else default


class _List(list[Json]):
    def __getitem__(self, index: Any) -> Json:
        return document(super().__getitem__(index))


def document(value: Json) -> Json:
    """A value as the engine gets it; for that None is a field that is not there."""
    if isinstance(value, Mapping):
        return _Object(value)
    return _List(value) if isinstance(value, list) else _NULL if value is None else value


@contextmanager
def minding_case(module: Any) -> Iterator[None]:
    """While this runs, the package `eql` tells capital letters from small ones."""
    with _LOCK:
        before, module.utils.CASE_INSENSITIVE = module.utils.CASE_INSENSITIVE, False
        try:
            yield
        finally:
            module.utils.CASE_INSENSITIVE = before


class Queries:
    """What a text asks. An engine runs many traces: their number is a field of events and a key of sequences, but where there are pipes or descendants."""

    def __init__(self, module: Any, queries: Sequence[Any], time: EventTime | None) -> None:
        self._module = module
        timed = [one for one in queries if getattr(one.first, "max_span", None)]
        self._queries = [one for one in queries if one not in timed], timed
        self._time = time or (_DEFAULT_TIME if timed else None)
        self._engines, self._found, self._traces = list[Any](), list[Any](), 0
        apart = module.ast.NamedSubquery, module.ast.PipeCommand
        self._most = 1 if any(isinstance(part, apart) for query in queries for part in query) else _TRACES
        firsts = [query.first for query in queries]
        terms = [term for one in firsts for term in (*getattr(one, "queries", ()), getattr(one, "close", None)) if term]
        for term in {id(term): term for term in terms}.values():
            keys = [module.ast.FunctionCall(_KEY, [one]) for one in term.join_values]
            term.join_values = [*keys, module.ast.Field(_TRACE)]

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """For each trace the number of the event with which one of the queries first has a match."""
        with minding_case(self._module):
            return [self._first(trace) for trace in traces]

    def _first(self, trace: Sequence[Json]) -> int | None:
        if self._traces % self._most == 0:
            self._engines = [self._engine(queries) for queries in self._queries]
        self._traces += 1
        self._found.clear()
        if self.left_open(trace):
            raise TraceError(_BACKWARDS, line=None)
        for number, event in enumerate(trace, 1):
            moment = None if self._time is None else self._time.read(event)
            kind = next((event[name] for name in _KINDS if isinstance(event.get(name), str)), "generic")
            given = self._module.Event(kind, moment or 0, _Object({**event, _TRACE: self._traces}))
            try:
                for engine in self._engines[: 1 if moment is None else 2]:
                    engine.stream_event(given)
            except Exception as error:  # what a query asks of values that it did not expect
                self._traces = 0
                raise ToolFailed("eql", reason=f"event {number}: {type(error).__name__}: {error}") from error
            if self._found:
                return number
        return None

    def left_open(self, trace: Sequence[Json]) -> str:
        """Why the language says nothing of a trace, if that is so."""
        read = [] if self._time is None or not self._queries[1] else map(self._time.read, trace)
        times = [time for time in read if time is not None]
        return _BACKWARDS if any(later < earlier for earlier, later in pairwise(times)) else ""

    def _engine(self, queries: Sequence[Any]) -> Any:
        engine = self._module.PythonEngine({"time_unit": UNITS["s"], "functions": {_KEY: key}})
        engine.add_output_hook(self._found.append)
        engine.add_queries(queries)
        return engine


@lru_cache(maxsize=32)
def compiled(text: str) -> Queries:
    """The queries of a text; raises `LanguageError`, `ToolMissing`."""
    eql = installed("eql", "eql", "pip install '.[eql]' in a checkout of rvaft")
    ends, time, begun = [-1], None, False
    for piece in _PIECE.finditer(text):
        begun = begun or not piece["skip"]
        if not begun and (line := _TIME.match(piece[0])):
            try:
                time = parse_time(line[1])
            except LanguageError as error:
                raise error_at(error.message, text, piece.start() + line.start(1) + error.column - 1, _FILE) from None
        if piece["end"]:
            ends.append(piece.start())
    if text[ends[-1] + 1 :].strip() or len(ends) == 1:
        ends.append(len(text))
    with minding_case(eql):
        queries = [_query(eql, text, begin + 1, end) for begin, end in pairwise(ends)]
        return Queries(eql, queries, time)


def _query(eql: Any, text: str, begin: int, end: int) -> Any:
    """One query of a text, as the parser of the package reads it."""
    from lark import Token  # noqa: PLC0415
    from lark.exceptions import UnexpectedInput  # noqa: PLC0415

    source = text[begin:end] + "\n"
    with eql.utils.ParserConfig(elasticsearch_syntax=True, allow_runs=True, allow_negation=True, optimized=False):
        try:
            tree = eql.parser.lark_parser.parse(source, start="piped_query")
            for token in tree.scan_values(lambda one: isinstance(one, Token)):
                if str(token) in _DEVIATIONS and token.type in ("STRING_PREDICATE", "IN", "MISSING_EVENT_OPEN"):
                    raise error_at(f"{token}: {_DEVIATIONS[str(token)]}", text, begin + token.start_pos, _FILE)
            query = eql.parser.LarkToEQL(source).visit(tree)
        except UnexpectedInput as error:
            raise error_at("this is no query of EQL", text, begin + max(error.pos_in_stream or 0, 0), _FILE) from None
        except eql.EqlParseError as error:
            where = sum(map(len, source.splitlines(keepends=True)[: error.line])) + error.column
            raise error_at(error.error_msg, text, min(begin + where, end), _FILE) from None
        except RecursionError:
            raise error_at("this query is nested too deeply", text, begin, _FILE) from None
    if getattr(query.first, "max_span", None) and query.first.max_span.as_milliseconds() % 1000:
        raise error_at("the engine takes whole seconds of a maxspan", text, begin, _FILE)
    return query
