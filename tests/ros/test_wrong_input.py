"""What `rvaft rosmonitoring` refuses: one line that says what to write where, status 2, nothing written."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.runs import COMMAND, TREES, failed, run

ROS = TREES / "remote_inspection" / "ros.rvaft"
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


@pytest.mark.parametrize("stands", ["< {}", "< <(cat {})"])
def test_a_tree_that_cannot_be_read_again(stands: str, tmp_path: Path) -> None:
    (tmp_path / "tree.rvaft").write_text(EVENTS + TOPICS + NODES)
    words = shlex.join([*COMMAND, "rosmonitoring", "/dev/stdin", "-o", "out"])

    def piped(*more: str) -> "subprocess.CompletedProcess[str]":
        script = f"{words} {' '.join(more)} {stands.format('tree.rvaft')}"
        return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path)

    refused = piped()
    said = "rvaft: error: /dev/stdin: the oracles read the tree again when they start: give it as a file\n"
    assert (refused.returncode, refused.stdout, refused.stderr) == (2, "", said)
    assert not (tmp_path / "out").exists()
    assert piped("--oracle", "rml").returncode == 0


def test_no_folder_named() -> None:
    failed(run("rosmonitoring", ROS), "-o", "rvaft rosmonitoring --help")


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yaml", None)
    failed(run("rosmonitoring", ROS, "-o", tmp_path / "out"), "PyYAML is not installed", ".[ros]")
    assert not (tmp_path / "out").exists()
