"""Configurations of ROSMonitoring: monitors of ROS topics for a tree, and their oracles."""

import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from keyword import iskeyword
from pathlib import Path
from typing import Final

from rvaft.api import translate
from rvaft.core.feasibility import ScenarioSpace
from rvaft.core.fields_to_read import TreeReads
from rvaft.core.restriction import alternatives
from rvaft.errors import OptionError, RvaftError, installed
from rvaft.integrations.ros.server import PORT, REMEDY
from rvaft.model.assumptions import fields_read
from rvaft.model.event_time import TimeFormat
from rvaft.model.nodes import Kind, Node, Topic, absolute, topic_of, wrong_name
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.readers.bag import TIME
from rvaft.rules.validity import valid_part
from rvaft.stream.monitor_set import Per, columns
from rvaft.support.budget import Budget, Undecided
from rvaft.support.network import LOCAL, is_address, require_host
from rvaft.support.wording import listing

SUFFIXES: Final = {"rml": ".rml", "rml-prolog": ".pl"}
"""The backends for the RML oracle of ROSMonitoring, with the suffixes of their files."""
_BEGINNINGS: Final = {"rml": b"// The attack-fault tree ", "rml-prolog": b":- module(spec, "}
_HEADER: Final = "# Written by rvaft rosmonitoring: change the tree and write it again.\n"
_GENERATOR: Final = "# For the generator of ROSMonitoring's branch master; others require more of each node.\n"
_FINAL_ONLY: Final = 2
"""The value of `warning` that reports `false`, but not `currently_false`."""
_LAST_PORT: Final = 65_535


class RosVersion(StrEnum):
    """The ROS version of the generated monitors."""

    ROS1 = "ros1"
    ROS2 = "ros2"


class Action(StrEnum):
    """Whether a monitor only logs messages, or filters them between publishers and the topic."""

    LOG = "log"
    FILTER = "filter"


class MessageTime(StrEnum):
    """What the field `time` of a message has: seconds, as ROSMonitoring writes, or what the tree declares."""

    SECONDS = "seconds"
    DECLARED = "declared"


class Oracle(StrEnum):
    """The oracle of the monitors: `rvaft serve`, or the RML oracle of ROSMonitoring."""

    RVAFT = "rvaft"
    RML = "rml"


@dataclass(frozen=True, slots=True)
class RosOptions:
    """The options of a configuration; raises `OptionError` for an invalid host.

    `port` is the port of the first oracle. Without `action`, topics with publishers are filtered if
    possible. `name` is the base of monitor names, by default the root. `branch` and `kind` select
    one part.
    """

    semantics: Semantics = Semantics.PROJECTED
    repeat: bool = False
    action: Action | None = None
    oracle: Oracle = Oracle.RVAFT
    host: str = LOCAL
    port: int = PORT
    ros_version: RosVersion = RosVersion.ROS2
    per: Per = Per.TREE
    branch: int | None = None
    kind: Kind | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        require_host(self.host)


class NoConfiguration(RvaftError, ValueError):
    """ROSMonitoring cannot monitor this tree; the message tells how to change the tree."""


@dataclass(frozen=True, slots=True)
class Planned:
    """A planned monitor: name, tree, port of its oracle, and topics (spelled as in patterns) with
    actions.
    """

    id: str
    tree: RVAFT
    port: int
    topics: tuple[tuple[Topic, Action], ...]


def planned(tree: RVAFT, options: RosOptions) -> tuple[Planned, ...]:
    """Return the monitors for a tree; parts without a feasible scenario have none.

    Raises `NoConfiguration`, `TreeError`, `TooLarge` for too many branches, and `OptionError` for
    an invalid name or port.
    """
    per, branch, kind = options.per, options.branch, options.kind
    base = monitor_id(tree.root) if options.name is None else options.name
    if monitor_id(base) != base:
        raise OptionError(
            f'"{base}" cannot be the id of a monitor, which is a word of letters, digits and _ and no keyword of Python'
        )
    if branch is not None or kind is not None:
        wanted = [(f"{base}_{kind}" if branch is None else f"{base}_branch_{branch}", valid_part(tree, branch, kind))]
    elif per is Per.TREE:
        wanted = [(base, valid_part(tree))]
    else:
        infix = "_branch_" if per is Per.BRANCH else "_"
        wanted = [(f"{base}{infix}{column.label}", column.part) for column in columns(tree, per)[1:]]
        if not wanted:
            raise NoConfiguration("no branch has a kind: mark nodes with fault or attack, or use --per tree")
    if options.port + len(wanted) - 1 > _LAST_PORT:
        raise OptionError(f"{len(wanted)} monitors need as many ports, and there are none above {_LAST_PORT}")
    made, alone = list[Planned](), len(wanted) == 1
    for port, (id_, part) in enumerate(wanted, options.port):
        topics = tuple((one, _action(one, options, alone=alone)) for one in _topics(part, options.semantics))
        made.append(Planned(id_, part, port, topics))
    return tuple(made)


