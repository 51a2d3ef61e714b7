"""`rvaft rosmonitoring`: what the files say."""

import os
import shlex
import sys
import threading
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml

from rvaft import Kind, load, monitor, translate
from rvaft.cli import main
from rvaft.model.tree import resolve_semantics
from tests.cli.runs import TREES, failed, run, written
from tests.tables import rows

ROS = TREES / "remote_inspection" / "ros.rvaft"
COMMAND, RESULT, RADIATION, GOAL = LOGGED = [
    {"name": name, "type": type_, "action": "log"}
    for name, type_ in (
        ("/command", "gazebo_radiation_plugins.msg.Command"),
        ("/move_base/result", "move_base_msgs.msg.MoveBaseActionResult"),
        ("/radiation_sensor_plugin/sensor_0", "gazebo_radiation_plugins.msg.Simulated_Radiation_Msg"),
        ("/move_base/goal", "move_base_msgs.msg.MoveBaseActionGoal"),
    )
]
FILTERED = [{**COMMAND, "action": "filter", "publishers": ["agent"]}, *LOGGED[1:]]


TREE = load(ROS)
ONE = 'event e() = { topic: "c" };\ntopic "c" type "a.msg.T";\n'
"""The declarations of a tree with one topic."""


def configured(tree: Path, folder: Path, *options: object) -> Any:
    """The configuration that is written to a folder; nothing is said but of specifications that RML does not have."""
    result = run("rosmonitoring", tree, "-o", folder, *options)
    assert (result.exit_code, result.stdout) == (0, "")
    assert all("left out: rvaft does not write this tree in rml" in line for line in result.stderr.splitlines())
    return yaml.safe_load((folder / "monitors.yaml").read_text(encoding="utf-8"))


def expected(id_: str, topics: list[Any], port: int = 8080, *, url: str = "127.0.0.1", warning: int = 1) -> Any:
    oracle = {"url": url, "port": port, "action": "nothing"}
    log = f"./logs/{id_}.jsonl"
    entry = {"id": id_, "log": log, "silent": False, "warning": warning, "oracle": oracle, "topics": topics}
    return {"monitor": entry}


def commands(folder: Path) -> list[list[str]]:
    """The commands of run.txt, as words."""
    lines = (folder / "run.txt").read_text(encoding="utf-8").splitlines()
    return [shlex.split(line) for line in lines if not line.startswith("#")]


BRANCHES, KINDS = [f"damaged_branch_{number}" for number in range(1, 5)], ["damaged_fault", "damaged_attack"]


@pytest.mark.parametrize(
    ("options", "version", "monitors"),
    [
        ("", 2, [expected("damaged", FILTERED)]),
        # under `projected` a branch needs all topics: an event that is relevant to the tree ends its matches
        ("--per branch --port 9000", 2, [expected(id_, LOGGED, 9000 + n) for n, id_ in enumerate(BRANCHES)]),
        (
            "--per kind --ros-version ros1 --host ::1 --semantics strict",
            1,
            [expected(id_, LOGGED, 8080 + n, url="[::1]") for n, id_ in enumerate(KINDS)],
        ),
        ("--kind attack --semantics strict", 2, [expected("damaged_attack", FILTERED)]),
        ("--branch 3 --host localhost", 2, [expected("damaged_branch_3", FILTERED, url="localhost")]),
        ("--action log --repeat", 2, [expected("damaged", LOGGED)]),
        # the RML oracle is never asked to filter
        ("--oracle rml", 2, [expected("damaged", LOGGED, warning=2)]),
        ("--oracle rml --per kind", 2, [expected(id_, LOGGED, 8080 + n, warning=2) for n, id_ in enumerate(KINDS)]),
    ],
)
def test_the_configuration_the_specifications_and_the_commands(
    options: str, version: int, monitors: list[Any], tmp_path: Path
) -> None:
    """The specifications are those that `rvaft emit` writes, and the commands start the oracle of each monitor."""
    nodes = [{"node": {"name": "agent"}}] if monitors[0]["monitor"]["topics"] == FILTERED else []
    configuration = {"ros_version": f"ros{version}", "nodes": nodes, "monitors": monitors}
    assert configured(ROS, tmp_path, *options.split()) == configuration
    semantics = "strict" if "strict" in options else "projected"
    files = {"monitors.yaml", "run.txt"}
    (*oracles, generator) = commands(tmp_path)
    assert generator[:3] == ["rosmonitoring", "generate", "monitors.yaml"]
    assert generator[3:] == ["--ros-version", f"ros{version}", "--output", "generated"]
    for words, entry in zip(oracles, (entry["monitor"] for entry in monitors), strict=True):
        id_, oracle = entry["id"], entry["oracle"]
        branch = int(id_[-1]) if "branch" in id_ else None
        kind = Kind(id_.partition("_")[2]) if id_ in KINDS else None
        for language, suffix in (("rml", "rml"), ("rml-prolog", "pl")):
            text = (tmp_path / f"{id_}.{suffix}").read_text(encoding="utf-8")
            given = translate(TREE, language, semantics=semantics, branch=branch, kind=kind)
            assert text.rstrip() == given.text.rstrip()
            files.add(f"{id_}.{suffix}")
        if "--oracle" in options:
            script = "$ROSMONITORING_HOME/oracle/RMLOracle/prolog/online_monitor.sh"
            assert words == [script, f"{id_}.pl", str(oracle["port"])]
            continue
        assert words[:2] == ["rvaft", "serve"]
        context = main.make_context("rvaft", words[1:])
        command = main.get_command(context, "serve")
        assert command is not None
        asked = command.make_context("serve", words[2:], parent=context).params
        assert (asked["port"], asked["host"]) == (oracle["port"], oracle["url"].strip("[]"))
        assert (asked["branch"], asked["kind"], resolve_semantics(TREE, asked["semantics"])) == (
            branch,
            kind,
            semantics,
        )
        assert asked["repeat"] is ("--repeat" in options)
        assert [load(one) for one in asked["trees"]] == [TREE]
    assert {path.name for path in tmp_path.iterdir()} == files


