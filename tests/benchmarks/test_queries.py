"""Queries that are emitted, beside queries by hand: processor time in DuckDB, as ratios within one run.

`pytest tests/benchmarks/test_queries.py -s` prints the table.
"""

import time
from collections.abc import Callable
from typing import Any, Final

import pytest

from backends.sql import SqlBackend
from rvaft import Semantics, loads
from tests.benchmarks.conftest import Ratios

pytestmark = pytest.mark.benchmark

EVENTS: Final = 500_000
MOST: Final = 1.5
MOST_DISTINCT: Final = 2.0
MOST_LINEAR: Final = 15.0
"""The cost of ten times as many events."""
LOG: Final = """
CREATE TABLE log AS SELECT i AS id, i * 2000000000 AS ts, CASE WHEN hash(i) % 4 < 2 THEN 'fail' ELSE 'ok' END AS kind,
  CASE WHEN i BETWEEN 250000 AND 250100 THEN 'mallory' ELSE 'u' || CAST(hash(i + 7) % 200 AS VARCHAR) END AS u
FROM range({}) AS t(i)
"""
TREE: Final = """
time t as ns; event fail(u: text) = { kind: "fail", u: u }; assume types, present, order 0 s;
top and fails within 5 min; fails on fail(U) times 20;
"""
BY_HAND: Final = """
SELECT id, u FROM (
  SELECT id, u, ts, lag(ts, 19) OVER (PARTITION BY u ORDER BY id) AS start FROM log WHERE kind = 'fail'
) WHERE ts - start <= 300000000000
"""


SCANS: Final = """
CREATE TABLE log AS SELECT i AS id, i * 60000000 AS ts, 'flow' AS kind,
  CASE WHEN i BETWEEN 500000 AND 500100 THEN 'mallory' ELSE 's' || CAST(hash(i) % 2000 AS VARCHAR) END AS source,
  CASE WHEN i BETWEEN 500000 AND 500100 THEN i ELSE hash(i + 7) % 5 END :: BIGINT AS port FROM range(1000000) AS t(i)
"""
FLOWS: Final = """
time t as ns; event flow(s: text, p: integer) = { kind: "flow", source: s, port: p };
assume types, present, order 0 s; top and scan within 1 min; scan on flow(S, P) times 20 distinct P;
"""
SPRAYS: Final = """
CREATE TABLE log AS SELECT i AS id, i * 600000000 AS ts, CASE WHEN hash(i) % 4 < 2 THEN 'fail' ELSE 'ok' END AS kind,
  CASE WHEN i BETWEEN 250000 AND 250100 THEN 'mallory' ELSE 'a' || CAST(hash(i + 7) % 200 AS VARCHAR) END AS address,
  'u' || CAST(hash(i + 9) % (CASE WHEN i BETWEEN 250000 AND 250100 THEN 5000 ELSE 3 END) AS VARCHAR) AS u
FROM range(1000000) AS t(i)
"""
FAILURES: Final = """
time t as ns; event fail(a: text, u: text) = { kind: "fail", address: a, u: u };
assume types, present, order 0 s; top and spray within 5 min; spray on fail(A, U) times 10 distinct U;
"""
BEATS: Final = """
CREATE TABLE log AS SELECT i AS id, i * 100000000 + (hash(i) % 50000000) :: BIGINT + i % 10 // 9 * {1} AS ts,
  'beat' AS kind, 'r' || CAST(i % 10 AS VARCHAR) AS robot FROM range({0}) AS t(i) WHERE i % 10 <> 3 OR i % 1000 > 60
"""
HEARTBEAT: Final = """
time t as ns; event beat(r: text) = { kind: "beat", robot: r }; assume types, present;
top on beat(R) without beat(R) for 2 s after;
"""


def least(work: Callable[[], object], runs: int = 5) -> float:
    """The least processor time of some runs."""
    found = list[float]()
    for _ in range(runs):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return min(found)


def test_counted_events_in_a_window(ratios: Ratios) -> None:
    duckdb: Any = pytest.importorskip("duckdb", reason="DuckDB is not installed")
    log = duckdb.connect(config={"threads": "1"})
    log.execute(LOG.format(EVENTS))
    table = {"table": "log", "position": "id", "time": "ts:ns", "dialect": "duckdb"}
    query = SqlBackend().mapped(table).translate(loads(TREE), Semantics.SCATTERED).text
    found = {position for position, *_ in log.execute(query).fetchall()}
    assert found == {position for position, _ in log.execute(BY_HAND).fetchall()} != set()
    ratio = least(lambda: log.execute(query).fetchall()) / least(lambda: log.execute(BY_HAND).fetchall())
    ratios.add("typed SQL, times 20 within 5 min", "a query by hand", ratio, MOST)
    assert ratio <= MOST


@pytest.mark.parametrize(("rows", "text", "name"), [(SCANS, FLOWS, "20 ports"), (SPRAYS, FAILURES, "10 users")])
def test_different_values_in_a_window(rows: str, text: str, name: str, ratios: Ratios) -> None:
    """Against as many events of the same key."""
    duckdb: Any = pytest.importorskip("duckdb", reason="DuckDB is not installed")
    log = duckdb.connect(config={"threads": "1"})
    log.execute(rows)
    language = SqlBackend().mapped({"table": "log", "position": "id", "time": "ts:ns", "dialect": "duckdb"})
    plain = text.replace("times 20 distinct P", "times 20 each P").replace("times 10 distinct U", "times 10 each U")
    query, counted = (language.translate(loads(one), Semantics.SCATTERED).text for one in (text, plain))
    found, among = (log.execute(one).fetchall() for one in (query, counted))
    assert {position for position, *_ in found} <= {position for position, *_ in among}
    assert found
    ratio = least(lambda: log.execute(query).fetchall()) / least(lambda: log.execute(counted).fetchall())
    ratios.add(f"typed SQL, {name} of a window", "as many events of any values", ratio, MOST_DISTINCT)
    assert ratio <= MOST_DISTINCT


@pytest.mark.parametrize("ahead", [0, 10**10])
def test_heartbeats_without_order(ahead: int, ratios: Ratios) -> None:
    """A million events against 100,000, also if the clock of one robot is ahead of the others."""
    duckdb: Any = pytest.importorskip("duckdb", reason="DuckDB is not installed")
    language = SqlBackend().mapped({"table": "log", "position": "id", "time": "ts:ns", "dialect": "duckdb"})
    query = language.translate(loads(HEARTBEAT), Semantics.SCATTERED).text
    times = list[float]()
    for number in (100_000, 1_000_000):
        log = duckdb.connect(config={"threads": "1"})
        log.execute(BEATS.format(number, ahead))
        assert log.execute(query).fetchall()
        times.append(least(lambda: log.execute(query).fetchall(), 3))  # noqa: B023
    ratio = times[1] / times[0]
    clocks = "one clock ahead" if ahead else "clocks alike"
    ratios.add(f"typed SQL, 1,000,000 heartbeats, {clocks}", "100,000", ratio, MOST_LINEAR)
    assert ratio <= MOST_LINEAR
