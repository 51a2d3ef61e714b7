"""`rvaft rosmonitoring`: what the files say."""

import os
import shlex
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import yaml

from rvaft import Verdict, load, monitor, translate
from rvaft.api import narrowed
from rvaft.cli import main
from rvaft.ros.protocol import Session
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


def configured(tree: Path, folder: Path, *options: object) -> Any:
    """The configuration that is written to a folder without a word."""
    result = run("rosmonitoring", tree, "-o", folder, *options)
    assert (result.exit_code, result.output) == (0, "")
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


@pytest.mark.parametrize(
    ("options", "version", "monitors"),
    [
        ("", 2, [expected("damaged", FILTERED)]),
        # under `projected` a branch needs all topics: an event that is relevant to the tree ends its matches
        ("--per branch --port 9000", 2, [expected(f"damaged_branch_{n}", LOGGED, 8999 + n) for n in range(1, 5)]),
        (
            "--per kind --ros-version ros1 --host ::1 --semantics strict",
            1,
            [expected(f"damaged_{kind}", LOGGED, 8080 + n, url="[::1]") for n, kind in enumerate(("fault", "attack"))],
        ),
        ("--action log", 2, [expected("damaged", LOGGED)]),
        # the RML oracle is never asked to filter
        ("--oracle rml", 2, [expected("damaged", LOGGED, warning=2)]),
        (
            "--oracle rml --per kind",
            2,
            [expected(f"damaged_{kind}", LOGGED, 8080 + n, warning=2) for n, kind in enumerate(("fault", "attack"))],
        ),
    ],
)
def test_the_configuration(options: str, version: int, monitors: list[Any], tmp_path: Path) -> None:
    filters = monitors[0]["monitor"]["topics"] == FILTERED
    assert configured(ROS, tmp_path, *options.split()) == {
        "ros_version": f"ros{version}",
        "nodes": [{"node": {"name": "agent"}}] if filters else [],
        "monitors": monitors,
    }
    specifications = {f"{entry['monitor']['id']}.{suffix}" for entry in monitors for suffix in ("pl", "rml")}
    assert {path.name for path in tmp_path.iterdir()} == {*specifications, "monitors.yaml", "run.txt"}
    if "--oracle" in options:
        script = "$ROSMONITORING_HOME/oracle/RMLOracle/prolog/online_monitor.sh"
        names = [f"{entry['monitor']['id']}.pl" for entry in monitors]
        assert commands(tmp_path)[:-1] == [[script, name, str(8080 + n)] for n, name in enumerate(names)]


@pytest.mark.parametrize(("semantics", "topics"), [("scattered", ["/x", "/y"]), ("projected", ["/x", "/y", "/z"])])
def test_the_topics_are_those_that_the_verdict_depends_on(semantics: str, topics: list[str], tmp_path: Path) -> None:
    declared = "".join(f'event {n}() = {{ topic: "/{n}" }};\ntopic "/{n}" type "a.msg.T";\n' for n in "xyz")
    nodes = "ignore w();\ntop or p q;\np sand a b;\na on x();\nb on y();\nq on z();\n"
    tree = written(tmp_path / "tree.rvaft", declared + 'event w() = { topic: "/w" };\n' + nodes)
    part = configured(tree, tmp_path / "out", "--branch", 1, "--semantics", semantics)["monitors"][0]["monitor"]
    assert part["id"] == "top_branch_1"
    assert [topic["name"] for topic in part["topics"]] == topics
    events = [{"topic": f"/{name}"} for name in "xzy"]
    whole, seen, blind = (monitor(load(tree), branch=1, semantics=semantics) for _ in range(3))
    assert list(whole.run(events))[-1] == list(seen.run([e for e in events if e["topic"] in topics]))[-1]
    assert list(blind.run([events[0], events[2]]))[-1] is Verdict.TRUE
    assert whole.verdict is (Verdict.TRUE if semantics == "scattered" else Verdict.FALSE)


@pytest.mark.parametrize(
    ("nodes", "topics"),
    [
        ("p and x never;\nnever when 1 > 2;\nx on x();\n", {"/y"}),
        # x would come before itself
        ("p sand s t;\ns and x y;\nt and x z;\nx on x();\ny on y();\nz on z();\n", {"/w"}),
        ("p and x y;\nx on x();\ny on y() when 1 < 2;\n", {"/x", "/y", "/w"}),
    ],
)
@pytest.mark.parametrize("semantics", ["scattered", "projected"])
def test_topics_that_are_in_no_feasible_scenario(nodes: str, topics: set[str], semantics: str, tmp_path: Path) -> None:
    """They are looked at all the same where relevant events end a match."""
    declared = "".join(f'event {n}() = {{ topic: "/{n}" }};\ntopic "/{n}" type "a.msg.T";\n' for n in "wxyz")
    other = "w on w();\n" if "/w" in topics else "w on y();\n"
    tree = written(tmp_path / "tree.rvaft", f"{declared}top or p w;\n{nodes}{other}")
    assert run("rosmonitoring", tree, "-o", tmp_path / "out", "--semantics", semantics).exit_code == 0
    found = yaml.safe_load((tmp_path / "out" / "monitors.yaml").read_text())["monitors"][0]["monitor"]["topics"]
    relevant = {f"/{node.on.event}" for node in load(tree).nodes.values() if node.on is not None}
    assert {topic["name"] for topic in found} == (topics if semantics == "scattered" else relevant)


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


