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
from rvaft.ros.configuration import monitor_id
from rvaft.ros.protocol import Session
from tests.cli.runs import TREES, failed, run

ROS = TREES / "remote_inspection" / "ros.rvaft"
COMMAND = {"name": "/command", "type": "gazebo_radiation_plugins.msg.Command", "action": "log"}
FILTERED = {**COMMAND, "action": "filter", "publishers": ["agent"]}
RESULT = {"name": "/move_base/result", "type": "move_base_msgs.msg.MoveBaseActionResult", "action": "log"}
RADIATION = {
    "name": "/radiation_sensor_plugin/sensor_0",
    "type": "gazebo_radiation_plugins.msg.Simulated_Radiation_Msg",
    "action": "log",
}
GOAL = {"name": "/move_base/goal", "type": "move_base_msgs.msg.MoveBaseActionGoal", "action": "log"}
LOGGED = [COMMAND, RESULT, RADIATION, GOAL]


def written(tree: Path, folder: Path, *options: object) -> Any:
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


def test_one_monitor_for_the_tree_filters_what_has_publishers(tmp_path: Path) -> None:
    assert written(ROS, tmp_path / "new") == {
        "ros_version": "ros2",
        "nodes": [{"node": {"name": "agent"}}],
        "monitors": [expected("damaged", [FILTERED, RESULT, RADIATION, GOAL])],
    }
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "damaged.pl",
        "damaged.rml",
        "monitors.yaml",
        "run.txt",
    ]


def test_one_monitor_per_branch(tmp_path: Path) -> None:
    """Under `projected` a branch needs all topics: an event that is relevant to the tree ends its matches."""
    assert written(ROS, tmp_path, "--per", "branch", "--port", 9000) == {
        "ros_version": "ros2",
        "nodes": [],
        "monitors": [expected(f"damaged_branch_{n}", LOGGED, 8999 + n) for n in range(1, 5)],
    }


def test_one_monitor_per_kind(tmp_path: Path) -> None:
    found = written(ROS, tmp_path, "--per", "kind", "--ros-version", "ros1", "--host", "::1", "--semantics", "strict")
    monitors = [
        expected("damaged_fault", LOGGED, 8080, url="[::1]"),
        expected("damaged_attack", LOGGED, 8081, url="[::1]"),
    ]
    assert found == {"ros_version": "ros1", "nodes": [], "monitors": monitors}


