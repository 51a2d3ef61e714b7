"""Row patterns of the forms that are emitted, as joins that SQLite runs: a second engine for their
conditions, where Flink is not installed.
"""

import re
import sqlite3
from collections.abc import Sequence
from itertools import pairwise

from cross_check.published.flink import RowHeader
from rvaft.model.values import Json

QUERY = re.compile(
    r"SELECT trace, found FROM (?P<table>.*) MATCH_RECOGNIZE \(\n"
    r"  PARTITION BY trace ORDER BY ts MEASURES (?P<last>e\d+).pos AS found\n"
    r"  ONE ROW PER MATCH AFTER MATCH SKIP TO NEXT ROW PATTERN \((?P<pattern>.*)\)\n"
    r"  DEFINE (?P<conditions>.*)\)"
)
DEFINED = re.compile(r"(?:^|, )(s|[eg]\d+) AS ")


def joined(query: str) -> str:
    """The join that finds the same rows; a comma and ` AS ` within a literal would mislead it, and
    no text of a test has these.
    """
    found = QUERY.fullmatch(query)
    assert found is not None, query
    table = f"(SELECT *, row_number() OVER (PARTITION BY trace ORDER BY ts) AS number FROM {found['table']})"
    names, order = found["pattern"].split(), []
    aliases = [name for name in names if name[0] != "g"]
    for one, other in pairwise(aliases):
        gap = names[names.index(one) + 1].startswith("g")
        order += [f"{one}.trace = {other}.trace", f"{one}.number {'<' if gap else '+ 1 ='} {other}.number"]
    _, *defined = DEFINED.split(found["conditions"])
    conditions = list[str]()
    for name, condition in zip(defined[::2], defined[1::2], strict=True):
        if name[0] != "g":
            conditions.append(f"({condition})")
            continue
        one, other = (f"e{int(name[1:]) + more}" for more in (0, 1))
        place = f"{name}.trace = {one}.trace AND {one}.number < {name}.number AND {name}.number < {other}.number"
        conditions.append(f"NOT EXISTS (SELECT 1 FROM {table} AS {name} WHERE {place} AND ({condition}) IS NOT TRUE)")
    tables = ", ".join(f"{table} AS {name}" for name in aliases)
    return (
        f"SELECT {found['last']}.trace, {found['last']}.pos FROM {tables} WHERE {' AND '.join([*order, *conditions])}"
    )


def first_detections(text: str, traces: Sequence[Sequence[Json]]) -> list[int | None]:
    """For each trace the number of the event with which it first is a detection."""
    header, found = RowHeader.read(text), dict[int, int]()
    _, _, queries = text[text.index("/* rvaft") :].partition("*/\n")
    columns = ["trace", "pos", "ts", *header.types()]
    connection = sqlite3.connect(":memory:")
    connection.execute(f"CREATE TABLE events ({', '.join(columns)})")
    for trace, events in enumerate(traces):
        rows = [dict.fromkeys(header.fitting, False), *map(header.row, events)]
        cells = [[trace, pos, pos, *(row.get(name) for name in columns[3:])] for pos, row in enumerate(rows)]
        connection.executemany(f"INSERT INTO events VALUES ({', '.join('?' * len(columns))})", cells)
    for query in queries.rstrip("\n").split("\nUNION ALL\n"):
        same = query if query.endswith("WHERE FALSE") else joined(query)
        same = same.replace("GREATEST(", "max(").replace("LEAST(", "min(")
        for trace, position in connection.execute(same):
            found[trace] = min(position, found.get(trace, position))
    connection.close()
    return [found.get(trace) for trace in range(len(traces))]
