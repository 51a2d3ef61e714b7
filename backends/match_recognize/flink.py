"""What Apache Flink reads and says.

The rows of a trace, and where a text first detects something, asked in few jobs of one session.

The leading comment of a text defines columns of the table `events` (`backends.event_columns`):
BOOLEAN for what fits, and what such an event has. Every row has `trace` (the log that an event is
of), `pos` (its number there, from 1) and `ts`, a time attribute that increases with `pos`; it is
not the time of the event.
"""

import json
import re
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, cast

from backends.event_columns import EventColumns
from rvaft.errors import ToolFailed, installed
from rvaft.model.values import Json

_TYPES: Final = {"text": "STRING", "number": "DOUBLE", "string": "STRING", "time": "BIGINT", "truth": "BOOLEAN"}
"""The type of each aspect."""
_TABLE: Final = """CREATE TEMPORARY TABLE events_{number} (trace BIGINT, pos BIGINT, {columns}
ts AS TO_TIMESTAMP_LTZ(pos, 3), WATERMARK FOR ts AS ts - INTERVAL '99' DAY)
WITH ('connector' = 'filesystem', 'path' = '{path}', 'format' = 'json')"""
_CAUSE: Final = re.compile(r"(?:^|: )([\w.]+(?:Exception|Error): .*)", re.MULTILINE)
_LENGTH: Final = 300
_JAVA: Final = "a Java runtime, 11 or later"
_QUERIES: Final = 60
"""So many queries make a job: each takes buffers of Flink, of which there are few."""


class RowHeader(EventColumns):
    """The columns of the table of a text."""

    def types(self) -> dict[str, str]:
        """The columns with their types."""
        found = dict.fromkeys(self.fitting, "BOOLEAN")
        for columns in self.values.values():
            found.update({name: _TYPES[one.aspect] for name, one in columns.items()})
        return found

    def row(self, event: Json) -> dict[str, Json]:
        """The columns of an event; raises `OverflowError` where one cannot hold a number."""
        found: dict[str, Json] = dict.fromkeys(self.types())
        for name, cells in self.cells(event).items():
            found |= {name: cells is not None, **(cells or {})}
        return found


def tables() -> Any:
    """The module of PyFlink; raises `ToolMissing`."""
    return installed("pyflink.table", "Apache Flink", f"pip install '.[flink]' in a checkout of rvaft, and {_JAVA}")


@cache
def _session() -> Any:
    """The environment of all jobs of this process, which takes long to start."""
    table = tables()
    environment = table.TableEnvironment.create(table.EnvironmentSettings.in_streaming_mode())
    environment.get_config().set("parallelism.default", "1")
    return environment


def first_detections(asked: Sequence[tuple[str, Sequence[Sequence[Json]]]]) -> list[list[int | None]]:
    """For each text the number of the event, from 1, with which each of its traces first is a detection.

    The least position that it finds.

    Raises `LanguageError` for a text without a header, `OverflowError` for a number that no column
    holds exactly, `ToolMissing` without PyFlink, and `ToolFailed` where Flink does not take a text.
    """
    headers = [RowHeader.read(text) for text, _ in asked]
    table, environment = tables(), cast(Any, None)
    found: list[list[int | None]] = [[None] * len(traces) for _, traces in asked]
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        try:
            environment = _session()
            for text, trace, position in _detections(table, environment, Path(folder), headers, asked):
                known = found[text][trace]
                found[text][trace] = position if known is None else min(known, position)
        except OverflowError:
            raise
        except Exception as error:  # of Java, by way of Python
            said = _CAUSE.findall(str(error)) or [f"{type(error).__name__}: {error}"]
            why = " ".join(said[-1].split())[:_LENGTH]
            raise ToolFailed("Apache Flink", reason=why if environment else f"it needs {_JAVA} ({why})") from error
        finally:
            if environment:
                environment.execute_sql("DROP TEMPORARY VIEW IF EXISTS events")
                for number in range(len(asked)):
                    environment.execute_sql(f"DROP TEMPORARY TABLE IF EXISTS events_{number}")
    return found


def _detections(
    table: Any,
    environment: Any,
    folder: Path,
    headers: Sequence[RowHeader],
    asked: Sequence[tuple[str, Sequence[Sequence[Json]]]],
) -> Iterator[tuple[int, int, int]]:
    """The number of a text, of a trace and of an event of each row that is found."""
    whole, queries = None, 0
    for number, (header, (text, traces)) in enumerate(zip(headers, asked, strict=True)):
        path = folder / f"{number}.json"
        with path.open("w", encoding="ascii") as file:
            for trace, events in enumerate(traces):
                rows = [dict.fromkeys(header.fitting, False), *map(header.row, events)]  # no event before the first
                file.writelines(json.dumps({"trace": trace, "pos": pos, **row}) + "\n" for pos, row in enumerate(rows))
        columns = "".join(f"`{name}` {kind}," for name, kind in header.types().items())
        environment.execute_sql(_TABLE.format(number=number, columns=columns, path=path))
        environment.execute_sql(f"CREATE TEMPORARY VIEW events AS SELECT * FROM events_{number}")  # noqa: S608
        query = environment.sql_query(text)
        named = query.select(
            table.expressions.lit(number), *(table.expressions.col(name) for name in ("trace", "found"))
        )
        whole = named if whole is None else whole.union_all(named)
        environment.execute_sql("DROP TEMPORARY VIEW events")
        queries += text.count("MATCH_RECOGNIZE")
        if queries >= _QUERIES:
            yield from map(tuple, whole.execute().collect())
            whole, queries = None, 0
    if whole is not None:
        yield from map(tuple, whole.execute().collect())
