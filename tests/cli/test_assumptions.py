"""Broken assumptions are counted, and the first is shown, however a log is read."""

from pathlib import Path

import pytest

from tests.cli.runs import run, written

TREE = """
event login(user: text, n: integer) = { event: "login", user: user, n: n };
time t as s;
assume types, present, case, order 1 s;
top sand a b;
a on login("root", _);
b on login(_, 3);
"""
LOG = """\
{"event": "login", "user": "Root", "n": 1, "t": 5, "k": 1}
{"event": "login", "user": 7, "n": 1, "t": 6, "k": 2}
{"event": "login", "user": "a", "n": "2", "t": 7, "k": 1}
{"event": "login", "user": "a", "t": 2, "k": 2}
{"event": "other", "user": 7, "t": 8, "k": 1}
"""
CASE = 'assumption \'case\' broken in 1 event: user is "Root", which matches "root" only without case (first: '
TYPES = "assumption 'types' broken in 2 events: user is the number 7, not of type text (first: "
PRESENT = "assumption 'present' broken in 1 event: n is absent (first: "


@pytest.mark.parametrize(
    ("words", "further"),
    [
        ("monitor", "1 event later than 1 s"),
        ("monitor --key k", "1 event later than 1 s"),
        ("monitor --order-by t", ""),
        ("monitor --semantics scattered", "1 event later than 1 s"),
        (
            "monitor --semantics scattered --backend sql",
            "assumption 'order' broken in 1 event: it is more than 1 s older",
        ),
        ("coverage", "1 event later than 1 s"),
    ],
)
def test_broken_assumptions_are_counted(words: str, further: str, tmp_path: Path) -> None:
    tree, log = written(tmp_path / "t.rvaft", TREE), written(tmp_path / "l.jsonl", LOG)
    command, *options = words.split()
    result = run(command, tree, log, *options)
    for text in (CASE, TYPES, PRESENT, further):
        assert text in result.output


def test_several_traces_and_columns(tmp_path: Path) -> None:
    tree, log = written(tmp_path / "t.rvaft", TREE), written(tmp_path / "l.jsonl", LOG)
    output = run("monitor", tree, log, written(tmp_path / "m.jsonl", LOG)).output
    assert CASE.replace("1 event", "2 events") in output
    assert TYPES.replace("2 events", "4 events") in output
    table = written(tmp_path / "l.csv", "event,user,n,t\nlogin,root,x,5\nlogin,ROOT,3,6\n")
    output = run("monitor", tree, table).output
    assert "assumption 'types' broken in 1 event: n is a text, not of type integer (first: event 1)" in output


def test_a_resumed_run_counts_what_the_first_counted(tmp_path: Path) -> None:
    tree, mark = written(tmp_path / "t.rvaft", TREE), tmp_path / "mark"
    log = written(tmp_path / "l.jsonl", "".join(LOG.splitlines(keepends=True)[:2]))
    run("monitor", tree, log, "--checkpoint", mark)
    written(tmp_path / "l.jsonl", LOG)
    output = run("monitor", tree, log, "--checkpoint", mark).output
    assert CASE in output
    assert TYPES in output
    assert PRESENT in output
