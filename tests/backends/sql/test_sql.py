"""SQL: what events it tells apart, what it refuses, what is read by hand, and what SQLite and
DuckDB make of the same tree.
"""

import json
import re
import shutil
import sqlite3
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from random import Random
from typing import Any

import pytest

from backends.sql import SqlBackend, SqlDuckdbBackend, SqlPostgresBackend
from cross_check.comparison import cross_check
from rvaft import (
    RVAFT,
    Backend,
    EventType,
    Gate,
    LanguageError,
    Node,
    NotExpressible,
    On,
    OptionError,
    Semantics,
    TooLarge,
    ToolFailed,
    ToolMissing,
    TraceError,
    Verdict,
    load,
    loads,
    translate,
)
from rvaft import backend as backends
from rvaft.backend import SpecificationText, backend
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.semantics import Reference, matches
from tests.backends.injections import INJECTIONS
from tests.backends.texts import flat, signs
from tests.cli.runs import run
from tests.tables import sampled

HERE = Path(__file__).parent
READING = [
    SqlBackend(),
    pytest.param(SqlDuckdbBackend(), marks=pytest.mark.skipif(not find_spec("duckdb"), reason="needs DuckDB")),
]


COUNTED = {
    "in a window": 'top and f within 3 s; f on e("a", U) times 3;',
    "before another": 'top sand g b; g and f within 4 s; f on e("a", U) times 3; b on e("b", U);',
    "after another": 'top sand b f within 5 s; f on e("a", U) when U > 0 times 4; b on e("b", _);',
    "absences": 'top sand f b; f on e("a", U) times 3 without e("b", V) when V >= U; b on e("c", _) without e("b", _) '
    "for 1 s before;",
    "an absence after": 'top and f b; b on e("c", _) without e("b", _) for 2 s after; f on e("a", U) times 3 '
    'without e("c", _) for 1 s after;',
    "an absence before": 'top and f b; f on e("a", U) times 3 without e("b", _) before; b on e("c", _);',
    "absence of its own events": 'top and f; f on e("a", U) times 3 without e(_, V) when V != U;',
    "ends": 'top pand f g; f on e("a", U) times 3; g and b c; b on e("b", _); c on e("c", _);',
    "events of another node": 'top and f g; f on e("a", U) times 3; g on e("a", U);',
    "another condition on times": 'top and f g when end(f) <= start(g) + 1 s; f on e("a", U) times 3; g on e("b", U);',
    "different values": 'top sand f g; f on e("a", U) times 3 distinct U; g on e("b", _);',
    "different values in a window": 'top and f within 3 s; f on x("a", U, V) times 3 distinct U;',
    "pairs of values in a window": 'top and f within 2 s; f on x("a", U, V) times 4 distinct U, V;',
    "different values that are tied": 'top and f within 3 s; f on x("a", U, V) when V >= U times 3 distinct V;',
    "different values of one node": 'top on x("a", U, V) when V != U times 3 distinct V;',
    "different values after another": 'top sand b f within 5 s; f on x("a", U, V) times 3 distinct V; b on e("b", _);',
    "different values before another": 'top sand g b; g and f within 4 s; f on x("a", U, V) times 3 distinct V; '
    'b on e("b", U);',
    "two counts": 'top sand f g within 9 s; f on x("a", _, V) times 3 distinct V; g on x("b", U, W) times 3 each W;',
    "inner windows": 'top and g b within 5 s; g and f within 2 s; f on x("a", U, V) times 3 distinct V; '
    'b on e("b", U);',
    "different values and absences": 'top and f within 3 s; f on x("a", U, V) times 3 distinct V without e("b", U) '
    'without e("c", _) for 1 s after;',
    "each value": 'top and f within 3 s; f on x("a", U, V) when V > 0 times 3 each V;',
    "each value of a node": 'top sand b f; f on x("a", U, V) when V >= U times 3 each V; b on e("b", U);',
    "values of another node": 'top sand b f; f on x("a", U, V) when V > K times 3 each V; b on e("b", K);',
    "each and distinct": 'top and f within 4 s; f on x("a", U, V) when V < 3 times 3 distinct U each V;',
}
JOINED = (
    "absence of its own events",
    "events of another node",
    "another condition on times",
    "an absence before",
    "values of another node",
)


