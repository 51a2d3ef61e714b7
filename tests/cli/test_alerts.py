"""Detections as alerts and by templates, and the lines of events."""

import gzip
import json
import random
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.cli.runs import run, written
from tests.tables import rows

TREE = """
event e(x, s, y) = { e: x, src: s, y: y };
event f(x) = { f: x };
time ts as s;
show S, Y;
top sand a rest attack label "theft" tags="attack.t1110.001,attack.credential-access" level=high
  reference="https://example.org/theft" category=authentication author=me;
rest or b c;
a on e(X, S, Y) times 2;
b on f(X);
c on f("no");
"""
EVENTS = (
    '{"e": "\\u001b[31mbob\\u202e", "src": "10.0.0.1", "y": 7, "ts": 1}',
    '{"e": "\\u001b[31mbob\\u202e", "src": "10.0.0.1", "y": 7, "ts": 2, "user": {"name": "bob"}, "source.ip": "1.1"}',
    '{"f": "\\u001b[31mbob\\u202e", "ts": 9, "user": {"name": "al"}, "host": {"name": ["a", {}]}}',
)
LOG = "\n{}\n\n{}\n{}\n".format(*EVENTS)
SCHEMA_1_4 = {
    *("activity_id", "category_uid", "class_uid", "type_uid", "severity_id", "time", "metadata", "finding_info"),
}
"""The required attributes of a Detection Finding in OCSF 1.4.0."""


def alerts(tmp_path: Path, *options: str, tree: str = TREE, log: str = LOG) -> list[dict[str, Any]]:
    files = written(tmp_path / "t.rvaft", tree), written(tmp_path / "l.jsonl", log)
    result = run("monitor", *files, "--semantics", "scattered", *options)
    assert result.exit_code == 1, result.output
    return [json.loads(line) for line in result.stdout.splitlines()]


@pytest.mark.parametrize(("template", "printed"), rows(__file__, "templates.txt"))
def test_a_template_prints_a_line_for_each_detection(template: str, printed: str, tmp_path: Path) -> None:
    files = written(tmp_path / "t.rvaft", TREE), written(tmp_path / "l.jsonl", LOG)
    result = run("monitor", *files, "--semantics", "scattered", "--template", template)
    if printed.startswith("!"):
        assert (result.exit_code, result.stdout) == (2, "")
        assert printed[1:] in result.stderr
        assert result.stderr.count("\n") == 1
    else:
        assert (result.exit_code, result.stdout) == (1, f"{printed}\n")


def test_a_template_names_absent_events(tmp_path: Path) -> None:
    tree = "semantics scattered; time t as s; event b(r) = { b: r }; lost on b(R) without b(R) for 2 s after;"
    files = written(tmp_path / "t.rvaft", tree), written(tmp_path / "l.jsonl", '{"b": 1, "t": 0}\n')
    result = run("monitor", *files, "--complete", "--template", "{R}: {absent}")
    robot, _, absent = result.stdout.partition(": ")
    told = {"node": "lost", "event": "b(R)", "side": "after", "duration": 2_000_000_000, "after": 1, "before": None}
    assert (robot, json.loads(absent)) == ("1", told)


def test_a_template_from_a_file_and_refusals(tmp_path: Path) -> None:
    template = "@" + str(written(tmp_path / "a.txt", '{\n "x": {root}\n}\n'))
    assert alerts(tmp_path, "--template", template) == [{"x": "top"}]
    tree, log = tmp_path / "t.rvaft", tmp_path / "l.jsonl"
    (tmp_path / "a.txt").write_bytes(b"\xff")
    for options, said in (
        (["--template", template], "is not UTF-8"),
        (["--template", "x", "--format", "ecs"], "exclude each other"),
        (["--template", "x", "--backend", "sql"], "--template needs the engine"),
        (["--format", "sigma", "--backend", "sql"], "--format sigma needs the engine"),
        (["--format", "ocsf", "--explain"], "name a FILE"),
    ):
        result = run("monitor", tree, log, *options)
        assert result.exit_code == 2
        assert said in result.stderr


