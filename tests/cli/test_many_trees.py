"""`rvaft monitor TREE... -- LOG...` and a folder of trees: what is said of each, and what is refused."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pytest

from tests.cli.runs import failed, lines, run, words, written

LOGIN: Final = 'event login(u) = { kind: "login", user: u };'
TREES: Final = {
    "apart.rvaft": f"{LOGIN} top sand x y; x on login(U); y on login(V) when V != U;",
    "same.rvaft": f"semantics scattered; {LOGIN} top sand x y; x on login(U); y on login(U);",
    "copies.rvaft": (
        'semantics scattered; time t as s; event copy(n) = { kind: "copy", n: n };'
        "bad and p q; p on copy(1); q on copy(2);"
    ),
    "never.rvaft": 'event never() = { kind: "never" }; top or n m; n on never(); m;',
    "loud.rvaft": 'semantics scattered; event copy(n) = { kind: "copy", n: n }; top or c d; c on copy(_); d;',
}
COMMON: Final = f"{LOGIN}\n"
EVENTS: Final[list[dict[str, Any]]] = [
    {"t": number, "kind": kind, "user": user, "n": 1 + number % 2, "noise": "x" * number}
    for number, (kind, user) in enumerate(
        [("login", "a"), ("other", "a"), ("copy", "b"), ("login", "b"), ("copy", "a"), ("login", "b"), ("copy", "c")]
        * 9
    )
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder `trees`, with a file that trees may import, and a log."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trees").mkdir()
    for name, text in {**TREES, "common.rvaft": COMMON}.items():
        written(tmp_path / "trees" / name, text)
    written(tmp_path / "log.jsonl", lines(EVENTS))
    written(tmp_path / "again.jsonl", lines(EVENTS[3:]))
    (tmp_path / "parts").mkdir()
    written(tmp_path / "parts" / "common.rvaft", COMMON)
    (tmp_path / "empty").mkdir()
    return tmp_path


def records(*args: object) -> list[dict[str, Any]]:
    return [json.loads(line) for line in run("monitor", *args).stdout.splitlines()]


OPTIONS: Final = (
    "",
    "--detections",
    "--repeat --detections",
    "--repeat",
    "--repeat --cooldown 3s --detections",
    "--key user --repeat",
    "--order-by t --repeat --detections",
    "--distinct n --detections",
    "--per branch --repeat --detections",
    "--semantics strict",
    "--strict-json --detections --jobs 2",
)


@pytest.mark.parametrize("options", OPTIONS)
def test_each_tree_is_monitored_as_if_it_were_alone(options: str, folder: Path) -> None:
    if "--cooldown" in options:
        for name in TREES:
            text = (folder / "trees" / name).read_text(encoding="utf-8")
            written(folder / "trees" / name, text if "time t" in text else f"time t as s; {text}")
    found = records("trees", "log.jsonl", "again.jsonl", "--format", "jsonl", *options.split())
    names = [f"trees/{name}" for name in sorted(TREES)]
    assert {one["tree"] for one in found} == {*names} if "--detections" not in options else found
    for name in names:
        own = [{key: value for key, value in one.items() if key != "tree"} for one in found if one["tree"] == name]
        assert own == records(name, "log.jsonl", "again.jsonl", "--format", "jsonl", *options.split()), name


def test_detections_come_in_the_order_of_events_and_trees(folder: Path) -> None:
    found = records("trees", "log.jsonl", "--format", "jsonl", "--repeat", "--detections")
    places = [(one["event"], one["tree"]) for one in found]
    assert places == sorted(places)
    assert len({tree for _, tree in places}) == len(TREES) - 1
    named = sorted((folder / "trees").glob("*s*.rvaft"), reverse=True)
    again = records(*named, "--format", "jsonl", "--repeat", "--detections", "--", "log.jsonl")
    order = [(one["event"], [*map(str, named)].index(one["tree"])) for one in again]
    assert order == sorted(order)


def test_the_summary_has_a_row_for_each_tree(folder: Path) -> None:
    result = run("monitor", "trees/apart.rvaft", "trees/never.rvaft", "--repeat", "--", "log.jsonl")
    assert result.exit_code == 1
    said = result.stdout.splitlines()
    assert said[0].startswith("trees/apart.rvaft: event ")
    assert f"trees: 2; events read: {len(EVENTS)}" in said
    assert "trees/apart.rvaft: relevant: login 27" in said
    assert "warning: trees/never.rvaft: no event of type never" in said
    rows = [line.split() for line in said if line.startswith("trees/") and ":" not in line]
    assert [(row[0], row[1]) for row in rows] == [(f"trees/{name}.rvaft", "63") for name in ("apart", "never")]
    assert int(rows[0][2]) > 1
    assert rows[1][2] == "0"


def test_the_status_is_that_of_any_tree(folder: Path) -> None:
    assert run("monitor", "trees/never.rvaft", "trees/apart.rvaft", "--", "log.jsonl").exit_code == 1
    written(folder / "none.jsonl", lines([{"kind": "x"}]))
    assert run("monitor", "trees/never.rvaft", "trees/apart.rvaft", "--", "none.jsonl").exit_code == 0
    data = (folder / "log.jsonl").read_text(encoding="utf-8")
    by_input = run("monitor", "trees/never.rvaft", "trees/apart.rvaft", "--", "-", data=data)
    assert by_input.exit_code == 1
    assert by_input.stdout == run("monitor", "trees/never.rvaft", "trees/apart.rvaft", "--", "log.jsonl").stdout


def test_one_tree_of_a_folder_is_as_one_tree(folder: Path) -> None:
    alone = folder / "alone"
    alone.mkdir()
    written(alone / "apart.rvaft", TREES["apart.rvaft"])
    for named in (["alone", "log.jsonl"], ["alone", "--", "log.jsonl"], ["alone/apart.rvaft", "--", "log.jsonl"]):
        assert run("monitor", *named).output == run("monitor", "alone/apart.rvaft", "log.jsonl").output


def test_a_tree_that_becomes_too_large_leaves_the_others(folder: Path) -> None:
    tree = f"semantics scattered; {LOGIN} top sand x y z; x on login(U); y on login(V); z on login(W) when W > V;"
    written(folder / "large.rvaft", tree)
    result = run("monitor", "large.rvaft", "trees/apart.rvaft", "--max-configurations", 1, "--", "log.jsonl")
    assert result.exit_code == 2
    assert "limit 1" in result.stderr
    assert "the tree is large.rvaft" in result.stderr
    assert "trees/apart.rvaft: event 4: true" in result.stdout
    assert "large.rvaft" in next(line for line in result.stdout.splitlines() if line.rstrip().endswith("error"))


def test_a_malformed_line_is_reported_once(folder: Path) -> None:
    written(folder / "torn.jsonl", lines(EVENTS[:5]) + "\n{")
    result = run("monitor", "trees", "torn.jsonl")
    failed(result, "torn.jsonl:7: ")
    assert "trees/apart.rvaft: event 4: true" in result.stdout


def test_a_warning_about_all_trees_is_said_once(folder: Path) -> None:
    written(folder / "back.jsonl", lines([{"kind": "login", "user": "a", "t": 5}, {"kind": "copy", "n": 1, "t": 2}]))
    trees = ["apart", "same"]
    for name in trees:
        text = (folder / "trees" / f"{name}.rvaft").read_text(encoding="utf-8")
        event = 'event copy(n) = { kind: "copy", n: n };'
        extra = text.replace("top sand x y;", "top or v w; v sand x y; w on copy(7); ")
        written(folder / f"{name}.rvaft", f"time t as s late 1 s; {event} {extra}")
    result = run("monitor", "apart.rvaft", "same.rvaft", "--", "back.jsonl")
    assert result.stderr.count("no match uses them") == 1
    assert "warning: all trees: 1 event later than 1 s" in result.stdout


@pytest.mark.parametrize("rest", ["", "--repeat --format jsonl", "--key user --repeat --format jsonl"])
def test_a_checkpoint_holds_all_trees(rest: str, folder: Path) -> None:
    options = ["--checkpoint", "kept", "--checkpoint-every", "1", *rest.split()]
    whole = run("monitor", "trees", "log.jsonl", *rest.split())
    (folder / "growing.jsonl").write_text("".join(f"{line}\n" for line in lines(EVENTS[:20]).splitlines()))
    first = run("monitor", "trees", "growing.jsonl", *options)
    (folder / "growing.jsonl").write_text("".join(f"{line}\n" for line in lines(EVENTS).splitlines()))
    second = run("monitor", "trees", "growing.jsonl", *options)
    assert (second.exit_code, second.stderr) == (1, "")
    if "jsonl" in rest:
        assert sorted(first.stdout.splitlines() + second.stdout.splitlines()) == sorted(whole.stdout.splitlines())
    else:
        assert [*second.stdout.splitlines()][-5:] == [*whole.stdout.splitlines()][-5:]
    other = run("monitor", "trees/apart.rvaft", "trees/same.rvaft", *options, "--", "growing.jsonl")
    failed(other, "this is a checkpoint of other trees")


def test_commands_and_alerts_name_the_tree(folder: Path) -> None:
    written(folder / "say.sh", 'cat >> "$1"\n')
    run("monitor", "trees", "log.jsonl", "--exec", "sh say.sh said")
    said = [json.loads(line) for line in (folder / "said").read_text(encoding="utf-8").splitlines()]
    names = {f"trees/{name}" for name in TREES} - {"trees/never.rvaft"}
    assert {one["tree"] for one in said} == names
    assert [one["event"] for one in said] == sorted(one["event"] for one in said)
    assert {one["rvaft"]["tree"] for one in records("trees", "log.jsonl", "--format", "ecs")} == names
    shown = run("monitor", "trees", "log.jsonl", "--template", "{tree} {event}").stdout.splitlines()
    assert {line.split()[0] for line in shown} == names


WRONG: Final = (
    ("trees/apart.rvaft trees/same.rvaft log.jsonl", ("trees/same.rvaft is a tree", "end them with --")),
    ("trees/apart.rvaft -- trees/same.rvaft", ("trees/same.rvaft is a tree",)),
    ("trees/apart.rvaft trees/same.rvaft --", ("no log after --",)),
    ("trees/apart.rvaft trees/apart.rvaft -- log.jsonl", ("given twice",)),
    ("trees/apart.rvaft ./trees/apart.rvaft -- log.jsonl", ("given twice, also as trees/apart.rvaft",)),
    ("trees trees/apart.rvaft -- log.jsonl", ("given twice",)),
    ("trees/apart.rvaft trees/same.rvaft log.jsonl -- log.jsonl", ("before -- stand trees only", "log.jsonl is none")),
    ("trees/apart.rvaft trees/same.rvaft -- log.jsonl --repeat", ("--repeat stands after --", "before it")),
    ("parts log.jsonl", ("only declare what trees import",)),
    ("empty log.jsonl", ("empty: Is a directory without a tree",)),
    ("trees nowhere.jsonl", ("nowhere.jsonl: No such file",)),
    ("trees/apart.rvaft nowhere.rvaft -- log.jsonl", ("nowhere.rvaft: cannot read the file",)),
    ("trees log.jsonl --native", ("--native is for one tree",)),
    ("trees log.jsonl --engine duckdb", ("--engine is for one tree",)),
    ("trees log.jsonl --foxglove x.mcap", ("--foxglove is for one tree",)),
    ("trees log.jsonl --branch 1", ("--branch is for one tree",)),
    ("trees log.jsonl --kind attack", ("no branch has the kind attack", "the tree is trees/apart.rvaft")),
    ("trees log.jsonl --format table", ("--format table is for one tree",)),
    ("trees log.jsonl --explain x.svg", ("--explain FILE is for one tree",)),
    ("trees log.jsonl --template {V}", ("unknown placeholder {V}", "the tree is trees/copies.rvaft")),
)


@pytest.mark.parametrize(("command", "said"), WRONG)
def test_what_is_wrong_is_refused_with_a_reason(command: str, said: Sequence[str], folder: Path) -> None:
    failed(run("monitor", *words(command)), *said)


def test_logs_may_stand_before_and_after_the_dashes_of_one_tree(folder: Path) -> None:
    written(folder / "-odd.jsonl", lines(EVENTS))
    result = run("monitor", "trees/apart.rvaft", "log.jsonl", "--", "-odd.jsonl")
    assert result.exit_code == 1
    assert "-odd.jsonl: event 4: true" in result.stdout
    assert (
        run("monitor", "--", "trees/apart.rvaft", "log.jsonl").output
        == run("monitor", "trees/apart.rvaft", "log.jsonl").output
    )
    assert run("monitor", "trees/apart.rvaft", "log.jsonl", "--exec", "--", "--repeat").exit_code == 1