@pytest.mark.parametrize(("name", "late"), sampled(product(COUNTED, ["late 0 s", "late 1 s", ""]), 11, ci=5))
@pytest.mark.parametrize("language", READING)
def test_counted_leaves(language: SqlBackend, name: str, late: str) -> None:
    """As one row where that makes no difference, on events with equal, missing and earlier times."""
    head = "event e(n, u) = { event: n, u: u }; event x(n, u, v) = { event: n, u: u, v: v };"
    tree = loads(f"{head} time t as s {late}; {COUNTED[name]}")
    specification = language.translate(tree, Semantics.SCATTERED)
    if late == "late 0 s":
        assert ("count_1" in specification.text) == (name not in JOINED)
    random, traces = Random(f"{name} {late}"), list[list[Any]]()
    for _ in range(160):
        now, trace, letters = 0, list[Any](), random.choice(("aaaabc", "aaabbb"))
        for _ in range(random.randrange(4, 15)):
            now += random.choice((0, 0, 1, 1, 2, random.choice((-1, 1))))
            event: dict[str, Any] = {"event": random.choice(letters), "u": random.choice((0, 1, 1, 1.0, 2))}
            if random.random() < 0.95:
                event["v"] = random.choice((0, 1, 1.0, 2, 3, "x", None))
            trace.append(event if random.random() < 0.06 else {**event, "t": now})
        traces.append(trace)
    verdicts = [[*Reference(tree, Semantics.SCATTERED).run(trace)] for trace in traces]
    wanted = [run.index(Verdict.TRUE) + 1 if Verdict.TRUE in run else None for run in verdicts]
    monitor = specification.monitor()
    assert monitor.first_detections(traces) == wanted, specification.text  # type: ignore[attr-defined]
    assert any(wanted)


NEAREST = {
    "heartbeat": 'top and h; h on e("a", U) without e("a", U) for 2 s after;',
    "two heartbeats": 'top and h g; h on e("a", U) without e("a", U) for 1 s after; '
    'g on e("b", V) without e("b", V) for 2 s after without e("c", _) for 1 s after;',
    "a part": 'top sand g c; g sand a b within 3 s without e("d", U) for 1 s after; a on e("a", U); b on e("b", U); '
    'c on e("c", _);',
    "own values": 'top on e("a", _) without e("b", V) when V > 0 for 1 s after;',
    "first seen": 'top on e("a", U) without e("a", U) for 2 s before;',
    "ever": 'top sand a b; a on e("a", U); b on e("b", U) without e("c", U) before without e("d", _) for 1 s before;',
    "between": 'top sand a b without e("c", U); a on e("a", U); b on e("b", U);',
    "between, and any": 'top sand a b c without e("d", V) when V != 1; a on e("a", U); b on e("b", U); c on e("c", _);',
    "count": 'top and f; f on e("a", U) times 3 without e("b", U) for 1 s after;',
    "branches": 'top or a b; a on e("a", U) without e("b", U) for 1 s after; b on e("c", U) without e("b", U) before;',
}


@pytest.mark.skipif(not find_spec("duckdb"), reason="needs DuckDB")
@pytest.mark.parametrize(("name", "late"), sampled(product(NEAREST, ["late 0 s", "late 1 s", ""]), 11, ci=2))
def test_the_nearest_absent_event(name: str, late: str) -> None:
    """By joins with the nearest row, in logs whose times go back, stand still and are absent."""
    compare_nearest(name, late, 150)


