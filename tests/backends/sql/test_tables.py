"""SQL over typed columns: what it finds in tables of any shape, and which trees and tables it refuses."""

import datetime
import shutil
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from random import Random
from typing import Any

import pytest

from backends.sql import SqlBackend
from cross_check.comparison import cross_check
from cross_check.results import Status
from rvaft import RVAFT, NotExpressible, OptionError, Semantics, Verdict, load, loads, monitor
from rvaft.backend import backend
from rvaft.model.assumptions import first_violation
from rvaft.readers.json_lines import read
from rvaft.semantics import Reference, matches
from tests.cli.runs import run
from tests.tables import sampled

needs_duckdb = pytest.mark.skipif(not find_spec("duckdb"), reason="needs DuckDB")
needs_sqlglot = pytest.mark.skipif(not find_spec("sqlglot"), reason="needs SQLGlot")
EVENTS = """
event login(user: text, n: integer, ok: boolean, w: number) = { event: "login", user: user, n: n, ok: ok, w: w };
event su(user: text, n: integer) = { event: "su", user: user, inner: { n: n } };
assume types, present, exact;
"""
TREES = {
    "joined": """time t as ms; top sand a b c within 3 s; a on login(U, N, false, _); b on su(U, M) when M > N;
        c on su(U, _);""",
    "guarded": """time t as s late 2 s; top or p q; p sand a b within 3 s when W * 2 + N > M and lower(U) != "root";
        a on login(U, N, OK, W) when not OK; b on su(U, M); q 2of3 c d e when end(q) - start(q) < 5 s;
        c on login(_, 3, true, _); d on su(X, Y) when like(X, "a*") or Y in (1, 2.5, 3);
        e on su(X, K) when K > 1 or startswith(X, "b"); ignore su("carl", _);""",
    "ordered": """time t as ns; top and a b; a on login(_, _, true, _) times 3; b sand c d; c on su("carl", _);
        d on su(_, 2);""",
    "absent": """time t as s late 2 s; top or p q; p sand a b without login(U, K, _, _) when K > N
        without su(V, K) when V != U and K > N for 3 s before; a on login(U, N, _, _); b on su(U, _);
        q and c d without su(V, K) when V == X and K >= 2 for 2 s after; c on login(X, _, true, _);
        d on login(X, _, false, _) without su("carl", _) before;""",
    "unequal": "top and a b; a on login(U, N, _, W); b on su(V, N) when V != U and max(N, 1) < W / 2 + abs(N);",
}
SHAPES: dict[str, dict[str, Any]] = {
    "plain": {"table": "log", "position": "id", "partition": "host"},
    "numbered by the program": {"table": "order", "columns": {"event": "kind", "inner.n": "pos", "user": "time"}},
    "quoted": {
        "table": "the log",
        "columns": {"user": "user name", "ok": "select"},
        "position": "case",
        "partition": "é",
    },
}


def tree(name: str) -> RVAFT:
    return loads(EVENTS + TREES[name])


def events(random: Random, length: int) -> list[Any]:
    trace: list[Any] = []
    for number in range(length):
        user = {"user": random.choice(["anna", "bob", "carl"]), "t": number * random.choice((1, 1.5, 1000))}
        login = {"n": random.randrange(4), "ok": random.random() < 0.5, "w": random.choice((1, 2.5, 4.0))}
        su = {"inner": {"n": random.choice((0, 1, 2.0, 3))}}
        other: dict[str, Any] = {"event": random.choice(("x", 5, None)), "user": 7}
        trace.append(
            random.choice(
                [{"event": "login", **user, **login}, {"event": "su", **user, **su}, {**user, **other}, {"inner": []}]
            )
        )
    return [{**event, "t": round(event["t"])} if "t" in event else event for event in trace]


@pytest.mark.ci
@pytest.mark.parametrize("dialect", ["sqlite", pytest.param("duckdb", marks=needs_duckdb)])
@pytest.mark.parametrize(("shape", "semantics"), sampled(product(SHAPES, Semantics), 7, ci=4))
def test_a_table_of_any_shape_has_the_matches_of_the_definition(shape: str, dialect: str, semantics: Semantics) -> None:
    random, found = Random(7), 0
    for name, text in TREES.items():
        kind = {"ordered": "ns", "joined": "ms"}.get(name, "double")
        options = {**SHAPES[shape], "dialect": dialect, **({"time": f"clock:{kind}"} if "time" in text else {})}
        language = SqlBackend().mapped(options)
        query = language.translate(tree(name), semantics).text
        drawn = (events(random, random.randrange(3, 7)) for _ in range(30))
        traces = [trace for trace in drawn if first_violation(tree(name), trace, tree(name).assumes) is None][:8]
        monitor = language.read(query)
        for trace, first in zip(traces, monitor.first_detections(traces), strict=True):  # type: ignore[attr-defined]
            verdicts = [*Reference(tree(name), semantics).run(trace)]
            expected = verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in verdicts else None
            assert (first, name, trace) == (expected, name, trace), query
            found += expected is not None
    assert found or semantics is Semantics.STRICT


