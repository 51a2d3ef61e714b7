"""`rvaft fields` and `rvaft infer`: what is counted, and that the inferred tree holds on its log."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rvaft
from rvaft.model.assumptions import AssumptionCheck
from rvaft.reports.log_fields import KINDS, SAMPLE, LogFields, fields_json, inferred_tree
from tests.cli.runs import run

ROOT = Path(__file__).parents[2]
SUFFIXES = frozenset({".jsonl", ".csv", ".syslog", ".mcap", ".xes", ".parquet", ".gz", ".json"})
LOGS = sorted(
    path
    for folder in ("docs/logs", "docs/first", "docs/backends", "trees")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in SUFFIXES and not path.name.endswith(("verdicts.json", "mapping.json"))
)


def counted(events: list[dict[str, Any]], by: str | None = None) -> LogFields:
    """The fields of these events."""
    found = LogFields(by)
    for event in events:
        found.add(event)
    found.finish()
    return found


def broken(text: str, events: list[dict[str, Any]]) -> list[str]:
    """What events break of the assumptions of a tree in this text."""
    check = AssumptionCheck(rvaft.loads(text))
    return [str(one) for event in events for one in check.broken(event)]


def test_there_are_logs() -> None:
    assert len(LOGS) > 50


@pytest.mark.ci
def test_all_shipped_logs(tmp_path: Path) -> None:
    """Each tree is accepted by `rvaft check`, detects its log, and the log breaks none of its assumptions."""
    for log in LOGS:
        if not any(rvaft.read_log(log, warn=lambda _: None)):
            continue
        tree = tmp_path / "inferred.rvaft"
        done = run("infer", log, "-o", tree)
        assert done.exit_code == 0, (log, done.stderr)
        checked = run("check", tree)
        assert checked.exit_code == 0, (log, checked.stdout)
        watched = run("monitor", tree, log)
        assert watched.exit_code == 1, (log, watched.stderr)
        assert "assumption" not in watched.stderr, (log, watched.stderr)
        assert "no event of type" not in watched.stderr, (log, watched.stderr)
        assert json.loads(run("fields", log, "--format", "json").stdout)["events"] > 0, log


_NAMES = st.sampled_from(["event", "a", "B", "_c", "é", "two words", "ts", "time", "true", "", "a.b", "1", "topic"])
_TEXTS = st.sampled_from(["login", "LOGIN", "ß", "SS", "", "4", "_", "2026-03-02T08:00:00Z", "2026-03-02T07:59:58.5Z"])
_NUMBERS = st.sampled_from([0, 1, -3, 2**53, 10**20, 1.0, 2.5, 1e300, 1_772_438_400, 1_772_438_390])
_VALUES = st.recursive(
    st.none() | st.booleans() | _TEXTS | _NUMBERS,
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(_NAMES, inner, max_size=3),
    max_leaves=6,
)
_EVENTS = st.lists(st.dictionaries(_NAMES, _VALUES, max_size=5), min_size=1, max_size=12)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(_EVENTS, st.sampled_from([None, "event", "a", "a.b"]))
def test_any_log(events: list[dict[str, Any]], by: str | None) -> None:
    """An inferred tree parses, has no error, and holds on its log."""
    found = counted(events, by)
    if not found.kinds:
        return
    text = inferred_tree(found)
    assert not [one for one in rvaft.check(rvaft.loads(text)) if one.severity.value == "error"], text
    assert broken(text, events) == []
    assert sum(kind.events for kind in found.kinds) + found.without + found.others == len(events)


@pytest.mark.parametrize(
    ("events", "by", "time"),
    [
        ([{"event": "a", "x": 1}, {"event": "b"}], ("event",), None),
        ([{"eventName": "a", "type": "t"}, {"eventName": "b", "type": "t"}], ("eventName",), None),
        ([{"k": k, k: 1} for k in "abab"], ("k",), None),
        ([{"id": n, "x": "y"} for n in range(50)], None, None),
        ([{"event": "a", "ts": 1_772_438_400_123, "n": 5}], ("event",), "ts ms"),
        ([{"event": "a", "at": {"sec": 1, "nanosec": 2}}], ("event",), "at ros"),
        ([{"event": "a", "n": 5}, {"event": "a", "n": 6}], ("event",), None),
        ([{"event": "a", "made": "2026-03-02 08:00"}], ("event",), "made iso8601"),
    ],
)
def test_the_choice(events: list[dict[str, Any]], by: tuple[str, ...] | None, time: str | None) -> None:
    found = counted(events)
    assert found.by == by
    assert [f"{'.'.join(one.field)} {one.format}" for one in found.times[:1]] == ([time] if time else [])


def test_limits_are_stated() -> None:
    """What exceeds a limit is counted, and the tree says so."""
    events: list[dict[str, Any]] = [{"event": "a"}] * SAMPLE
    events += [{"event": f"k{number}"} for number in range(KINDS + 5)]
    found = counted([*events, {"x": 1}, {"event": "a", **{f"f{number}": 1 for number in range(300)}}, {"event": "A"}])
    assert (len(found.kinds), found.others, found.without) == (KINDS, 7, 1)
    text = inferred_tree(found)
    assert f"7 events are of kinds beyond the first {KINDS}" in text
    assert "values at paths beyond the first" in text
    assert "case" not in text.partition("assume ")[2].partition(";")[0]
    assert fields_json(found)["others"] == 7


@pytest.mark.parametrize(
    ("words", "data", "error"),
    [
        (("infer", "-"), "", "no events to infer"),
        (("fields", "-", "--by", "x"), '{"event": "a"}', "no event has a text or an integer in x"),
        (("fields", "-"), '{"event": "a"}\n{', "<stdin>:2:"),
        (("infer", "-", "--input", "csv"), "a,b\n1\n", "the header has 2"),
        (("fields", "mqtt://localhost/x"), "", "do not end"),
        (("fields", "nowhere.jsonl"), "", "nowhere.jsonl"),
        (("fields", str(ROOT / "docs/logs/access.log")), "", "--input syslog"),
    ],
)
def test_wrong_logs(words: tuple[str, ...], data: str, error: str) -> None:
    done = run(*words, data=data)
    assert done.exit_code == 2
    assert error in done.stderr
    assert done.stderr.count("\n") == 1