def compare_nearest(name: str, late: str, count: int) -> None:
    tree = loads(f"event e(n, u) = {{ event: n, u: u }}; time t as s {late}; toplevel top; {NEAREST[name]}")
    specification = SqlDuckdbBackend().translate(tree, Semantics.SCATTERED)
    assert "ASOF LEFT JOIN" in specification.text
    assert "NOT EXISTS" not in specification.text
    random, traces = Random(f"{name} {late}"), list[list[Any]]()
    for _ in range(count):
        now, trace, letters = 0, list[Any](), random.choice(("aabbcd", "aab", "abc", "aaac"))
        for _ in range(random.randrange(2, 12)):
            now += random.choice((0, 0, 1, 1, 2, random.choice((-1, 1)), random.choice((-3, 4, 1))))
            event = {"event": random.choice(letters), "u": random.choice((0, 1, 1, 1.0, 2))}
            trace.append(event if random.random() < 0.06 else {**event, "t": now})
        traces.append(trace)
    verdicts = [[*Reference(tree, Semantics.SCATTERED).run(trace)] for trace in traces]
    wanted = [run.index(Verdict.TRUE) + 1 if Verdict.TRUE in run else None for run in verdicts]
    monitor = specification.monitor()
    assert monitor.first_detections(traces) == wanted, specification.text  # type: ignore[attr-defined]
    assert 3 < sum(one is not None for one in wanted) < count
    found = SqlDuckdbBackend().matches(specification.text, traces)
    assert (found is None) == (name == "count" and late == "late 0 s")
    assert found is None or [*found] == [matches(tree, Semantics.SCATTERED, trace) for trace in traces]


@pytest.mark.skipif(not find_spec("duckdb"), reason="needs DuckDB")
@pytest.mark.parametrize("name", ["heartbeat", "own values", "first seen", "between, and any"])
def test_long_logs_have_the_same_matches_in_both_dialects(name: str) -> None:
    """Where the clocks of some values are ahead of others, and all times jump."""
    tree = loads(f"event e(n, u) = {{ event: n, u: u }}; time t as s; toplevel top; {NEAREST[name]}")
    random, now, trace = Random(name), 0, list[Any]()
    for place in range(300):
        now += random.choice((0, 0, 1, 2))
        user = random.randrange(4)
        ahead = 4 * (user == 3) + 100 * (place == 40) + random.choice((0, 0, -2))
        trace.append({"event": random.choice("aaabbcd"), "u": user, "t": now + ahead})
    found, wanted = (
        language.matches(language.translate(tree, Semantics.SCATTERED).text, [trace])
        for language in (SqlDuckdbBackend(), SqlBackend())
    )
    assert found is not None
    assert found == wanted != [frozenset()]


SHIFTED = {
    "the deadline": ("heartbeat", "", r"2000000000 < d\.time", "2000000000 <= d.time"),
    "the first deadline": ("heartbeat", "", r" UNION ALL SELECT m\.\* EXCLUDE.*", ""),
    "a later node": ("heartbeat", "", r"THEN 2 \* s\.node ELSE", "THEN 2 * s.node + 1 ELSE"),
    "the next node": ("heartbeat", "", r"ELSE s\.node \+ 1 END", "ELSE s.node + 2 END"),
    "the bound of a node": ("heartbeat", "", r"t\.top > s\.bound", "t.top >= s.bound"),
    "the highest time": ("heartbeat", "", "IS NULL OR time > found", "IS NULL OR time < found"),
    "the event that decides": ("heartbeat", "", r"q\.pos >= m\.decided", "q.pos > m.decided"),
    "a later breach": ("own values", "late 1 s", r"q\.found > m\.last_time_1", "q.time > m.last_time_1"),
    "an earlier breach": ("first seen", "", r"q\.found < m\.first_time_1", "q.time < m.first_time_1"),
    "the last moment": ("own values", "late 0 s", r"q\.found > m", "q.found >= m"),
    "the first moment": ("first seen", "", r"q\.found < m", "q.found <= m"),
    "values": ("between", "", r" AND m\.key_1_0 = q\.v1_key", ""),
    "the end": ("between", "", r"q\.pos >= m\.last_pos_1", "q.pos < m.last_pos_1"),
}