@pytest.mark.parametrize(("semantics", "topics"), [("scattered", ["/x", "/y"]), ("projected", ["/x", "/y", "/z"])])
def test_the_topics_are_those_that_the_verdict_depends_on(semantics: str, topics: list[str], tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    tree.write_text(
        "".join(f'event {n}() = {{ topic: "/{n}" }};\ntopic "/{n}" type "a.msg.T";\n' for n in "xyz")
        + 'event w() = { topic: "/w" };\nignore w();\ntop or p q;\np sand a b;\na on x();\nb on y();\nq on z();\n'
    )
    part = written(tree, tmp_path / "out", "--branch", 1, "--semantics", semantics)["monitors"][0]["monitor"]
    assert part["id"] == "top_branch_1"
    assert [topic["name"] for topic in part["topics"]] == topics
    events = [{"topic": f"/{name}"} for name in "xzy"]
    whole = monitor(load(tree), branch=1, semantics=semantics)
    seen = monitor(load(tree), branch=1, semantics=semantics)
    assert list(whole.run(events))[-1] == list(seen.run([e for e in events if e["topic"] in topics]))[-1]
    blind = monitor(load(tree), branch=1, semantics=semantics)
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
    tree = tmp_path / "tree.rvaft"
    declared = "".join(f'event {n}() = {{ topic: "/{n}" }};\ntopic "/{n}" type "a.msg.T";\n' for n in "wxyz")
    other = "w on w();\n" if "/w" in topics else "w on y();\n"
    tree.write_text(f"{declared}top or p w;\n{nodes}{other}")
    result = run("rosmonitoring", tree, "-o", tmp_path / "out", "--semantics", semantics)
    assert (result.exit_code, result.stdout) == (0, "")
    found = yaml.safe_load((tmp_path / "out" / "monitors.yaml").read_text())["monitors"][0]["monitor"]["topics"]
    relevant = {f"/{node.on.event}" for node in load(tree).nodes.values() if node.on is not None}
    assert {topic["name"] for topic in found} == (topics if semantics == "scattered" else relevant)


def test_names_are_spelled_as_the_patterns_spell_them(tmp_path: Path) -> None:
    """The generated monitor sends the name as it stands here, and the RML oracle compares it as it comes."""
    tree = tmp_path / "tree.rvaft"
    tree.write_text('event e(t) = { topic: t };\ntopic "/c" type "a.msg.T" from n, "/ns/m";\ntop or x;\nx on e("c");\n')
    found = written(tree, tmp_path / "out")
    topic = {"name": "c", "type": "a.msg.T", "action": "filter", "publishers": ["n", "/ns/m"]}
    assert found["monitors"] == [expected("top", [topic])]
    assert found["nodes"] == [{"node": {"name": "n"}}, {"node": {"name": "/ns/m"}}]


def test_actions(tmp_path: Path) -> None:
    assert written(ROS, tmp_path, "--action", "log") == {
        "ros_version": "ros2",
        "nodes": [],
        "monitors": [expected("damaged", LOGGED)],
    }
    tree = tmp_path / "tree.rvaft"
    tree.write_text('event e() = { topic: "c" };\ntopic "/c" type "a.msg.T" from n;\ntop or x;\nx fault on e();\n')
    topic = {"name": "c", "type": "a.msg.T", "action": "filter", "publishers": ["n"]}
    assert written(tree, tmp_path / "all", "--action", "filter")["monitors"] == [expected("top", [topic])]
    assert written(tree, tmp_path / "one", "--per", "kind")["monitors"] == [expected("top_fault", [topic])]


def test_the_rml_oracle_is_never_asked_to_filter(tmp_path: Path) -> None:
    found = written(ROS, tmp_path, "--oracle", "rml", "--per", "kind")
    monitors = [
        expected("damaged_fault", LOGGED, warning=2),
        expected("damaged_attack", LOGGED, 8081, warning=2),
    ]
    assert found == {"ros_version": "ros2", "nodes": [], "monitors": monitors}
    assert written(ROS, tmp_path / "one", "--oracle", "rml")["monitors"] == [expected("damaged", LOGGED, warning=2)]
    script = "$ROSMONITORING_HOME/oracle/RMLOracle/prolog/online_monitor.sh"
    assert commands(tmp_path)[:-1] == [[script, "damaged_fault.pl", "8080"], [script, "damaged_attack.pl", "8081"]]


@pytest.mark.parametrize("semantics", ["projected", "strict"])
def test_the_specifications_are_those_that_emit_writes(semantics: str, tmp_path: Path) -> None:
    written(ROS, tmp_path, "--per", "branch", "--semantics", semantics)
    for number in range(1, 5):
        for language, suffix in (("rml", "rml"), ("rml-prolog", "pl")):
            text = (tmp_path / f"damaged_branch_{number}.{suffix}").read_text(encoding="utf-8")
            assert text.rstrip("\n") == translate(load(ROS), language, semantics=semantics, branch=number).text.rstrip(
                "\n"
            )


def test_a_monitor_that_rml_cannot_express_is_left_out_of_the_specifications_alone(tmp_path: Path) -> None:
    result = run("rosmonitoring", ROS, "-o", tmp_path, "--semantics", "scattered", "--per", "kind")
    assert (result.exit_code, result.stdout) == (0, "")
    lines = result.stderr.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [["rvaft", "warning"]] * 2
    assert "damaged_fault.rml and damaged_fault.pl left out: rml cannot express this tree under scattered" in lines[0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["monitors.yaml", "run.txt"]
    assert len(yaml.safe_load((tmp_path / "monitors.yaml").read_text())["monitors"]) == 2


def test_a_branch_without_a_scenario_gets_no_monitor(tmp_path: Path) -> None:
    tree = tmp_path / "tree.rvaft"
    tree.write_text(
        'event e() = { topic: "/c" };\ntopic "/c" type "a.msg.T";\ntop or p b;\np and a never;\na on e() attack;\nnever when 1 > 2;\nb on e() fault;\n'
    )
    for per, ids in (("branch", ["top_branch_2"]), ("kind", ["top_fault"])):
        found = written(tree, tmp_path / per, "--per", per)
        assert [entry["monitor"]["id"] for entry in found["monitors"]] == ids


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ([], [{}]),
        (["--per", "branch"], [{"branch": number} for number in (1, 2, 3, 4)]),
        (["--per", "kind"], [{"kind": "fault"}, {"kind": "attack"}]),
        (["--kind", "attack", "--semantics", "scattered"], [{"kind": "attack"}]),
        (["--branch", 3, "--host", "localhost"], [{"branch": 3}]),
    ],
)
def test_the_commands_start_the_oracle_of_each_monitor(
    options: list[object], parts: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("rosmonitoring", ROS, "-o", tmp_path, *options)
    (*oracles, generator) = commands(tmp_path)
    entries = yaml.safe_load((tmp_path / "monitors.yaml").read_text())["monitors"]
    assert generator == ["rosmonitoring", "generate", "monitors.yaml", "--ros-version", "ros2", "--output", "generated"]
    assert len(oracles) == len(entries) == len(parts)
    for words, entry, part in zip(oracles, entries, parts, strict=True):
        assert words[:2] == ["rvaft", "serve"]
        context = main.make_context("rvaft", words[1:])
        command = main.get_command(context, "serve")
        assert command is not None
        given = command.make_context("serve", words[2:], parent=context).params
        assert given["port"] == entry["monitor"]["oracle"]["port"]
        assert given["host"] == entry["monitor"]["oracle"]["url"]
        assert (given["branch"], given["kind"]) == (part.get("branch"), part.get("kind"))
        assert given["semantics"] == (options[-1] if "--semantics" in options else "projected")
        assert load(given["tree"]) == load(ROS)
        Session(narrowed(load(given["tree"]), given["branch"], given["kind"]), given["semantics"])


def test_the_path_of_the_tree_holds_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my trees").mkdir()
    (tree := tmp_path / "my trees" / "t.rvaft").write_text(
        'event e() = { topic: "c" };\ntopic "c" type "a.msg.T";\ntop or x;\nx on e();\n'
    )
    monkeypatch.chdir(tmp_path)
    written(Path("my trees/t.rvaft"), tmp_path / "out", "--host", "robot.local", "--port", "9")
    assert commands(tmp_path / "out")[0] == [
        *["rvaft", "serve", "../my trees/t.rvaft", "--port", "9"],
        *["--host", "robot.local", "--origin", "http://robot.local:9"],
    ]
    written(tree, tmp_path / "absolute")
    assert commands(tmp_path / "absolute")[0][2] == str(tree)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("damaged", "damaged"),
        ("Robot damaged!", "Robot_damaged_"),
        ("2of3", "monitor_2of3"),
        ("class", "monitor_class"),
        ("", "monitor"),
        ("é", "_"),
        ("_x1", "_x1"),
    ],
)
def test_a_monitor_is_called_by_a_word_of_python(name: str, expected: str, tmp_path: Path) -> None:
    assert monitor_id(name) == expected
    tree = tmp_path / "tree.rvaft"
    tree.write_text(
        f'event e() = {{ topic: "c" }};\ntopic "c" type "a.msg.T";\n"{name}" or x;\nx on e();\n', encoding="utf-8"
    )
    (entry,) = written(tree, tmp_path / "out")["monitors"]
    assert entry["monitor"]["id"] == expected
    assert (tmp_path / "out" / f"{expected}.rml").exists()
    (entry,) = written(tree, tmp_path / "named", "--id", "guard", "--branch", 1)["monitors"]
    assert entry["monitor"]["id"] == "guard_branch_1"