def needs_conversion(tree: RVAFT) -> bool:
    """Whether a tree reads the field `time`, in which ROSMonitoring writes seconds, in another format."""
    return tree.time is not None and tree.time.field == (TIME,) and tree.time.format is not TimeFormat.SECONDS


def in_seconds(tree: RVAFT) -> RVAFT:
    """Return a tree that reads `time` in seconds; raises `OptionError` if an event of it binds or compares `time`."""
    if tree.time is None or not needs_conversion(tree):
        return tree
    patterns = [one for one in TreeReads(tree).patterns if isinstance(one, ObjectPattern)]
    if TIME in {name for one in patterns for name, _ in one.fields} | {path[0] for path in fields_read(tree)}:
        why = f"an event or assumption of the tree uses `{TIME}`, whose values would be in {tree.time.format}"
        raise OptionError(f"{why}: write `time {TIME} as s;` and its values in seconds")
    return tree.changed(time=replace(tree.time, format=TimeFormat.SECONDS))


def monitor_id(name: str) -> str:
    """Return a name as a Python identifier, since it becomes a module and a ROS node."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name) or "monitor"
    return f"monitor_{word}" if not word.isidentifier() or iskeyword(word) else word


def _topics(tree: RVAFT, semantics: Semantics) -> tuple[Topic, ...]:
    """Return the topics that a monitor needs, in the order of nodes.

    Except under `scattered`, a branch needs the events of the whole tree: under `projected` a
    relevant event that it cannot use ends its matches, under `strict` any event does. Raises
    `NoConfiguration` for an event without a topic, a topic without a message type, and topics that
    one monitor would confuse.
    """
    whole = tree
    while semantics is not Semantics.SCATTERED and whole.part_of is not None:
        whole = whole.part_of.tree

    def at(node: Node) -> str:
        return str(node.place() if node.on is None else tree.events[node.on.event].place)

    def event(node: Node) -> str:
        if node.on is not None:
            return f"event type {node.on.event}"
        return f"the default event of {node.name}"

    first: dict[str, Node] = {}
    for name in _in_feasible(whole) if semantics is Semantics.SCATTERED else whole.occurrences:
        node, pattern = whole.nodes[name], whole.pattern(name)
        assert pattern is not None
        topic = topic_of(pattern)
        if not isinstance(topic, Literal) or not isinstance(topic.value, str):
            pattern_needs = 'its pattern needs a text in the field topic, as in { topic: "/name" }'
            remedy = "give it an event type with `on`" if node.on is None else pattern_needs
            raise NoConfiguration(f"{at(node)}: {event(node)} has no topic: {remedy}")
        if wrong := wrong_name(topic.value):
            raise NoConfiguration(f"{at(node)}: {wrong}; correct the field topic of {event(node)}")
        first.setdefault(topic.value, node)
    spelled: dict[str, str] = {}
    for name, node in first.items():
        other = spelled.setdefault(absolute(name), name)
        if other != name:
            raise NoConfiguration(
                f"{at(node)}: the topics {other} and {name} are the same topic in ROS: "
                "spell it the same way in all patterns"
            )
    missing = [name for name in first if absolute(name) not in tree.topics]
    if missing:
        name, *others = missing
        more = f" (and one for {listing(others)})" if others else ""
        raise NoConfiguration(
            f"{at(first[name])}: the topic {name} of {event(first[name])} has no message type: "
            f'add `topic "{name}" type "package.msg.Name";`{more}'
        )
    wanted = tuple(replace(tree.topics[absolute(name)], name=name) for name in first)
    packages: dict[str, Topic] = {}
    for one in wanted:  # monitors import message types by their last word
        word = one.type.rpartition(".")[2]
        same = packages.setdefault(word, one)
        if same.type != one.type:
            raise NoConfiguration(
                f"{one.place}: the message types {same.type} of {same.name} and {one.type} of {one.name} would both be "
                f"{word} in one monitor of ROSMonitoring, which confuses them: rename one message"
            )
    return wanted


def _in_feasible(tree: RVAFT) -> Iterator[str]:
    """Yield the nodes with an event in some feasible scenario, or where feasibility is undecided.

    Other semantics also use the events of infeasible scenarios.
    """
    spaces = [(space, space.budget()) for space in map(ScenarioSpace, alternatives(tree))]
    for name in tree.occurrences:
        if any(_is_feasible(space, budget, name) for space, budget in spaces):
            yield name


def _is_feasible(space: ScenarioSpace, budget: Budget, name: str) -> bool:
    try:
        there = name in space.whole and space.whole[name] in space.resolutions
        return there and (space.acyclic or space.feasible(budget, [name]) is not None)
    except Undecided:
        return True


def _action(topic: Topic, options: RosOptions, *, alone: bool) -> Action:
    """Filtering needs publishers, a single monitor, and the oracle of rvaft."""
    if options.action is not Action.FILTER:
        possible = topic.publishers and alone and options.oracle is Oracle.RVAFT
        return Action.FILTER if possible and options.action is None else Action.LOG
    if options.oracle is Oracle.RML:
        raise NoConfiguration(
            "the RML oracle answers currently_false until the tree is detected, and a filter would keep "
            "all messages back: use --action log"
        )
    if not alone:
        raise NoConfiguration(
            f"each of several monitors that filter would forward every message of {topic.name}: use --per "
            "tree, --branch or --kind"
        )
    if not topic.publishers:
        raise NoConfiguration(
            f"{topic.place}: the topic {topic.name} cannot be filtered without its publishers: add `from "
            "NODE` to its declaration"
        )
    return Action.FILTER


def specifications(monitor: Planned, semantics: Semantics) -> dict[str, str]:
    """Return the files for the RML oracle with their texts; raises `NotExpressible` and `TooLarge`."""
    texts = {suffix: translate(monitor.tree, name, semantics=semantics).text for name, suffix in SUFFIXES.items()}
    return {f"{monitor.id}{suffix}": text if text.endswith("\n") else f"{text}\n" for suffix, text in texts.items()}


def configuration_text(monitors: Sequence[Planned], options: RosOptions) -> str:
    """Return the configuration as YAML; `nodes` are the publishers of filtered topics.

    Raises `ToolMissing`.
    """
    publishers: dict[str, None] = {}
    entries: list[Json] = []
    for monitor in monitors:
        topics: list[Json] = []
        for topic, action in monitor.topics:
            stated: dict[str, Json] = {"name": topic.name, "type": topic.type, "action": action.value}
            if action is Action.FILTER:  # publishers would make the monitor filter
                stated["publishers"] = list(topic.publishers)
                publishers.update(dict.fromkeys(topic.publishers))
            topics.append(stated)
        host = f"[{options.host}]" if ":" in options.host else options.host
        entry: dict[str, Json] = {
            "id": monitor.id,
            "log": f"./logs/{monitor.id}.jsonl",
            "silent": False,
            "warning": _FINAL_ONLY if options.oracle is Oracle.RML else 1,
            "oracle": {"url": host, "port": monitor.port, "action": "nothing"},
            "topics": topics,
        }
        entries.append({"monitor": entry})
    nodes: list[Json] = [{"node": {"name": name}} for name in publishers]
    value = {"ros_version": options.ros_version.value, "nodes": nodes, "monitors": entries}
    text = installed("yaml", "PyYAML", REMEDY).safe_dump(value, sort_keys=False, allow_unicode=True)
    return f"{_HEADER}{_GENERATOR}{text}"


def leftover(folder: Path, text: str) -> Iterator[str]:
    """Yield the specification files of an earlier configuration, recognised by name and first
    bytes.
    """
    library = installed("yaml", "PyYAML", REMEDY)
    try:
        value = library.safe_load(text) if text.startswith(_HEADER) else {}
        ids = [entry["monitor"]["id"] for entry in value["monitors"]]
    except (library.YAMLError, LookupError, TypeError):
        return
    for name, suffix in SUFFIXES.items():
        for path in sorted(folder.glob(f"*{suffix}")):
            if path.stem in ids and path.is_file() and not path.is_symlink():
                with path.open("rb") as stream:
                    if stream.read(len(_BEGINNINGS[name])) == _BEGINNINGS[name]:
                        yield path.name


def commands_text(monitors: Sequence[Planned], options: RosOptions, *, tree: str, configuration: str) -> str:
    """Return the commands to run in the folder of the files; `tree` is the path from there."""
    lines = ["# Run in this folder, each oracle in its own terminal."]
    for monitor in monitors:
        if options.oracle is Oracle.RML:
            script = '"$ROSMONITORING_HOME"/oracle/RMLOracle/prolog/online_monitor.sh'
            lines.append(f"{script} {monitor.id}.pl {monitor.port}")
            continue
        words = ["rvaft", "serve", tree, "--port", str(monitor.port)]
        if options.host != LOCAL:
            words += ["--host", options.host]
            if options.host != "localhost" and not is_address(options.host):
                words += ["--origin", f"http://{options.host}:{monitor.port}"]
        if options.semantics is not (monitor.tree.semantics or Semantics.PROJECTED):
            words += ["--semantics", options.semantics.value]
        if needs_conversion(monitor.tree):
            words += ["--message-time", "seconds"]
        if options.repeat:
            words.append("--repeat")
        whole = monitor.tree.part_of
        if whole is not None and whole.branch is not None:
            words += ["--branch", str(whole.branch)]
        elif whole is not None and whole.kind is not None:
            words += ["--kind", whole.kind.value]
        lines.append(shlex.join(words))
    version = options.ros_version.value
    words = ["rosmonitoring", "generate", configuration, "--ros-version", version, "--output", "generated"]
    return "\n".join([*lines, "# Then the monitors.", shlex.join(words)]) + "\n"
