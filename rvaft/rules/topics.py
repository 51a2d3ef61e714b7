"""Rules about `topic` declarations: of drafts, and, for those that are of no use, of trees."""

from collections.abc import Iterator
from typing import Final

from rvaft.findings import Severity
from rvaft.language.draft import Draft, DraftTopic
from rvaft.model import EventType, On
from rvaft.patterns import Literal, Pattern, Variable
from rvaft.rules.context import Context
from rvaft.rules.rule import Report, Rule
from rvaft.rules.words import did_you_mean
from rvaft.topics import absolute, topic_of, wrong_name, wrong_type


def duplicate_topic(draft: Draft) -> Iterator[Report]:
    """All declarations of a topic give it one message type, in whichever files."""
    first: dict[str, DraftTopic] = {}
    for topic in draft.topics:
        name, type_ = topic.name.value, topic.type.value
        before = first.setdefault(absolute(name), topic)
        if before.type.value != type_:
            message = f"topic {name} has the message type {type_} here and {before.type.value} at {before.type.place}; remove one"
            yield Report(topic.type.place, message)


def malformed_topic(draft: Draft) -> Iterator[Report]:
    """Topics, publishers and message types are called as ROS calls them."""
    for topic in draft.topics:
        for said in (topic.name, *topic.publishers):
            if wrong := wrong_name(said.value):
                yield Report(said.place, wrong)
        if wrong := wrong_type(topic.type.value):
            yield Report(topic.type.place, wrong)


def unused_topic(context: Context) -> Iterator[Report]:
    """A topic over which no event type comes."""
    tree = context.tree
    calls = [node.on for node in tree.nodes.values() if node.on is not None] + [ignore.on for ignore in tree.ignores]
    used: set[str] = set()
    for event in tree.events.values():
        for asked in _topics(event, calls):
            if not isinstance(asked, Literal):
                return  # any topic will do
            used.add(absolute(str(asked.value)))
    for name, topic in tree.topics.items():
        if name not in used:
            guess = did_you_mean(name, used)
            message = f"no event type has the topic {topic.name}; remove its declaration, or use it in a pattern{guess}"
            yield Report(topic.place, message)


def _topics(event: EventType, calls: list[On]) -> list[Pattern]:
    """What an event type asks of the topic: itself, or where that is a parameter, each of its calls."""
    asked = topic_of(event.pattern)
    if isinstance(asked, Variable):
        index = event.parameters.index(asked.name)
        return [call.arguments[index] for call in calls if call.event == event.name]
    return [] if asked is None else [asked]


_EVENT: Final = 'event move(wp) = { topic: "/command", waypoint: wp };\n'
_NODES: Final = "top sand a b;\na on move(1);\nb;\n"
_MENDED: Final = f'{_EVENT}topic "/command" type "robot_msgs.msg.Command";\n{_NODES}'

RULES = (
    Rule(
        "duplicate-topic",
        Severity.ERROR,
        "topic with two message types",
        duplicate_topic,
        "A topic has one message type in all files of a tree; `/command` and `command` are one topic in ROS. The same declaration may "
        "stand twice, and publishers add up. The message names both places.",
        f'{_EVENT}topic "/command" type "robot_msgs.msg.Command";\ntopic "command" type "std_msgs.msg.String";\n{_NODES}',
        _MENDED,
    ),
    Rule(
        "malformed-topic",
        Severity.ERROR,
        "topic, publisher or message type that ROS cannot have",
        malformed_topic,
        "The message type of a topic is written as Python imports it, `package.msg.Name`. A topic, like a node that publishes it, is "
        'called by words of letters, digits and `_` with `/` between them, as in `"/move_base/goal"`.',
        f'{_EVENT}topic "/command" type "robot_msgs/Command";\n{_NODES}',
        _MENDED,
    ),
)
"""What makes the declarations of a draft wrong."""

UNUSED: Final = Rule(
    "unused-topic",
    Severity.WARNING,
    "unused topic",
    unused_topic,
    "A declared topic that stands in the pattern of no event type, in the field `topic`, gets into no configuration of "
    "ROSMonitoring. Perhaps one of the two is misspelt.",
    f'{_EVENT}topic "/comand" type "robot_msgs.msg.Command";\n{_NODES}',
    _MENDED,
)