@pytest.mark.parametrize(
    ("nodes", "branch", "topics", "more"),
    [
        ("top or p q; p sand a b; a on x(); b on y(); q on z();", 1, "xy", "xyz"),
        ("top or p q; p and x never; x on x(); never when 1 > 2; q on y();", None, "y", "xy"),
        # x would come before itself
        ("top or p w; p sand s t; s and x y; t and x z; x on x(); y on y(); z on z(); w on w();", None, "w", "wxyz"),
        ("top or p w; p and x y; x on x(); y on y() when 1 < 2; w on w();", None, "wxy", "wxy"),
    ],
)
def test_the_topics_are_those_that_the_verdict_depends_on(
    nodes: str, branch: int | None, topics: str, more: str, tmp_path: Path
) -> None:
    """Topics of infeasible scenarios, and of other branches, matter where relevant events end a
    match; those of ignored events never.
    """
    declared = "".join(f'event {n}() = {{ topic: "/{n}" }};\ntopic "/{n}" type "a.msg.T";\n' for n in "wxyz")
    ignored = 'event v() = { topic: "/v" };\nignore v();\n'
    tree = written(tmp_path / "tree.rvaft", f"{declared}{ignored}{nodes}")
    for semantics, expected_names in (("scattered", topics), ("projected", more)):
        options = ["--semantics", semantics, *([] if branch is None else ["--branch", branch])]
        (entry,) = configured(tree, tmp_path / semantics, *options)["monitors"]
        names = {topic["name"].removeprefix("/") for topic in entry["monitor"]["topics"]}
        assert names == set(expected_names)
        fresh = monitor(load(tree), branch=branch, semantics=semantics)
        for trace in product("vwxyz", repeat=3):
            whole, seen = fresh.fork(), fresh.fork()
            for name in trace:
                whole.step({"topic": f"/{name}"})
                if name in names:
                    seen.step({"topic": f"/{name}"})
            assert whole.verdict is seen.verdict


def test_the_oracle_converts_the_seconds_of_rosmonitoring_or_is_refused(tmp_path: Path) -> None:
    text = 'time time as {}; bad sand a b within 1 s; event m(t) = {{ topic: t }}; a on m("/a"); b on m("/b");'
    text += 'topic "/a" type "std_msgs.msg.Empty"; topic "/b" type "std_msgs.msg.Empty";'
    for form, option in (("ns", ["--message-time", "seconds"]), ("ros", ["--message-time", "seconds"]), ("s", [])):
        tree = written(tmp_path / f"{form}.rvaft", text.format(form))
        configured(tree, tmp_path / form)
        assert commands(tmp_path / form)[0][5:] == option
        assert ("[ros-time]" in run("check", tree).stdout) is bool(option)
        refused = run("rosmonitoring", tree, "-o", tmp_path / "rml", "--oracle", "rml")
        assert refused.exit_code == 2
        assert ("writes `time` in seconds" in refused.stderr) is bool(option)


def test_names_are_spelled_as_the_patterns_spell_them(tmp_path: Path) -> None:
    """The generated monitor sends the name as it stands here, and the RML oracle compares it as it comes."""
    text = 'event e(t) = { topic: t };\ntopic "/c" type "a.msg.T" from n, "/ns/m";\ntop or x;\nx fault on e("c");\n'
    tree = written(tmp_path / "tree.rvaft", text)
    found = configured(tree, tmp_path / "out")
    topic = {"name": "c", "type": "a.msg.T", "action": "filter", "publishers": ["n", "/ns/m"]}
    assert found["monitors"] == [expected("top", [topic])]
    assert found["nodes"] == [{"node": {"name": "n"}}, {"node": {"name": "/ns/m"}}]
    assert configured(tree, tmp_path / "all", "--action", "filter") == found
    assert configured(tree, tmp_path / "one", "--per", "kind")["monitors"] == [expected("top_fault", [topic])]


