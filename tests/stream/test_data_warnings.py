"""What could have been part of a match and was not is counted, however the log is read, and what
`scattered` makes of a ⊥.
"""

import json
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft import loads
from rvaft.integrations.ros.protocol import Session
from rvaft.model.guards import value, variables
from rvaft.model.values import is_number
from rvaft.stream import semantics_hint
from rvaft.stream.data_warnings import MOST, DataWarnings
from rvaft.stream.semantics_hint import SemanticsHint
from rvaft.stream.statistics import EventTypeIndex
from tests.cli.runs import lines, run, started, written

EVENTS = "event e(v) = { e: v }; event f(v) = { f: v }; event d(v) = { d: { v: v } };"
"""Two types that the shape of an event decides, and one that it does not."""


def seen(tree: str, events: Sequence[dict[str, Any]]) -> DataWarnings:
    types = EventTypeIndex(loads(tree))
    found = DataWarnings(types)
    for number, event in enumerate(events, 1):
        found.see(event, number, "", types.of(event))
    return found


@pytest.mark.parametrize(
    ("guard", "events", "count", "first"),
    [
        ("X > 1", [{"e": 2}, {"e": "a"}, {"e": None}, {"f": "a"}], 2, 2),
        ("not X > 1", [{"e": []}], 1, 1),
        ("X + 1 > Y", [{"e": "a"}, {"f": 1}], 1, 1),  # whatever Y is
        ("X > Y", [{"e": "a"}, {"e": "b"}, {"f": "a"}], 0, 0),
        ("X > Y", [{"e": "a"}, {"f": 1}, {"f": 2.0}, {"e": 1}], 2, 2),
        ("X > Y", [{"e": {}}], 1, 1),
        ("X == Y or X + Y > 3", [{"e": "a"}, {"f": "a"}], 0, 0),  # the left side decides
        ("X == Y or X > Y", [{"e": "a"}, {"f": 1}], 1, 2),
        ("X == Y", [{"e": "a"}, {"f": 1}, {"e": None}], 0, 0),
        ("1 / X > Y", [{"e": 1}, {"f": 1}, {"e": 0}], 1, 3),
        ("number(X) > Y", [{"f": 1}, {"e": "1"}, {"e": "one"}], 1, 3),
        ("startswith(X, \"a\") and Y == 1", [{"e": "a"}, {"e": 5}, {"f": 1}], 1, 2),
        ("X", [{"e": True}, {"e": 1}], 1, 2),
        ("Z > 1", [{"d": {"v": 1}}, {"d": {"v": "a"}}, {"d": {}}, {"d": {"v": []}}], 2, 2),
    ],
)  # fmt: skip
def test_guards(guard: str, events: list[dict[str, Any]], count: int, first: int) -> None:
    tree = f"{EVENTS} top sand a b c g; a on e(X); b on f(Y); c on d(Z); g when {guard};"
    found = [(one.count, one.first) for one in seen(tree, events).found.values()]
    assert found == ([(count, f"event {first}")] if count else [])


@given(st.lists(st.sampled_from([0, 1, 2.5, "a", "b", True, None]), min_size=1, max_size=6), st.integers(0, 5))
def test_the_guard_of_one_event_is_told_exactly_where_it_is_undefined(values: list[Any], which: int) -> None:
    guards = ("X > 1", "X == 1 or X > 1", "not 1 / X > 1", "X * 2 > 1 and X != 2.5", "number(X) > 0", "min(X, 1) < 1")
    tree = loads(f"{EVENTS} top or a b; a on e(X) when {guards[which]}; b;")
    guard = tree.nodes["a"].when
    assert guard is not None
    assert variables(guard) == ("X",)
    wrong = [number for number, one in enumerate(values, 1) if not isinstance(value(guard, {"X": one}), bool)]
    found = list(
        seen(f"{EVENTS} top or a b; a on e(X) when {guards[which]}; b;", [{"e": one} for one in values]).found.values()
    )
    assert [(one.count, one.first) for one in found] == ([(len(wrong), f"event {wrong[0]}")] if wrong else [])
    assert all(not is_number(values[number - 1]) or which == 2 for number in wrong)


def test_of_very_many_guards_the_first_are_told() -> None:
    leaves = "".join(f"a{n} on e(X{n}) when X{n} > {n};" for n in range(MOST + 5))
    found = seen(f"{EVENTS} top or {' '.join(f'a{n}' for n in range(MOST + 5))}; {leaves}", [{"e": "a"}])
    assert [len(list(found.lines)), list(found.lines)[-1]] == [MOST + 1, "5 more warnings"]


def test_an_ignored_event_needs_no_time_and_a_guard_of_an_ignore_counts() -> None:
    tree = f"{EVENTS} time t as s; top or a b; a on e(X); b; ignore e(V) when V < 0;"
    found = seen(tree, [{"e": -1}, {"e": "x", "t": 5}, {"z": 1}])
    assert [*found.lines] == [
        'undefined guard in 1 event: V < 0 of an ignore, where V is a string ("x") (first: event 2)'
    ]


def test_counts_are_pickled_and_added() -> None:
    tree = f"{EVENTS} top or a b; a on e(X) when X > 1; b;"
    one, other = seen(tree, [{"e": "a"}]), seen(tree, [{"e": 2}, {"e": "b"}, {"e": "c"}])
    again: DataWarnings = pickle.loads(pickle.dumps(one))
    again.attach(EventTypeIndex(loads(tree)))
    again.merge(other)
    assert [*again.lines] == ['undefined guard in 3 events: X > 1 of a, where X is a string ("a") (first: event 1)']


