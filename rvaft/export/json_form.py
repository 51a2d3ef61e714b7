"""A tree as JSON, for programs.

Schema, version 1 (fields are only ever added)::

    {"format": "rvaft", "version": 1, "root": NAME, "causality": "top_down" | "bottom_up",
     "nodes":   [{"name", "gate": null | "or" | "and" | "sand" | "sand_rl" | "vot", "threshold": null | K,
                  "children": [NAME], "on": null | CALL, "when": null | GUARD, "kind": null | "fault" | "attack",
                  "label": null | TEXT, "attributes": [[KEY, VALUE]]}],
     "events":  [{"name", "parameters": [NAME], "pattern": PATTERN}],
     "ignores": [{"on": CALL, "when": null | GUARD}],
     "topics":  [{"name", "type", "publishers": [NAME]}]}

CALL is `{"event": NAME, "arguments": [PATTERN]}`; PATTERN one of `{"literal": VALUE}`, `{"variable": NAME}`, `{"any": true}`,
`{"object": {FIELD: PATTERN}}`, `{"list": [PATTERN]}`; GUARD a text in the language of guards. Nodes stand in the order of
their declaration.
"""

import json
from typing import assert_never

from rvaft.model.expressions import guard_text
from rvaft.model.nodes import Node, On
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

VERSION = 1


def json_text(tree: RVAFT) -> str:
    """The tree as one JSON object."""
    return json.dumps(json_value(tree), indent=2, ensure_ascii=False) + "\n"


def json_value(tree: RVAFT) -> dict[str, Json]:
    """The tree as a JSON value.

    >>> import rvaft
    >>> [node["kind"] for node in json_value(rvaft.loads("top or a b; a fault;"))["nodes"]]
    [None, 'fault', None]
    """
    return {
        "format": "rvaft",
        "version": VERSION,
        "root": tree.root,
        "causality": tree.causality.value,
        "nodes": [_node(node) for node in tree.nodes.values()],
        "events": [
            {"name": event.name, "parameters": list(event.parameters), "pattern": _pattern(event.pattern)}
            for event in tree.events.values()
        ],
        "ignores": [
            {"on": _call(ignore.on), "when": ignore.when and guard_text(ignore.when)} for ignore in tree.ignores
        ],
        "topics": [
            {"name": topic.name, "type": topic.type, "publishers": list(topic.publishers)}
            for topic in tree.topics.values()
        ],
    }


def _node(node: Node) -> Json:
    return {
        "name": node.name,
        "gate": node.gate and node.gate.value,
        "threshold": node.threshold,
        "children": list(node.children),
        "on": node.on and _call(node.on),
        "when": node.when and guard_text(node.when),
        "kind": node.kind and node.kind.value,
        "label": node.label,
        "attributes": [list(pair) for pair in node.attributes],
    }


def _call(on: On) -> Json:
    return {"event": on.event, "arguments": [_pattern(argument) for argument in on.arguments]}


def _pattern(pattern: Pattern) -> Json:
    match pattern:
        case Literal(value):
            return {"literal": value}
        case Variable(name):
            return {"variable": name}
        case Anything():
            return {"any": True}
        case ObjectPattern(fields):
            return {"object": {name: _pattern(inner) for name, inner in fields}}
        case ListPattern(items):
            return {"list": [_pattern(item) for item in items]}
        case _ as never:
            assert_never(never)