def test_a_monitor_that_rml_cannot_express_is_left_out_of_the_specifications_alone(tmp_path: Path) -> None:
    result = run("rosmonitoring", ROS, "-o", tmp_path, "--semantics", "scattered", "--per", "kind")
    assert (result.exit_code, result.stdout) == (0, "")
    assert [
        line.split(" left out: rvaft does not write this tree in rml under scattered")[0]
        for line in result.stderr.splitlines()
    ] == [f"rvaft: warning: {id_}.rml and {id_}.pl" for id_ in KINDS]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["monitors.yaml", "run.txt"]
    assert len(yaml.safe_load((tmp_path / "monitors.yaml").read_text())["monitors"]) == 2
    assert [words[-4:] for words in commands(tmp_path)[:-1]] == [
        ["--semantics", "scattered", "--kind", kind] for kind in ("fault", "attack")
    ]


def test_a_branch_without_a_scenario_gets_no_monitor(tmp_path: Path) -> None:
    nodes = "top or p b;\np and a never;\na on e() attack;\nnever when 1 > 2;\nb on e() fault;\n"
    tree = written(tmp_path / "tree.rvaft", ONE + nodes)
    for per, id_ in (("branch", "top_branch_2"), ("kind", "top_fault")):
        (entry,) = configured(tree, tmp_path / per, "--per", per)["monitors"]
        assert entry["monitor"]["id"] == id_


def test_the_path_of_the_tree_holds_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my trees").mkdir()
    tree = written(tmp_path / "my trees" / "t.rvaft", f"{ONE}top or x;\nx on e();\n")
    monkeypatch.chdir(tmp_path)
    configured(Path("my trees/t.rvaft"), tmp_path / "out", "--host", "robot.local", "--port", "9")
    served = "--port 9 --host robot.local --origin http://robot.local:9"
    assert commands(tmp_path / "out")[0] == ["rvaft", "serve", "../my trees/t.rvaft", *served.split()]
    configured(tree, tmp_path / "absolute")
    assert commands(tmp_path / "absolute")[0][2] == str(tree)


WORDS = {"damaged": "damaged", "Robot damaged!": "Robot_damaged_", "2of3": "monitor_2of3", "class": "monitor_class"}


@pytest.mark.parametrize(("name", "word"), [*WORDS.items(), ("", "monitor"), ("é", "_"), ("_x1", "_x1")])
def test_a_monitor_is_called_by_a_word_of_python(name: str, word: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", f'{ONE}"{name}" or x;\nx on e();\n')
    for options, id_ in (("", word), ("--id guard --branch 1", "guard_branch_1")):
        (entry,) = configured(tree, tmp_path / id_, *options.split())["monitors"]
        assert entry["monitor"]["id"] == id_
        assert (tmp_path / id_ / f"{id_}.rml").exists()


# -- what is refused: one line that says what to write where, status 2, nothing written
# ---------------------------------

EVENTS = 'event e() = { topic: "/c" };\nevent f() = { topic: "/d" };\n'
TOPICS = 'topic "/c" type "a.msg.T" from n;\ntopic "/d" type "a.msg.U";\n'
NODES = "top or x y;\nx on e();\ny on f();\n"
LONG = "top and s0 s1 s2 s3 s4 s5 s6 s7 s8 s9;\n" + "".join(
    f"s{i} or a{i} b{i};\na{i} on e();\nb{i} on f();\n" for i in range(10)
)


@pytest.mark.parametrize("row", rows(__file__, "refused.txt"), ids=lambda row: row[0])
def test_a_tree_or_option_that_cannot_be(row: list[str], tmp_path: Path) -> None:
    _, text, options, *parts = row
    for name, part in (("EVENTS", EVENTS), ("TOPICS", TOPICS), ("NODES", NODES), ("LONG", LONG)):
        text = text.replace(f"${name}\n", part)
    tree = written(tmp_path / "tree.rvaft", text)
    result = run("rosmonitoring", tree, "-o", tmp_path / "out", *shlex.split(options))
    lines = result.stderr.splitlines()
    # a text that is not in the language is shown with its place
    assert (result.exit_code, result.stdout, len(lines) in (1, 3)) == (2, "", True), result.stderr
    assert all(part in lines[0] for part in parts), lines[0]
    assert not (tmp_path / "out").exists()


def test_a_tree_that_cannot_be_read_again(tmp_path: Path) -> None:
    (tree := tmp_path / "tree.rvaft").write_text(EVENTS + TOPICS + NODES)
    os.mkfifo(pipe := tmp_path / "pipe")
    for options, status in (([], 2), (["--oracle", "rml"], 0)):
        with tree.open() as stream:
            again = Path(f"/proc/self/fd/{stream.fileno()}")
            writer = threading.Thread(target=pipe.write_bytes, args=(tree.read_bytes(),))
            writer.start()
            for name in (again, pipe):
                result = run("rosmonitoring", name, "-o", tmp_path / "out", *options)
                said = f"rvaft: error: {name}: the oracles read the tree again when they start: give it as a file\n"
                assert (result.exit_code, result.stdout, result.stderr) == (status, "", said if status else "")
                assert (tmp_path / "out").exists() == (not status)
            writer.join()


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yaml", None)
    failed(run("rosmonitoring", ROS, "-o", tmp_path / "out"), "PyYAML is not installed", ".[ros]")
    assert not (tmp_path / "out").exists()
