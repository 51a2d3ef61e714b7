"""First detections of texts in Apache Flink, with many texts and traces per job.

The leading comment of a text defines columns of the table `events` (`backends.event_columns`): a
BOOLEAN per pattern, and its values. Every row also has `trace` (the number of the trace), `pos`
(the number of the event, from 1) and `ts`, a time attribute that increases with `pos` and is not
the time of the event.
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
_TABLE: Final = """CREATE TEMPORARY TABLE events_{number} (trace BIGINT, pos BIGINT, {columns}
ts AS TO_TIMESTAMP_LTZ(pos, 3), WATERMARK FOR ts AS ts - INTERVAL '99' DAY)
WITH ('connector' = 'filesystem', 'path' = '{path}', 'format' = 'json')"""
_CAUSE: Final = re.compile(r"(?:^|: )([\w.]+(?:Exception|Error): .*)", re.MULTILINE)
_LENGTH: Final = 300
_JAVA: Final = "a Java runtime, 11 or later"
_QUERIES: Final = 60
"""Queries per job: each query takes some of Flink's few buffers."""


class RowHeader(EventColumns):
    """The columns of the table of a text."""

    def types(self) -> dict[str, str]:
        """Return the columns with their types."""
        found = dict.fromkeys(self.fitting, "BOOLEAN")
        for columns in self.values.values():
            found.update({name: _TYPES[one.aspect] for name, one in columns.items()})
        return found

    def row(self, event: Json) -> dict[str, Json]:
        """Return the columns of an event; raises `OverflowError` for inexact numbers."""
        found: dict[str, Json] = dict.fromkeys(self.types())
        for name, cells in self.cells(event).items():
            found |= {name: cells is not None, **(cells or {})}
        return found


def tables() -> Any:
    """Return the module of PyFlink; raises `ToolMissing`."""
    return installed("pyflink.table", "Apache Flink", f"pip install '.[flink]' in a checkout of rvaft, and {_JAVA}")


@cache
def _session() -> Any:
    """Return the environment of all jobs of this process; it starts slowly."""
    table = tables()
    environment = table.TableEnvironment.create(table.EnvironmentSettings.in_streaming_mode())
    environment.get_config().set("parallelism.default", "1")
    return environment


def first_detections(jobs: Sequence[tuple[str, Sequence[Sequence[Json]]]]) -> list[list[int | None]]:
    """Return for each text and trace the number of the first detecting event, from 1, or None.

    Raises `LanguageError` for a text without a header, `OverflowError` for inexact numbers,
    `ToolMissing` without PyFlink, and `ToolFailed` for errors of Flink.
    """
    headers = [RowHeader.read(text) for text, _ in jobs]
    table, environment = tables(), cast(Any, None)
    first: list[list[int | None]] = [[None] * len(traces) for _, traces in jobs]
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        try:
            environment = _session()
            for text, trace, position in _detections(table, environment, Path(folder), headers, jobs):
                known = first[text][trace]
                first[text][trace] = position if known is None else min(known, position)
        except OverflowError:
            raise
        except Exception as error:  # Java errors, passed on by Python
            causes = _CAUSE.findall(str(error)) or [f"{type(error).__name__}: {error}"]
            why = " ".join(causes[-1].split())[:_LENGTH]
            raise ToolFailed("Apache Flink", reason=why if environment else f"it needs {_JAVA} ({why})") from error
        finally:
            if environment:
                environment.execute_sql("DROP TEMPORARY VIEW IF EXISTS events")
                for number in range(len(jobs)):
                    environment.execute_sql(f"DROP TEMPORARY TABLE IF EXISTS events_{number}")
    return first


def _detections(
    table: Any,
    environment: Any,
    folder: Path,
    headers: Sequence[RowHeader],
    jobs: Sequence[tuple[str, Sequence[Sequence[Json]]]],
) -> Iterator[tuple[int, int, int]]:
    whole, queries = None, 0
    for number, (header, (text, traces)) in enumerate(zip(headers, jobs, strict=True)):
        path = folder / f"{number}.json"
        with path.open("w", encoding="ascii") as file:
            for trace, events in enumerate(traces):
                rows = [dict.fromkeys(header.fitting, False), *map(header.row, events)]  # row 0 matches nothing
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