@pytest.mark.parametrize(
    ("name", "bound", "said"), [("ROOM", 3, "event 4"), ("LIMIT", 1, "event 1"), ("SECONDS", -1.0, "event 1")]
)
def test_looking_back_is_bounded(name: str, bound: float, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(semantics_hint, name, bound)
    found = SemanticsHint(loads("event e(v) = { e: v }; top sand a b; a on e(X); b on e(Y) when Y == X - 5;"))
    for number in range(1, 9):
        found.keep(1, number, {"e": number})
    found.look(1, "")
    assert str(found.line).endswith(f"they were tried up to {said} only, where it took too long")


# -- one time far ahead --------------------------------------------------------------------------------------------

LATE: Final = "time ts as s late 60 s; semantics scattered; top sand a b;"
FAR: Final = 4_070_908_800


def timed(*events: tuple[str, float]) -> str:
    return lines([{"event": name, "ts": time, "k": 1} for name, time in events])


def far_ahead(tmp_path: Path, data: str, *words: object) -> tuple[list[str], str]:
    """What a run says at once of a time far ahead, and in the end."""
    tree, log = written(tmp_path / "late.rvaft", LATE), written(tmp_path / "log.jsonl", data)
    result = run("monitor", tree, log, *words)
    assert result.exit_code == 0
    at_once = [line for line in result.stderr.splitlines() if "which is late, as others" in line]
    return at_once, "".join(line for line in result.stdout.splitlines() if "ahead" in line)


@pytest.mark.parametrize("words", [[], ["--key", "k"], ["--semantics", "projected"], ["--repeat"], ["--per", "branch"]])
def test_an_event_far_ahead_is_named_at_once_and_the_late_events_are_counted(words: list[str], tmp_path: Path) -> None:
    """An irrelevant event of another century takes `b` away."""
    data = "\n" + timed(("a", 100), ("zzz", FAR), ("b", 160), ("x", 161))
    at_once, counted = far_ahead(tmp_path, data, *words)
    said = "event 2 (line 3) is 47117 d ahead of event 3, which is late, as others like it may be"
    assert at_once == [f"rvaft: warning: {said}: no match uses them"]
    assert counted == (
        "warning: 2 events late after one time that is more than 1 min ahead: event 2 (line 3) is 47117 d ahead "
        "(first: event 3)"
    )


@pytest.mark.parametrize(
    ("data", "named"),
    [
        ([("zzz", FAR), ("a", 100), ("b", 101)], "event 1 is 47117 d ahead of event 2"),
        ([("a", 1), ("y", FAR), ("z", FAR + 1e6), ("b", 2)], "event 2 is 47117 d ahead of event 4"),
        ([("a", 1), ("x", 9000), ("b", 30)], "event 2 is 2.5 h ahead of event 3"),
        ([("a", 1), ("x", 9000), ("b", 9001), ("a", 20000), ("b", 20001)], None),  # pauses
        ([("a", 100), ("x", 150), ("x", 200), ("b", 110)], None),  # late, but nothing jumps
        ([("a", 100), ("x", 160), ("b", 40), ("b", 39)], None),
    ],
)
def test_what_is_far_ahead(data: list[tuple[str, float]], named: str | None, tmp_path: Path) -> None:
    tree, log = written(tmp_path / "late.rvaft", LATE), written(tmp_path / "log.jsonl", timed(*data))
    result = run("monitor", tree, log, "--format", "jsonl")
    assert ("ahead of" in result.stderr, named is not None and named in result.stderr) == (named is not None,) * 2


def test_several_logs_a_resumed_run_and_other_commands(tmp_path: Path) -> None:
    tree = written(tmp_path / "late.rvaft", LATE)
    data = timed(("a", 100), ("zzz", FAR), ("b", 160))
    first, second = (written(tmp_path / f"{name}.jsonl", data) for name in "xy")
    one, two = (run("monitor", tree, first, second, "--jobs", jobs) for jobs in (1, 2))
    assert (one.stdout, one.stderr) == (two.stdout, two.stderr)
    assert [line.split(": ")[2] for line in one.stderr.splitlines()] == [str(first), str(second)]
    words = "monitor", tree, first, "--checkpoint", tmp_path / "state", "--order-by", "k", "--window", 1
    assert "event 2 is" in run(*words).stderr
    with first.open("a") as stream:
        stream.write(timed(("b", 161)))
    assert "2 events late after" in run(*words).stdout
    assert "late after one time that is more than 1 min ahead" in run("coverage", tree, first).stdout
    assert "which is late, as others" in run("report", tree, first, "-o", tmp_path / "page.html").stderr
    session = Session(loads(LATE))
    for event in map(json.loads, data.splitlines()):
        session.read(event, event)
    assert any("late after" in line for line in session.data_warnings.lines)


def test_a_growing_log_says_at_once_that_an_event_is_far_ahead(tmp_path: Path) -> None:
    tree = written(tmp_path / "late.rvaft", LATE)
    log = written(tmp_path / "log.jsonl", timed(("a", 100), ("zzz", FAR), ("b", 160)))
    with started("monitor", tree, log, "--follow") as running:
        assert "event 2 is 47117 d ahead of event 3" in running.stderr.readline()