def test_ecs(tmp_path: Path) -> None:
    (alert,) = alerts(tmp_path, "--format", "ecs")
    identity = alert["event"].pop("id")
    assert alert["@timestamp"] == "1970-01-01T00:00:09.000Z"
    assert alert["event"] == {
        "kind": "alert",
        "module": "rvaft",
        "dataset": "rvaft.alert",
        "category": ["authentication"],
        "severity": 4,
        "start": "1970-01-01T00:00:01.000Z",
        "end": "1970-01-01T00:00:09.000Z",
    }
    assert alert["threat"] == {
        "framework": "MITRE ATT&CK",
        "tactic": {"id": ["TA0006"], "name": ["Credential Access"]},
        "technique": {"id": ["T1110"], "subtechnique": {"id": ["T1110.001"]}},
    }
    assert alert["related"] == {"user": ["al", "bob"], "ip": ["1.1"]}
    assert alert["rule"]["reference"] == "https://example.org/theft"
    assert [one["line"] for one in alert["rvaft"]["matched"]] == [2, 4, 5]
    again = alerts(tmp_path, "--format", "ecs")[0]["event"]["id"]
    other = alerts(tmp_path, "--format", "ecs", log=f"\n{LOG}")[0]["event"]["id"]
    assert (again == identity, other == identity) == (True, False)


def test_ocsf(tmp_path: Path) -> None:
    (alert,) = alerts(tmp_path, "--format", "ocsf")
    assert alert.keys() >= SCHEMA_1_4
    assert (alert["class_uid"], alert["type_uid"], alert["time"], alert["severity_id"]) == (2004, 200401, 9000, 4)
    assert alert["metadata"]["version"] == "1.4.0"
    assert alert["metadata"]["product"].keys() >= {"name", "vendor_name"}
    finding = alert["finding_info"]
    assert finding.keys() >= {"uid", "title"}
    assert finding["attacks"] == [
        {"tactic": {"uid": "TA0006"}},
        {"technique": {"uid": "T1110"}, "sub_technique": {"uid": "T1110.001"}},
    ]
    assert [one["data"]["document"] for one in alert["evidences"]] == [*map(json.loads, EVENTS)]


def test_a_match_of_sigma_has_the_id_of_the_emitted_rule(tmp_path: Path) -> None:
    tree = 'time ts as s; top sand a b label "theft" level=low tags=attack.t1110;'
    log = '{"event": "a", "ts": 1}\n{"event": "b", "ts": "soon"}\n{"event": "a", "ts": 1}\n{"event": "b", "ts": 8}\n'
    first, second = alerts(tmp_path, "--format", "sigma", "--repeat", tree=tree, log=log)
    text = run("emit", tmp_path / "t.rvaft", "--to", "sigma", "--semantics", "scattered").stdout
    rule = [*yaml.safe_load_all(text)][-1]
    for key in ("title", "id", "status", "description", "level", "tags"):
        assert first[key] == rule[key]
    assert (first["detection"], second["detection"], second["timestamp"]) == (1, 2, "1970-01-01T00:00:08.000Z")
    assert str(first["timestamp"]) > "2020", "an event without a readable time has the time of the run"
    assert [one["document"] for one in second["matches"]] == [{"event": "a", "ts": 1}, {"event": "b", "ts": 8}]