@pytest.mark.ci
@pytest.mark.skipif(not find_spec("duckdb"), reason="needs DuckDB")
@pytest.mark.parametrize("fault", sampled(SHIFTED, 4))
def test_a_wrong_absence_is_found(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, late, right, wrong = SHIFTED[fault]
    write = SqlDuckdbBackend.write

    def faulty(self: SqlDuckdbBackend, *given: Any) -> SpecificationText:
        text = write(self, *given)
        changed = re.sub(right, wrong, text.text)
        if changed == text.text:
            raise LookupError(text.text)
        return SpecificationText(changed, text.metrics)

    monkeypatch.setattr(SqlDuckdbBackend, "write", faulty)
    with pytest.raises(AssertionError):
        compare_nearest(name, late, 600)


def tree_with(text: str) -> tuple[RVAFT, list[Any]]:
    """A tree that has the text as the name of a node, of an event, of a field and as a literal, and
    a trace that it detects.
    """
    inner = ObjectPattern(((text, Literal(1)),))
    event = EventType(f"{text} ", (), ObjectPattern(((text, Literal(text)), (f"{text}.", inner))))
    named = f"{text}!"
    nodes = [Node("top ", Gate.SAND, (text, named), label=text), Node(text, on=On(event.name, ())), Node(named)]
    return RVAFT("top ", nodes, [event]), [{text: text, f"{text}.": {text: 1.0}}, {"event": named}]


WITHOUT_NUL = [text for text in INJECTIONS if "\0" not in text]


def rows(name: str) -> list[Any]:
    lines = (HERE / name).read_text("utf-8").splitlines()
    return [json.loads(line) for line in lines if line and not line.startswith("#")]


def first(language: Backend, tree: Any, semantics: Semantics, events: list[Any]) -> int | None:
    monitor = language.read(language.translate(tree, semantics).text)
    return monitor.first_detections([events])[0]  # type: ignore[attr-defined,no-any-return]


@pytest.mark.parametrize("language", READING)
def test_events_are_told_apart_as_the_definition_tells_them(language: Backend) -> None:
    for text, named, events, expected in rows("events.txt"):
        tree, semantics = loads(text), Semantics(named)
        assert [*Reference(tree, semantics).run(events)].count(Verdict.TRUE) == (
            len(events) - expected + 1 if expected else 0
        ), text
        assert first(language, tree, semantics, events) == expected, text


@pytest.mark.parametrize("language", READING)
def test_what_users_write_stays_in_its_place(language: Backend) -> None:
    for text in WITHOUT_NUL:
        tree, trace = tree_with(text)
        for semantics in Semantics if language.name == "sql" else [Semantics.SCATTERED]:
            assert first(language, tree, semantics, trace) == 2, text
            assert first(language, tree, semantics, [trace[0], {"event": text}]) is None, text


@pytest.mark.skipif(shutil.which("psql") is None, reason="needs PostgreSQL's psql")
def test_a_text_for_postgres_is_one_statement_on_one_table() -> None:
    for text in WITHOUT_NUL:
        made = SqlPostgresBackend().translate(tree_with(text)[0], Semantics.PROJECTED)
        code = re.sub(r"'(?:[^']|'')*'", "", re.sub(r"^--.*$", "", made.text, flags=re.MULTILINE))
        assert ";" not in code
        assert "--" not in code
        assert set(re.findall(r"FROM (\w+)", code)) <= {"events", "place_1", "n1", "n2"}
        with pytest.raises(OptionError, match="sql-postgres is only emitted"):
            made.monitor()


@pytest.mark.parametrize("language", READING)
def test_parts_of_a_comparison_that_are_calculated_stand_once(language: Backend) -> None:
    guard = "((number(V) / 4 + 1) * 3 - number(lower(V))) / 7 + abs(number(V)) < max(number(V) * 2, 8) / 3"
    tree = loads(f"event e(x) = {{ x: x }}; r and a b; a on e(V) when {guard}; b;")
    assert len(language.translate(tree, Semantics.SCATTERED).text) < 30_000
    assert first(language, tree, Semantics.SCATTERED, [{"x": "80"}, {"event": "b"}, {"x": "1"}]) == 3
    long, longer = (loads(f"event e(x) = {{ x: x }}; r on e(X) when X{' + X' * steps} > 0;") for steps in (25, 80))
    assert first(language, long, Semantics.SCATTERED, [{"x": 0.5}]) == 1
    with pytest.raises(NotExpressible, match="a comparison has more than 100 steps of calculation"):
        language.translate(longer, Semantics.SCATTERED)


@pytest.mark.parametrize("event", [{"x": float("nan")}, {"x": [2**63]}, {"a\0": 1}, {"t": 10**30, "event": "a"}])
def test_what_a_table_does_not_keep_is_an_error_and_never_another_value(event: dict[str, Any]) -> None:
    monitor = SqlBackend().translate(loads("time t as s; r and a b within 1 s;"), Semantics.SCATTERED).monitor()
    with pytest.raises(TraceError, match=r"^<trace>:1: an? (number|integer|string|time)"):
        monitor.step(event)
    large = (
        SqlBackend().translate(loads("event e(x) = { x: x }; r on e(X) when X * X == 1;"), Semantics.STRICT).monitor()
    )
    with pytest.raises(ToolFailed, match="malformed JSON"):  # what the query does where a product has more than 64 bits
        large.step({"x": 2**40})


def test_a_query_is_text() -> None:
    for dialect in ("sql", "sql-duckdb"):
        with pytest.raises(LanguageError, match="half of a surrogate pair"):
            backend(dialect).read("SELECT 1 AS trace, 1 AS detected WHERE '\ud800' > ''")


@pytest.mark.ci
def test_the_limit_counts_events_that_are_joined() -> None:
    with pytest.raises(TooLarge, match=r"\(limit 3\)"):
        SqlBackend().translate(loads("r or a b c d;"), Semantics.STRICT, limit=3)
    for gate, size in ((Gate.SAND, 61), (Gate.SAND, 3_000)):
        with pytest.raises(TooLarge):
            SqlBackend().translate(flat(gate, size), Semantics.STRICT)
    for semantics in Semantics:
        with pytest.raises(TooLarge):
            SqlBackend().translate(flat(Gate.VOT, 40, 20), semantics)


@pytest.mark.parametrize("semantics", ["scattered", "consecutive"])
@pytest.mark.parametrize("dialect", ["sqlite", "duckdb", "postgres"])
def test_pinned(dialect: str, semantics: str) -> None:
    pinned = HERE / "pinned" / f"sensor.{semantics}.{dialect}.sql"
    name = SqlBackend.dialect_backend(dialect)
    assert translate(load(str(HERE / "pinned" / "sensor.rvaft")), name, semantics=semantics).text == pinned.read_text(
        "utf-8"
    )


def test_rows_have_branch_nodes_and_variables_and_pass_a_result_of_several_traces() -> None:
    tree = loads('event at(p) = { at: p }; top or x y; x sand a b; y on at("z"); a on at(P); b on at(P);')
    query = SqlBackend().translate(tree, Semantics.SCATTERED).text
    connection = sqlite3.connect(":memory:")
    connection.execute("CREATE TABLE events (trace, pos, event, time)")
    events = [(0, 1, '{"at": "é"}'), (0, 5, '{"at": "\\u00e9"}'), (1, 1, '{"at": "é"}'), (2, 9, '{"at": "z"}')]
    connection.executemany("INSERT INTO events VALUES (?, ?, ?, NULL)", events)
    assert connection.execute(query).fetchall() == [
        (0, 5, 1, '{"a": 1, "b": 5}', '{"P": "é"}'),
        (2, 9, 2, '{"y": 9}', "{}"),
    ]


RIGHT = """
SELECT max(b.pos, c.pos) AS detected FROM events a, events b, events c
WHERE a.event ->> '$.event' = 'a' AND b.event ->> '$.event' = 'b' AND c.event ->> '$.event' = 'c'
  AND a.pos < b.pos AND b.pos < c.pos;
-- by hand
"""


def test_queries_by_hand_are_held_against_a_tree(tmp_path: Path) -> None:
    (tmp_path / "right.sql").write_text(RIGHT, "utf-8")
    (tmp_path / "wrong.sql").write_text(RIGHT.replace(" AND b.pos < c.pos", ""), "utf-8")
    files = [str(tmp_path / name) for name in ("right.sql", "wrong.sql")]
    tree = loads("top sand a b c;")
    _, right, wrong = cross_check(tree, "scattered", against=files)
    assert (right.status, right.detections_only, right.matched) == ("tested", True, 0)
    assert wrong.difference is not None
    assert [event["event"] for event in wrong.difference.trace] in (["a", "c", "b"], ["c", "a", "b"])


EDITS = {  # of the text of `trees/gates` and others: what a wrong translation would write
    "an order is dropped": (r"\n  AND (e\d\.(pos|place) < e\d\.\2|e\d\.place = \d)", ""),
    "another event is not asked for": (r"\n  AND e\d\.(pos|place) <> e\d\.\1", ""),
    "traces are mixed": (r"(WHERE|\n  AND) e2\.trace = e1\.trace", r"\1 true"),
    "a variable is not tied": (r"\n  AND e2\.v1_key = e1\.v1_key", ""),
    "the wrong column is joined": (r"e2\.v1_key = e1\.v1_key", "e2.v1_key = e1.trace"),
    "a place more": (r"(place <= |BETWEEN 1 AND )2", r"\g<1>3"),
    "a guard is dropped": (r" AND coalesce\(CASE WHEN json_type\(event, '\$\.v'\).*?>= 3.*(?=\n)", ""),
    "a window one unit longer": (r"(<=|AND) 5000000000", r"\1 6000000000"),
    "one group for all traces": (r" GROUP BY n\.trace(?=\s)", ""),
    "the greatest position first": (r"min\(n\.pos\)", "max(n.pos)"),
    "what is ignored counts": (r" AND \([^\n]*\) IS NOT TRUE", ""),
    "late events are used": (r"NOT late", "true"),
    "a start is not shared": (r"\n  AND e2\.start = e1\.start", ""),
    "windows are not one": (r"\n  AND e\d\.s1 = e1\.s1", ""),
    "a window has no start": (r"BETWEEN 0 AND", "<="),
    "the next event has any value": (r" AND f\d\.v1_key = n\.v1_key", ""),
}
EDITED = (
    (
        "event e(k, v) = { k: k, v: v }; time t as s late 3 s; r sand a b c; ignore e(9, _); c; "
        'a on e("x", V); b on e("x", V) when V >= 3;'
    ),
    'event e(k) = { k: k }; r and a b; a on e("x"); b on e("x");',
    "time t as s; r and a b within 5 s;",
    'time t as s; event e(k, v) = { k: k, v: v }; r and a b within 5 s; a on e("x", V) times 3; b on e("y", V);',
    "r sand a b;",
)
WORDS: list[list[Any]] = (
    [
        [{"event": name, "t": time} for name, time in pairs]
        for pairs in (
            [("a", 0), ("b", 6)],
            [("b", 0), ("a", 1)],
            [("a", 0)],
            [("b", 0)],
            [("a", 0), ("a", 1), ("b", 2), ("b", 3)],
            [("z", 1), ("a", 1), ("b", 1)],
        )
    ]
    + [
        [{"k": "x", "v": v, "t": t} for v, t in pairs] + [{"event": "c", "t": 9}]
        for pairs in ([(3, 8), (3, 8)], [(3, 8), (4, 8)], [(2, 8), (2, 8)], [(3, 9), (3, 1)], [(3, 1), (3, 9)])
    ]
    + [
        [{"k": "x", "v": 3, "t": 1}, {"k": 9, "v": 1, "t": 1}, {"k": "x", "v": 3, "t": 1}, {"event": "c", "t": 1}],
        [{"k": "x", "t": 0}],
    ]
)
WORDS += [
    [{"k": "xy"[y], "v": v, "t": t} for y, v, t in word]
    for word in (
        [(0, 1, 0), (0, 1, 1), (0, 1, 2), (1, 1, 6)],
        [(0, 1, 9), (0, 1, 8), (0, 1, 7), (1, 1, 1)],
        [(0, 1, 1), (0, 2, 1), (0, 2, 2), (1, 2, 3)],
        [(1, 2, 3), (0, 1, 0), (0, 2, 8), (0, 2, 3), (0, 2, 4)],
    )
]
WORDS += [
    [{"event": "c", "t": 1}, {"k": "x", "v": 3, "t": 1}, {"k": "x", "v": 3, "t": 1}],
    [{"event": "b"}, {"event": "x"}, {"event": "a"}, {"event": "b"}],
]


@pytest.mark.parametrize("edit", EDITS)
def test_a_wrong_text_shows(edit: str) -> None:
    pattern, by = EDITS[edit]
    for text in EDITED:
        for semantics in Semantics:
            tree = loads(text)
            made = SqlBackend().translate(tree, semantics).text
            wrong = re.sub(pattern, by, made)
            if wrong == made:
                continue
            expected = [
                min((max(n for _, n in match) for match in matches(tree, semantics, word)), default=None)
                for word in WORDS
            ]
            assert SqlBackend().read(made).first_detections(WORDS) == expected, made  # type: ignore[attr-defined]
            if SqlBackend().read(wrong).first_detections(WORDS) != expected:  # type: ignore[attr-defined]
                return
    raise AssertionError(edit)


def test_a_match_that_is_missing_shows_where_detections_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    class Once(SqlBackend):
        def matches(self, text: str, traces: Any) -> Any:
            return [frozenset(sorted(found, key=sorted)[:1]) for found in super().matches(text, traces) or ()]

    event = 'event e(k) = { k: k }; r and a b; a on e("x"); b on e("x");'
    right, *_ = [one for one in cross_check(loads(event), "scattered", backends=["sql"]) if one.participant == "sql"]
    assert right.matched > 0
    assert f"all matches of {right.matched}" in right.text
    monkeypatch.setattr(
        "cross_check.participants.backend", lambda name: Once() if name == "sql" else backends.backend(name)
    )
    wrong, *_ = [one for one in cross_check(loads(event), "scattered", backends=["sql"]) if one.participant == "sql"]
    assert wrong.difference is not None
    assert wrong.difference.expected[-1] is wrong.difference.got[-1] is Verdict.TRUE
    assert re.fullmatch(r"a match is missing: [ab] \d, [ab] \d", wrong.difference.match)


def test_dialects_and_tools_that_are_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    for arguments, message in (
        (("--to", "sql", "--dialect", "oracle"), "unknown dialect oracle; known: sqlite, duckdb, postgres"),
        (("--to", "sql-duckdb", "--dialect", "sqlite"), "sql-duckdb is the dialect duckdb: name sql for sqlite"),
        (("--to", "rml", "--dialect", "duckdb"), "rml has no dialects"),
        (("--to", "dot", "--dialect", "duckdb"), "omit --dialect"),
    ):
        done = run("emit", "trees/gates/and.rvaft", *arguments)
        assert (
            done.exit_code,
            len(re.findall(r"^rvaft: error: ", done.stderr, re.MULTILINE)),
            "Traceback" in done.stderr,
        ) == (2, 1, False)
        assert message in done.stderr
    done = run("emit", "trees/gates/and.rvaft", "--to", "sql", "--dialect", "postgres")
    assert done.stdout.startswith("-- rvaft sql postgres\n")
    done = run("monitor", "trees/gates/and.rvaft", "--backend", "sql-postgres", "--word", "a b c")
    assert (done.exit_code, "error: sql-postgres is only emitted" in done.stderr) == (2, True)
    monkeypatch.setitem(__import__("sys").modules, "duckdb", None)
    with pytest.raises(ToolMissing, match=r"pip install '.\[duckdb\]'"):
        backend("sql-duckdb").read("SELECT 2 AS detected")
    assert signs(backend("sql").read("SELECT 2 AS detected FROM events WHERE pos = 2"), "a b") == "?T"


def test_one_query_in_duckdb_is_one_statement() -> None:
    pytest.importorskip("duckdb")
    for text in (
        "SELECT 1 AS detected); DROP TABLE events; SELECT * FROM (SELECT 1",
        "SELECT 1 AS detected FROM read_csv('/etc/passwd')",
    ):
        with pytest.raises(LanguageError):
            backend("sql-duckdb").read(text)
