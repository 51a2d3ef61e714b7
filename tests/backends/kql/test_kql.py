"""KQL: what it finds in tables of any shape, what the reader refuses, and which wrong texts are found."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from backends.kql import KqlBackend
from backends.kql.reader import KqlProgram
from cross_check.comparison import cross_check
from cross_check.results import Status
from rvaft import RVAFT, OptionError, Semantics, ToolFailed, Verdict, loads
from rvaft.backend import SpecificationText, backend
from rvaft.core.property import Property
from rvaft.model.assumptions import first_violation
from rvaft.semantics import Reference, matches
from tests.cli.runs import run
from tests.tables import sampled
from tests.trees import shipped

SCATTERED = Semantics.SCATTERED
EVENTS = """
event login(user: text, n: integer, ok: boolean, w: number) = { event: "login", user: user, n: n, ok: ok, w: w };
event su(user: text, n: integer) = { event: "su", user: user, inner: { n: n } };
assume types, present, exact; toplevel top;
"""
TREES = {
    "joined": "time t as ms; top sand a b c within 3 s; a on login(U, N, false, _); "
    "b on su(U, M) when M > N; c on su(U, _);",
    "texts": 'top and a b; a on login(U, _, _, _) when startswith(U, "an") or like(U, "?o*") or contains(U, "OB"); '
    'b on su(V, _) when V != U and not endswith(V, "a") and V in ("BOB", "bob", "dora");',
    "numbers": "top and a b; a on login(_, N, OK, W) when N + 1 < W or not OK; "
    "b on su(_, M) when max(M, N) - abs(M - N) <= -1 + 2 and M != N and M in (0, 2, 1.5);",
    "shared": "top and a b c; a on login(_, N, B, W); b on login(_, N, B, W); c on su(_, _);",
    "votes": "top 2of3 a b c; a on login(U, 1, _, _); b on su(U, 0); c on su(_, 2);",
    "window": "time t as ms; top 2of3 a b c within 1500 ms; a on login(U, _, _, _); b on su(U, _); c on su(_, 2);",
    "counted": "time t as ms; top sand a p within 4 s; a on login(_, _, _, _) times 2; "
    "p pand b c; b on su(U, 1); c on su(_, _);",
    "each": "time t as ms late 0 s; top sand a c within 4 s; a on login(U, N, _, _) when N > 0 times 3 each N; "
    "c on su(U, _);",
    "different": "time t as ms late 0 s; top sand c a; a on login(V, N, _, _) times 3 distinct V, N; c on su(_, _);",
    "without": "time t as ms; top sand a b within 3 s without login(_, K, _, _) without su(V, M) when M > K and V == U "
    "for 1500 ms before; a on login(U, K, _, _); b on su(U, N);",
    "without after": "time t as ms; top sand a b; a on login(U, _, _, W) without su(U, N) when N > W for 1 s after; "
    "b on su(_, _) without login(_, _, true, _) for 500 ms after;",
    "without after, in order": "time t as ms late 1 s; top or a b; a on login(U, _, _, _) without su(V, _) when V != U "
    "for 1 s after; b on su(_, 3) without su(_, 3) before;",
    "points": "time t as ms; top or p q; p and a b when at(b) - at(a) >= 1 s;  "
    "a on login(_, 1, _, _); b on su(_, _); q and c d when end(q) - start(q) < 1500 ms; c on su(_, 1); "
    "d on login(_, _, true, _) times 2;",
}
SHAPES: dict[str, dict[str, Any]] = {
    "plain": {"table": "SigninLogs", "position": "Id", "partition": "Host", "time": "At:timestamp"},
    "one log": {"table": "a.log-1", "position": "pos_1", "columns": {"event": "where", "user": "U_1"}, "time": "t:us"},
    "times": {"table": "user", "position": "TimeGenerated", "time": "TimeGenerated:timestamp"},
}


def made(name: str) -> RVAFT:
    return loads(EVENTS + TREES[name])


def traces(tree: RVAFT, count: int) -> Iterator[list[Any]]:
    random = Random(5)
    while count:
        trace, now = list[Any](), 0
        for _ in range(random.randrange(3, 8)):
            now += random.choice((1, 500, 1000, 1501))
            user: dict[str, Any] = {
                "user": random.choice(["bob", "BOB"] if random.random() < 0.9 else ["anna"]),
                "t": now,
            }
            login = {"event": "login", "n": random.randrange(4), "ok": random.random() < 0.5}
            other: dict[str, Any] = random.choice([{"event": "x", "user": 7}, {"inner": []}, {"event": None, "ok": 1}])
            kind = random.randrange(5)
            if kind < 2:
                trace.append({**user, **login, "w": random.choice((1, 2.5, 4.0, 0))})
            else:
                su = {"event": "su", "inner": {"n": random.choice((0, 1, 2.0, 3))}}
                trace.append({**user, **su} if kind < 4 else {"t": now, **other})
        if first_violation(tree, trace, tree.assumes) is None:
            count -= 1
            yield trace


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", sampled(TREES, 4))
def test_a_table_of_any_shape_has_the_matches_of_the_definition(name: str, shape: str) -> None:
    tree, options = made(name), SHAPES[shape]
    if tree.time is None and options["position"] == options["time"]:
        options = {**options, "position": "Id"}
    language = KqlBackend().mapped({key: value for key, value in options.items() if key != "time" or tree.time})
    text = language.translate(tree, SCATTERED).text
    logs = [*traces(tree, 80)]
    expected = [matches(tree, SCATTERED, trace) for trace in logs]
    verdicts = [[*Reference(tree, SCATTERED).run(trace)] for trace in logs]
    firsts = [run.index(Verdict.TRUE) + 1 if Verdict.TRUE in run else None for run in verdicts]
    assert language.read(text).first_detections(logs) == firsts, text
    found = language.matches(text, logs)
    assert (found is None) == (name in ("votes", "each", "different"))
    assert found is None or [*found] == expected, text
    assert 0 < sum(first is not None for first in firsts) < 80


DETECTIONS = [name for name in shipped.names() if name.startswith("detections/")]


@pytest.mark.parametrize("name", DETECTIONS)
def test_detections_have_their_stored_verdicts(name: str) -> None:
    tree, expected = (
        loads((shipped.TREES / f"{name}.rvaft").read_text("utf-8") + "assume exact;"),
        shipped.expected(name),
    )
    text = backend("kql").translate(tree, SCATTERED)
    for trace, events in shipped.traces(name):
        assert "".join(verdict.symbol for verdict in text.monitor().run(events)) == expected[trace][SCATTERED]["tree"]


SIMPLE = "time t as ms; top sand a b within 2 s; a on su(U, N); b on su(U, M) when M < N;"
FAULTS = {
    "no order": (SIMPLE, r"pos_1 < pos_2 and ", ""),
    "no distinctness": (TREES["shared"], r"pos_\d != pos_\d and ", ""),
    "no window": (SIMPLE, r" and abs\(.*?\) <= \d+", ""),
    "a shorter window": (SIMPLE, r"(?<=abs\(time_2 - time_1\)) <=", " <"),
    "a window of one side": (TREES["window"], r"abs\((.*?)\)", r"\1"),
    "a join on the log alone": (SIMPLE, r", \$left.U_1 == \$right.U_\d", ""),
    "a text anywhere": (
        'top sand a b; a on su(U, 1); b on su(V, 2) when startswith(V, "ab");',
        "startswith",
        "contains",
    ),
    "a sign": (SIMPLE, "M_2 < N_1", "M_2 <= N_1"),
    "a scenario": (TREES["points"], "union scenario_1, ", "union "),
    "an event of the match that breaks it": (
        "top and p q; p and a b without su(_, 1); q sand a c; a on su(_, 2); b on su(_, 3); c on su(_, 1);",
        r" and pos_4 != pos_\d",
        "",
    ),
}


@pytest.mark.parametrize("fault", sampled(FAULTS, 3))
def test_a_wrong_text_is_found(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, right, wrong = FAULTS[fault]

    class Faulty(KqlBackend):
        def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
            text = super().write(prop, semantics, limit)
            assert re.search(right, text.text), text.text
            return SpecificationText(re.sub(right, wrong, text.text), text.metrics)

    def status() -> Status:
        found = cross_check(loads(EVENTS + tree), SCATTERED, backends=["kql"])
        return next(one.status for one in found if one.participant == "kql")

    assert status() is Status.TESTED
    monkeypatch.setattr("cross_check.participants.backend", lambda name: Faulty() if name == "kql" else backend(name))
    assert status() is Status.DIFFERS


@pytest.mark.parametrize(
    ("tree", "broken"),
    [
        ("sand a b without su(_, 1)", "pos_1 < pos_3 and pos_3 < pos_2"),
        ("and a b without su(_, 1)", "min_of(pos_1, pos_2) < pos_3 and pos_3 < max_of(pos_1, pos_2) and {}"),
        ("sand a b without su(_, 1) before", "pos_3 < pos_1"),
        ("and a b without su(_, 1) before", "pos_3 < min_of(pos_1, pos_2)"),
        (
            "sand a b without su(_, 1) for 1 s after",
            "pos_2 < pos_3 and time_3 - {} <= 1000000000 and pos_3 < decided_1",
        ),
    ],
)
def test_an_event_that_the_order_excludes_is_not_told_apart(tree: str, broken: str) -> None:
    """A column that no join uses is left out, too."""
    text = backend("kql").translate(
        loads(f"{EVENTS} time t as ms; top {tree}; a on su(_, _); b on su(_, _);"), SCATTERED
    )
    (found,) = re.findall(r"absent_3 on .*\n\| where (.*)\n", text.text)
    assert found == broken.format(
        "pos_3 != pos_1 and pos_3 != pos_2" if "and {}" in broken else "max_of(time_1, time_2)"
    )
    assert "one_" not in text.text


WRONG = {
    "--table x --time ts": "rows have no order in KQL: name the column that orders them (--position COLUMN)",
    "--table x --position p": "the tree compares times: name the column of t as the time",
    "--table x --position p --time ts:double": "KQL rounds times in seconds: use a column of datetime",
    "--table x --position p --time ts --dialect sqlite": "kql has no dialects: omit --dialect sqlite",
    "--table x --position p --time a:b": "no column of times has the type b",
    "--table x --position a/b --time ts": '"a/b" is no name in KQL',
    "--table x --position __p --time ts": '"__p" is no name in KQL',
    "--dialect sqlite": "kql has no dialects",
    "--semantics projected": "use --semantics scattered",
    "--limit 2": "too large",
}


@pytest.mark.parametrize("options", WRONG)
def test_a_wrong_description_of_a_table_is_an_error(
    options: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("joined.rvaft").write_text(f"semantics scattered; {EVENTS}{TREES['joined']}", "utf-8")
    done = run("emit", "joined.rvaft", "--to", "kql", *options.split(" "))
    assert (done.exit_code, done.stdout) == (2, "")
    assert WRONG[options] in done.stderr


def test_a_column_that_orders_the_rows_is_a_time_that_increases() -> None:
    language = KqlBackend().mapped(SHAPES["times"])
    monitor = language.read(language.translate(made("joined"), SCATTERED).text)
    event = {"event": "su", "user": "a", "inner": {"n": 1}}
    for trace, reason in (
        ([{**event, "t": 1}, {**event, "t": 2}], ""),
        ([{**event, "t": 1}, {**event, "t": 1}], "do not increase"),
        ([event, {**event, "t": 1}], "do not increase"),
        ([{**event, "t": 1, "user": "a\0"}], "which the table cannot hold"),
    ):
        assert reason in monitor.left_open(trace)
        assert bool(reason) == bool(monitor.left_open(trace))


HEADER = '// table "T", position "p"\n// column "a" integer of ["a"]\n'


@pytest.mark.parametrize(
    ("result", "trace"),
    [
        ("detected = p + 5, nodes = bag_pack('a', p)".replace("'", '"'), [{"a": 1}]),
        ('detected = p, nodes = bag_pack("a", a)', [{"a": 7}]),
        ('detected = a + 9223372036854775807, nodes = bag_pack("a", p)', [{"a": 1}]),
    ],
)
def test_a_result_that_is_no_position_is_an_error(result: str, trace: Sequence[Any]) -> None:
    monitor = backend("kql").read(f"{HEADER}T | project {result}")
    with pytest.raises(ToolFailed):
        monitor.step(trace[0])


def test_a_query_by_hand_is_read() -> None:
    """Also nulls as in KQL: a comparison with null is null, and inequality is true."""
    text = f'{HEADER}let x = T | where a != 1 and not(a < 0);\nx | project nodes = bag_pack("a", p), detected = p;'
    monitor = backend("kql").read(text)
    found = monitor.first_detections([[{"a": 1}, {"a": 2}], [{"b": 1}], [{"a": None}]])  # type: ignore[attr-defined]
    assert found == [2, None, None]
    monitor = backend("kql").read(text.replace(" and not(a < 0)", ""))
    assert monitor.first_detections([[{"b": 1}]]) == [1]  # type: ignore[attr-defined]


def test_a_mapping_that_is_no_table_is_an_error() -> None:
    for mapping in ({}, {"table": "x"}, {"table": "x", "position": "p", "dialect": "kusto"}):
        with pytest.raises(OptionError):
            KqlBackend().mapped(mapping)


TYPED = "semantics scattered; time t as ns; event e(who: text, what: text) = { who: who, what: what }; "
TYPED += "assume types, present, case, order 0 s; "


@pytest.mark.parametrize(
    ("tree", "rows", "detected"),
    [
        # two sources with two different values each are no source with three
        ("top and a within 1 s; a on e(X, Y) times 3 distinct Y;", ["1ap", "1bq", "2aq", "2bp"], []),
        ("top and a within 1 s; a on e(X, Y) times 3 distinct Y;", ["1ap", "1bq", "2aq", "3ar"], [3]),
        # what breaks the match of one breaks no other at the same time
        ("new on e(X, Y) without e(X, Y) for 1 s before;", ["1ap", "2ap", "2bq"], [1, 2]),
    ],
)
def test_events_at_one_time_are_told_apart_by_their_values(tree: str, rows: list[str], detected: list[int]) -> None:
    program = KqlProgram(backend("kql").translate(loads(TYPED + tree), Semantics.SCATTERED).text)
    table = [{"trace": "", "pos": int(one[0]), "time": int(one[0]), "who": one[1], "what": one[2]} for one in rows]
    assert sorted({row["detected"] for row in program.query.of(table)}) == detected