@pytest.mark.parametrize("semantics", ["projected", "strict"])
def test_the_specifications_are_those_that_emit_writes(semantics: str, tmp_path: Path) -> None:
    configured(ROS, tmp_path, "--per", "branch", "--semantics", semantics)
    for number in range(1, 5):
        for language, suffix in (("rml", "rml"), ("rml-prolog", "pl")):
            text = (tmp_path / f"damaged_branch_{number}.{suffix}").read_text(encoding="utf-8")
            assert text.rstrip() == translate(load(ROS), language, semantics=semantics, branch=number).text.rstrip()


def test_a_monitor_that_rml_cannot_express_is_left_out_of_the_specifications_alone(tmp_path: Path) -> None:
    result = run("rosmonitoring", ROS, "-o", tmp_path, "--semantics", "scattered", "--per", "kind")
    assert (result.exit_code, result.stdout) == (0, "")
    lines = result.stderr.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [["rvaft", "warning"]] * 2
    assert "damaged_fault.rml and damaged_fault.pl left out: rml cannot express this tree under scattered" in lines[0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["monitors.yaml", "run.txt"]
    assert len(yaml.safe_load((tmp_path / "monitors.yaml").read_text())["monitors"]) == 2


def test_a_branch_without_a_scenario_gets_no_monitor(tmp_path: Path) -> None:
    nodes = "top or p b;\np and a never;\na on e() attack;\nnever when 1 > 2;\nb on e() fault;\n"
    tree = written(tmp_path / "tree.rvaft", 'event e() = { topic: "/c" };\ntopic "/c" type "a.msg.T";\n' + nodes)
    for per, ids in (("branch", ["top_branch_2"]), ("kind", ["top_fault"])):
        found = configured(tree, tmp_path / per, "--per", per)
        assert [entry["monitor"]["id"] for entry in found["monitors"]] == ids


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ("", [{}]),
        ("--per branch", [{"branch": number} for number in (1, 2, 3, 4)]),
        ("--per kind", [{"kind": "fault"}, {"kind": "attack"}]),
        ("--kind attack --semantics scattered", [{"kind": "attack"}]),
        ("--branch 3 --host localhost", [{"branch": 3}]),
    ],
)
def test_the_commands_start_the_oracle_of_each_monitor(options: str, parts: list[Any], tmp_path: Path) -> None:
    run("rosmonitoring", ROS, "-o", tmp_path, *options.split())
    (*oracles, generator) = commands(tmp_path)
    entries = yaml.safe_load((tmp_path / "monitors.yaml").read_text())["monitors"]
    assert generator == ["rosmonitoring", "generate", "monitors.yaml", "--ros-version", "ros2", "--output", "generated"]
    for words, entry, part in zip(oracles, entries, parts, strict=True):
        assert words[:2] == ["rvaft", "serve"]
        context = main.make_context("rvaft", words[1:])
        command = main.get_command(context, "serve")
        assert command is not None
        given = command.make_context("serve", words[2:], parent=context).params
        oracle = entry["monitor"]["oracle"]
        assert (given["port"], given["host"]) == (oracle["port"], oracle["url"])
        assert (given["branch"], given["kind"]) == (part.get("branch"), part.get("kind"))
        assert given["semantics"] == ("scattered" if "--semantics" in options else "projected")
        assert load(given["tree"]) == load(ROS)
        Session(narrowed(load(given["tree"]), given["branch"], given["kind"]), given["semantics"])


def test_the_path_of_the_tree_holds_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my trees").mkdir()
    text = 'event e() = { topic: "c" };\ntopic "c" type "a.msg.T";\ntop or x;\nx on e();\n'
    tree = written(tmp_path / "my trees" / "t.rvaft", text)
    monkeypatch.chdir(tmp_path)
    configured(Path("my trees/t.rvaft"), tmp_path / "out", "--host", "robot.local", "--port", "9")
    assert commands(tmp_path / "out")[0] == [
        *["rvaft", "serve", "../my trees/t.rvaft", "--port", "9"],
        *["--host", "robot.local", "--origin", "http://robot.local:9"],
    ]
    configured(tree, tmp_path / "absolute")
    assert commands(tmp_path / "absolute")[0][2] == str(tree)


WORDS = {"damaged": "damaged", "Robot damaged!": "Robot_damaged_", "2of3": "monitor_2of3", "class": "monitor_class"}


@pytest.mark.parametrize(("name", "word"), [*WORDS.items(), ("", "monitor"), ("é", "_"), ("_x1", "_x1")])
def test_a_monitor_is_called_by_a_word_of_python(name: str, word: str, tmp_path: Path) -> None:
    text = f'event e() = {{ topic: "c" }};\ntopic "c" type "a.msg.T";\n"{name}" or x;\nx on e();\n'
    tree = written(tmp_path / "tree.rvaft", text)
    (entry,) = configured(tree, tmp_path / "out")["monitors"]
    assert entry["monitor"]["id"] == word
    assert (tmp_path / "out" / f"{word}.rml").exists()
    (entry,) = configured(tree, tmp_path / "named", "--id", "guard", "--branch", 1)["monitors"]
    assert entry["monitor"]["id"] == "guard_branch_1"


# -- what is refused: one line that says what to write where, status 2, nothing written ---------------------------------

EVENTS = 'event e() = { topic: "/c" };\nevent f() = { topic: "/d" };\n'
TOPICS = 'topic "/c" type "a.msg.T" from n;\ntopic "/d" type "a.msg.U";\n'
NODES = "top or x y;\nx on e();\ny on f();\n"
LONG = (
    "top and "
    + " ".join(f"s{i}" for i in range(10))
    + ";\n"
    + "".join(f"s{i} or a{i} b{i};\na{i} on e();\nb{i} on f();\n" for i in range(10))
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