@pytest.mark.parametrize("name", sampled(TREES, 3))
def test_all_matches_are_those_of_the_definition_and_assumptions_are_stated(name: str) -> None:
    for result in cross_check(tree(name), backends=["sql-table"]):
        if result.participant == "sql-table":
            assert result.status in (Status.TESTED, Status.VACUOUS), result
            assert result.status is Status.VACUOUS or "assumes types, present" in result.text


@pytest.mark.parametrize("language", ["sql-table", pytest.param("sql-table-duckdb", marks=needs_duckdb)])
@pytest.mark.parametrize("file", sorted(Path("trees/detections").resolve().glob("*.rvaft")), ids=lambda file: file.stem)
def test_detections_of_public_content_are_those_of_the_engine(file: Path, language: str) -> None:
    tree = load(file)
    if file.stem == "ros_goal":
        with pytest.raises(NotExpressible, match="columns of numbers are doubles, and need `assume exact;`"):
            backend(language).translate(tree, Semantics.SCATTERED)
        return
    text = backend(language).translate(tree, Semantics.SCATTERED).text
    traces = [[*read(log)] for log in sorted(file.with_suffix(".traces").iterdir())]
    traces = [trace for trace in traces if first_violation(tree, trace, tree.assumes) is None]
    found = backend(language).read(text).first_detections(traces)  # type: ignore[attr-defined]
    verdicts = [[*monitor(tree, semantics="scattered").run(trace)] for trace in traces]
    assert found == [run.index(Verdict.TRUE) + 1 if Verdict.TRUE in run else None for run in verdicts]
    assert any(found)


@needs_duckdb
def test_a_text_runs_on_a_table_that_somebody_made(tmp_path: Path) -> None:
    import duckdb

    log = duckdb.connect()
    log.execute("CREATE TABLE auth (id INT, ts TIMESTAMP, kind TEXT, user_name TEXT, n INT, ok BOOLEAN, w REAL, m INT)")
    start = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC).replace(tzinfo=None)
    rows = [
        ("login", "anna", 1, False, 1.0, None),
        ("su", "anna", None, None, None, 2),
        ("su", "anna", None, None, None, 0),
    ]
    for number, row in enumerate(rows):
        cells = [number, start + datetime.timedelta(seconds=number), *row]
        log.execute("INSERT INTO auth VALUES (?, ?, ?, ?, ?, ?, ?, ?)", cells)
    options = ("--columns", "event=kind,user=user_name,inner.n=m", "--time", "ts:timestamp", "--position", "id")
    (file := tmp_path / "joined.rvaft").write_text(EVENTS + TREES["joined"], "utf-8")
    done = run("emit", file, "--to", "sql", "--dialect", "duckdb", "--table", "auth", *options)
    assert done.exit_code == 0, done.stderr
    assert log.execute(done.stdout).fetchall() == [(2, 1, '{"a": 0, "b": 1, "c": 2}', "anna", 1, 2)]


@needs_sqlglot
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("java") is None or not find_spec("pyspark"), reason="needs Spark")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.xdist_group("spark")
def test_sqlglot_writes_a_query_with_the_same_rows_for_spark() -> None:
    from tests.integrations.test_spark import session_of

    spark, random = session_of(), Random(3)
    language = SqlBackend().mapped({"table": "log", "position": "id", "time": "ts:ms", "dialect": "spark"})
    query = language.translate(tree("joined"), Semantics.SCATTERED).text
    trace = [event for event in events(random, 60) if event.get("event") in ("login", "su")]
    rows = [
        (number, one["t"], one["event"], one["user"], one.get("n"), one.get("ok"), one.get("inner", {}).get("n"))
        for number, one in enumerate(trace, 1)
    ]
    rows = [(*row[:6], None if row[6] is None else int(row[6])) for row in rows]
    columns = "id INT, ts BIGINT, event STRING, user STRING, n INT, ok BOOLEAN, inner_n INT"
    spark.createDataFrame(rows, columns).createOrReplaceTempView("log")
    expected = matches(tree("joined"), Semantics.SCATTERED, trace)
    assert len(spark.sql(query).collect()) == len({*expected}) > 0


