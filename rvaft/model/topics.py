"""Topics of ROS: what their names and message types look like, which names are one, and which topic a pattern asks for."""

import re
from collections.abc import Iterable
from keyword import iskeyword
from typing import Final

from rvaft.errors import TreeError
from rvaft.model.nodes import Topic
from rvaft.model.patterns import ObjectPattern, Pattern
from rvaft.support.terminal import visible

FIELD: Final = "topic"
"""The field of an event, at its top level, that says over which topic it came."""

_NAME: Final = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*")
_BETWEEN: Final = re.compile(r"[./:]+")


def absolute(name: str) -> str:
    """A name as it is from the root of ROS: `/command` and `command` are one."""
    return name if name.startswith("/") else f"/{name}"


def wrong_name(name: str) -> str | None:
    """Why no topic or node of ROS can have this name, in a sentence, or None where one can."""
    if _NAME.fullmatch(name):
        return None
    return f'"{visible(name)}" is no name in ROS: a name is words of letters, digits and _ with / between them'


def wrong_type(type_: str) -> str | None:
    """Why this is no message type as Python imports it, in a sentence that mends it, or None where it is one."""
    if _importable(type_.split(".")):
        return None
    words = [word for word in _BETWEEN.split(type_) if word]
    words = [words[0], "msg", words[1]] if len(words) == 2 else words
    meant = ".".join(words) if _importable(words) else "package.msg.Name"
    return f'"{visible(type_)}" is no message type: it is written as Python imports it, "{meant}"'


def by_name(topics: Iterable[Topic]) -> dict[str, Topic]:
    """Topics by absolute name; raises `TreeError` for one declared twice, and for a name or type that cannot be."""
    found: dict[str, Topic] = {}
    for topic in topics:
        name = absolute(topic.name)
        if name in found:
            raise TreeError(f"topic {name} is declared twice", rule="duplicate-topic")
        wrong = [wrong_type(topic.type), *map(wrong_name, (topic.name, *topic.publishers))]
        for message in filter(None, wrong):
            raise TreeError(message, rule="malformed-topic")
        found[name] = topic
    return found


def _importable(words: list[str]) -> bool:
    return len(words) > 2 and all(word.isascii() and word.isidentifier() and not iskeyword(word) for word in words)


def topic_of(pattern: Pattern) -> Pattern | None:
    """What a pattern asks of the topic, or None where it asks nothing."""
    fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    return next((inner for name, inner in fields if name == FIELD), None)