# -- what is refused: one line that says what to write where, status 2, nothing written ---------------------------------

EVENTS = 'event e() = { topic: "/c" };\nevent f() = { topic: "/d" };\n'
TOPICS = 'topic "/c" type "a.msg.T" from n;\ntopic "/d" type "a.msg.U";\n'
NODES = "top or x y;\nx on e();\ny on f();\n"
LONG = "".join(f"s{i} or a{i} b{i};\na{i} on e();\nb{i} on f();\n" for i in range(10))

CASES: dict[str, tuple[str, list[str], list[str]]] = {
    "no type": (
        EVENTS + 'topic "/c" type "a.msg.T";\n' + NODES,
        [],
        ["tree.rvaft:2:7: the topic /d of event type f has no message type", 'add `topic "/d" type "package.msg.Name";`'],
    ),
    "no types": (EVENTS + NODES, [], ["tree.rvaft:1:7", "/c of event type e", "(and one for /d)"]),
    "two types": (
        EVENTS + TOPICS + 'topic "c" type "a.msg.V";\n' + NODES,
        [],
        ["tree.rvaft:5:16", "a.msg.V here and a.msg.T at", "tree.rvaft:3:17", "[duplicate-topic]"],
    ),
    "malformed type": (EVENTS + 'topic "/c" type "no.dots";\n' + NODES, [], ["tree.rvaft:3:17", "[malformed-topic]"]),
    "malformed publisher": (EVENTS + 'topic "/c" type "a.msg.T" from "a b";\n' + NODES, [], ['"a b" is no name in ROS']),
    "type without quotes": (EVENTS + "topic /c type a.msg.T;\n" + NODES, [], ["tree.rvaft:3:7: the name of a topic stands in quotes"]),
    "event type without topic": (
        EVENTS + "event g() = { name: 1 };\n" + TOPICS + NODES + "y or z;\nz on g();\n",
        [],
        ["tree.rvaft:3:7: event type g comes over no topic", 'the field topic, as in { topic: "/name" }'],
    ),
    "topic only deeper": (
        'event g() = { data: { topic: "/c" } };\n' + TOPICS + "top or x;\nx on g();\n",
        [],
        ["event type g comes over no topic"],
    ),
    "topic that is a number": ("event g() = { topic: 1 };\ntop or x;\nx on g();\n", [], ["event type g comes over no topic"]),
    "topic that is any": ("event g() = { topic: _ };\ntop or x;\nx on g();\n", [], ["event type g comes over no topic"]),
    "topic that is a variable": ("event g(t) = { topic: t };\ntop or x;\nx on g(T);\n", [], ["event type g comes over no topic"]),
    "topic of another branch": (
        EVENTS + 'topic "/c" type "a.msg.T";\n' + NODES,
        ["--branch", "1"],
        ["the topic /d of event type f has no message type"],
    ),
    "default event": (
        EVENTS + TOPICS + "top or x z;\nx on e();\nz;\n",
        [],
        ["tree.rvaft:7:1: the default event of z comes over no topic", "give it an event type with `on`"],
    ),
    "default event of a copy": (
        EVENTS + TOPICS + "top and p q;\np or a z;\nq or a z;\na on e() fault;\nz fault;\n",
        ["--kind", "fault", "--semantics", "scattered"],
        ["the default event of z comes over no topic"],
    ),
    "topic that ROS cannot have": (
        'event g() = { topic: "a b" };\ntop or x;\nx on g();\n',
        [],
        ["tree.rvaft:1:7", '"a b" is no name in ROS', "mend the field topic of event type g"],
    ),
    "one topic in two spellings": (
        EVENTS + 'event g() = { topic: "c" };\n' + TOPICS + "top or x y;\nx on e();\ny on g();\n",
        [],
        ["tree.rvaft:3:7: the topics /c and c are one in ROS"],
    ),
    "message types of one name": (
        EVENTS + 'topic "/c" type "a.msg.T";\ntopic "/d" type "b.msg.T";\n' + NODES,
        [],
        ["tree.rvaft:4:7: the message types", "a.msg.T of /c and b.msg.T of /d", "rename one"],
    ),
    "filter without publishers": (
        EVENTS + TOPICS + NODES,
        ["--action", "filter"],
        ["tree.rvaft:4:7: the topic /d cannot be filtered without its publishers", "`from NODE`"],
    ),
    "several that filter": (
        EVENTS + TOPICS + NODES,
        ["--action", "filter", "--per", "branch"],
        ["each of several monitors", "/c", "--per tree"],
    ),
    "filter by RML": (EVENTS + TOPICS + NODES, ["--action", "filter", "--oracle", "rml"], ["currently_false", "--action log"]),
    "nothing for the RML oracle": (
        'event e(v) = { topic: "/c", v: v };\n' + TOPICS + "top sand x y;\nx on e(V);\ny on e(V);\n",
        ["--oracle", "rml", "--semantics", "scattered"],
        ["nothing for the RML oracle to load: top.rml and top.pl left out"],
    ),
    "no kinds": (EVENTS + TOPICS + NODES, ["--per", "kind"], ["no branch has a kind", "--per tree"]),
    "kind that is not there": (EVENTS + TOPICS + NODES, ["--kind", "fault"], ["no branch has the kind fault"]),
    "no such branch": (EVENTS + TOPICS + NODES, ["--branch", "3"], ["branch 3", "2"]),
    "branch and per": (EVENTS + TOPICS + NODES, ["--branch", "1", "--per", "branch"], ["--branch and --per exclude"]),
    "too many branches": (
        EVENTS + TOPICS + "top and " + " ".join(f"s{i}" for i in range(10)) + ";\n" + LONG,
        ["--per", "branch"],
        ["a monitor for each branch of top", "1000"],
    ),
    "no ports left": (EVENTS + TOPICS + NODES, ["--per", "branch", "--port", "65535"], ["2 monitors", "65535"]),
    "port 0": (EVENTS + TOPICS + NODES, ["--port", "0"], ["--port"]),
    "id that is no word": (EVENTS + TOPICS + NODES, ["--id", "my monitor"], ['"my monitor" cannot be the id']),
    "id that is a keyword": (EVENTS + TOPICS + NODES, ["--id", "class"], ['"class" cannot be the id']),
    "no host": (EVENTS + TOPICS + NODES, ["--host", ""], ['"" is no IP address and no host name']),
    "a URL as host": (EVENTS + TOPICS + NODES, ["--host", "http://x:1"], ['"http://x:1" is no IP address and no host name']),
    "a service": (
        'event g() = { service: "/c" };\n' + TOPICS + "top or x;\nx on g();\n",
        [],
        ["event type g comes over no topic"],
    ),
    "unknown ROS": (EVENTS + TOPICS + NODES, ["--ros-version", "ros3"], ["'ros3'", "ros2"]),
    "a tree that breaks a rule": ("top or x;\nx when 1 > 2;\n", [], ["[no-scenario]"]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_tree_or_option_that_cannot_be(case: str, tmp_path: Path) -> None:
    text, options, parts = CASES[case]
    (tree := tmp_path / "tree.rvaft").write_text(text)
    result = run("rosmonitoring", tree, "-o", tmp_path / "out", *options)
    lines = result.stderr.splitlines()
    if len(lines) == 3:  # a text that is not in the language is shown with its place
        lines = lines[:1]
    assert (result.exit_code, result.stdout, len(lines)) == (2, "", 1), result.stderr
    for part in parts:
        assert part in lines[0], lines[0]
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


def test_no_folder_named() -> None:
    failed(run("rosmonitoring", ROS), "-o", "rvaft rosmonitoring --help")


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yaml", None)
    failed(run("rosmonitoring", ROS, "-o", tmp_path / "out"), "PyYAML is not installed", ".[ros]")
    assert not (tmp_path / "out").exists()