REFUSED = {
    "event e(u) = { u: u }; assume types, present; top on e(U);": "declare the type of parameter u of event e",
    "event e(u: text) = { u: u }; assume types; top on e(U);": "typed columns need `assume present;`",
    "event e(u: number) = { u: u }; assume types, present; top on e(U);": "columns of numbers are doubles, and need",
    "event e(u: text) = { u: u, v: _ }; assume types, present; top on e(U);": "make the `_` of v in event e a",
    "event e(u: text) = { u: u, v: {} }; assume types, present; top on e(U);": "a column holds no object, as v",
    "event e(u: text) = { u: [u] }; assume types, present; top on e(U);": "writes no lists",
    "event e(u: text) = { u: u }; event f() = { u: 1 }; assume types, present; top and a b; a on e(U); b on f();": (
        "u is text in event e but integer in the literal 1"
    ),
    "event e(u: text) = { u: u }; event f(v: integer) = { v: v }; assume types, present; top and a b; a on e(U); "
    "b on f(U);": "columns of two types are not compared",
    "event e(u: text) = { u: u }; event f(v: integer) = { v: v }; assume types, present; top and a; a on e(U) "
    "without f(U) before;": "columns of two types are not compared",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_columns_cannot_hold_is_refused(text: str) -> None:
    with pytest.raises(NotExpressible, match=r"\S") as refusal:
        backend("sql-table").translate(loads(text), Semantics.SCATTERED)
    assert REFUSED[text] in str(refusal.value)


def test_a_subquery_on_times_is_not_written_by_sqlglot() -> None:
    text = (
        "time t as s; event e(u: text) = { u: u }; assume types, present; top on e(U) without e(V) when V != U for 1 s"
    )
    language = SqlBackend().mapped({"table": "log", "position": "id", "time": "ts:s", "dialect": "trino"})
    with pytest.raises(NotExpressible, match=r"`without … after` is a subquery .* does not write for trino \(at top\)"):
        language.translate(loads(f"{text} after;"), Semantics.SCATTERED)


WRONG = {
    "--columns a=b": "--columns describes a table: name the table with --table",
    "--table x": "the tree compares times: name the column of t as the time",
    "--table x --time ts --columns usr=u": "the tree reads no field usr; fields: event, inner.n, n, ok, user, w",
    "--table x --time ts --columns u": "'u' is not FIELD=COLUMN",
    "--table x --time ts --columns user=a,user=b": "a field has two columns",
    "--table x --time ts --columns user=ok": "two fields have the column ok",
    "--table x --time ts:days": "no column of times has the type days",
    "--table x --time ts:timestamp": "sqlite has no timestamps",
    "--table x --time ts --dialect spark": "rows have no order in spark",
    "--table x --time ts --dialect oracle": "unknown dialect oracle; known: sqlite, duckdb, postgres, athena, bigquery",
    '--table x" --time ts': "is no name of a column or table",
    "--to rml --table x": "--table is for sql and kql, not for rml",
}


@pytest.mark.parametrize("options", WRONG)
def test_a_wrong_description_of_a_table_is_an_error(options: str, tmp_path: Path) -> None:
    (file := tmp_path / "joined.rvaft").write_text(EVENTS + TREES["joined"], "utf-8")
    done = run("emit", file, "--to", "sql", *options.split(" "))
    assert (done.exit_code, done.stdout) == (2, "")
    assert WRONG[options] in done.stderr


@pytest.mark.parametrize(
    "event",
    [
        {"event": "su", "user": "a\0", "inner": {"n": 1}},
        {"event": "su", "user": "a", "inner": {"n": 2**70}},
        {"event": "login", "user": "a", "n": 1, "ok": True, "w": 2**53 + 1},
        {"event": "su", "user": "a", "inner": {"n": 1}, "t": 0.5},
    ],
)
def test_what_a_column_does_not_hold_exactly_is_said(event: Any) -> None:
    language = SqlBackend().mapped({"table": "log", "time": "t:ms"})
    monitor = language.read(language.translate(tree("joined"), Semantics.SCATTERED).text)
    if event["event"] == "login":
        language = SqlBackend().mapped({"table": "log"})
        monitor = language.read(language.translate(tree("unequal"), Semantics.SCATTERED).text)
    assert monitor.left_open is not None
    assert "which the table cannot hold" in monitor.left_open([event])


def test_the_position_may_be_the_column_of_the_time() -> None:
    language = SqlBackend().mapped({"table": "log", "position": "t", "time": "t:ms", "dialect": "duckdb"})
    text = language.translate(tree("joined"), Semantics.PROJECTED).text
    assert "SELECT t AS pos, t * 1000000 AS time, " in text
    language = SqlBackend().mapped({"table": "log", "position": "t", "time": "t:ns", "dialect": "duckdb"})
    assert "SELECT t AS pos, t AS time, " in language.translate(tree("joined"), Semantics.PROJECTED).text


def test_a_mapping_that_is_no_table_is_an_error() -> None:
    for mapping in ({}, {"table": ""}, {"table": "x", "colums": {}}, {"table": "x", "columns": []}):
        with pytest.raises(OptionError):
            SqlBackend().mapped(mapping)