def test_every_option_that_reads_differently_gives_the_same_lines(tmp_path: Path) -> None:
    random.seed(4)
    lines = list[str]()
    for number in range(9000):
        lines += [""] * (random.random() < 0.02)
        event = EVENTS[(1500, 6500, 8500).index(number)] if number in (1500, 6500, 8500) else '{"q": 1, "ts": 0}'
        lines.append(event.replace('"ts": ', f'"k": "v", "n": {number}, "ts": 1'))
    wanted = [at for at, line in enumerate(lines, 1) if '"q"' not in line and line]
    tree, log = written(tmp_path / "t.rvaft", TREE), written(tmp_path / "l.jsonl", "\n".join(lines))
    upside_down = written(tmp_path / "d.jsonl", "\n".join(reversed(lines)))
    (tmp_path / "l.jsonl.gz").write_bytes(gzip.compress(Path(log).read_bytes()))
    back = [len(lines) + 1 - at for at in wanted]
    for file, options, expected in (
        (log, [], wanted),
        (f"{log}.gz", [], wanted),
        (log, ["--jobs", "2"], wanted),
        (log, ["--key", "k"], wanted),
        (log, ["--order-by", "n"], wanted),
        (log, ["--exec", "true"], wanted),
        (log, ["--checkpoint", str(tmp_path / "c")], wanted),
        (log, ["--order-by", "n", "--checkpoint", str(tmp_path / "o"), "--checkpoint-every", "1500"], wanted),
        (upside_down, ["--order-by", "n", "--window", "10000"], back),
        (upside_down, ["--order-by", "n", "--window", "10000", "--jobs", "2"], back),
        (upside_down, ["--order-by", "n", "--window", "10000", "--exec", "true"], back),
    ):
        words = ["--semantics", "scattered", "--format", "jsonl", "--detections", *options]
        result = run("monitor", tree, file, *words)
        (found,) = map(json.loads, result.stdout.splitlines())
        assert [one["line"] for one in found["matched"]] == expected, (options, result.stderr)
        assert found["line"] == expected[-1]
    found = json.loads(run("monitor", tree, *words[:5], data=Path(log).read_bytes()).stdout)
    assert [one["line"] for one in found["matched"]] == wanted


@pytest.mark.parametrize(
    ("name", "text", "options", "lines"),
    [
        ("l.csv", "event,n\nx,1\na,2\nb,3\n", "", [3, 4]),
        ("l.log", "junk\nevent=x\nevent=a\njunk\nevent=b\n", "--input regex --pattern event=(?P<event>.*)", [3, 5]),
        ("l.json", '[{"event": "a"},\n\n{"event": "b"}]', "", [None, None]),
    ],
)
def test_lines_of_other_formats(name: str, text: str, options: str, lines: list[int | None], tmp_path: Path) -> None:
    tree, log = written(tmp_path / "t.rvaft", "top sand a b;"), written(tmp_path / name, text)
    words = ["--semantics", "scattered", "--format", "jsonl", "--detections"]
    found = json.loads(run("monitor", tree, log, *words, *options.split()).stdout)
    assert [one["line"] for one in found["matched"]] == lines


def test_text_names_a_line_that_is_not_the_number_of_the_event(tmp_path: Path) -> None:
    tree, log = written(tmp_path / "t.rvaft", TREE), written(tmp_path / "l.jsonl", LOG)
    text = run("monitor", tree, log).output
    assert "event 3 (line 5): true" in text
    assert "  events 1 (line 2) and 2 (line 4) at 2 are a" in text
    plain = run("monitor", tree, written(tmp_path / "p.jsonl", "\n".join(EVENTS))).output
    assert "line" not in plain


def test_show_changes_warnings_only(tmp_path: Path) -> None:
    tree = written(tmp_path / "t.rvaft", TREE.replace("show S, Y;", ""))
    shown, log = written(tmp_path / "s.rvaft", TREE), written(tmp_path / "l.jsonl", LOG)
    assert run("monitor", tree, log).output == run("monitor", shown, log).output
    wrong = run("check", written(tmp_path / "w.rvaft", TREE.replace("show S", "show Ss")))
    assert wrong.exit_code == 1
    assert "`show` lists Ss, which no event of a node binds; did you mean S? [shown-variable]" in wrong.output
