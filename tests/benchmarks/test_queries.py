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


def least(work: Callable[[], object]) -> float:
    """The least processor time of five runs."""
    found = list[float]()
    for _ in range(5):
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
