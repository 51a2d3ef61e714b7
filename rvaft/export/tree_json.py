"""Trees, complete, and their events as JSON; `docs/how-to/drawing.md` has the schema."""

import sys
from typing import Any, assert_never

from rvaft.model.event_time import EventTime, TextFormat
from rvaft.model.expressions import guard_text
from rvaft.model.guards import Guard, Operation, Operator, TimePoint, walk
from rvaft.model.nodes import Node, Without
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.support.terminal import readable_json


def json_text(tree: RVAFT) -> str:
    """Return the tree as one JSON object, of version 2 if it has absent events or different values.

    >>> import json
    >>> import rvaft
    >>> [node["kind"] for node in json.loads(json_text(rvaft.loads("top or a b; a fault;")))["nodes"]]
    [None, 'fault', None]
    """
    value = {
        "format": "rvaft",
        "version": 2 if any(node.without or node.own_values for node in tree.nodes.values()) else 1,
        "root": tree.root,
        "causality": tree.causality,
        "semantics": tree.semantics,
        "time": time_json(tree.time),
        "nodes": [
            _record(node, "name gate threshold children on times when within kind label attributes")
            | {"condition": condition_json(node.when)}
            | _extra(node)
            for node in tree.nodes.values()
        ],
        "events": [_record(event, "name parameters pattern") for event in tree.events.values()],
        "ignores": [_record(ignore, "on when") | {"condition": condition_json(ignore.when)} for ignore in tree.ignores],
        "topics": [_record(topic, "name type publishers") for topic in tree.topics.values()],
    }
    guards = [node.when for node in tree.nodes.values()] + [ignore.when for ignore in tree.ignores]
    if any(isinstance(one, Operation) and one.operator is Operator.LOWER for guard in guards for one in walk(guard)):
        characters = map(chr, range(sys.maxunicode + 1))
        value["lowercase"] = {one: one.lower() for one in characters if one.lower() != one}
    return readable_json(value, indent=2) + "\n"


def _extra(node: Node) -> dict[str, Any]:
    """Return what version 1 does not have."""
    found: dict[str, Any] = {"without": [*map(_absent, node.without)]}
    return {name: value for name, value in {**found, "distinct": node.distinct, "each": node.each}.items() if value}


def _absent(clause: Without) -> dict[str, Any]:
    return _record(clause, "on when side duration") | {"condition": condition_json(clause.when)}


def _record(thing: object, names: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in names.split():
        found[name] = value = getattr(thing, name)
        if name == "on" and value is not None:
            found[name] = {"event": value.event, "arguments": list(map(pattern_json, value.arguments))}
        elif name == "when" and value is not None:
            found[name] = guard_text(value)
        elif name == "pattern":
            found[name] = pattern_json(value)
        elif isinstance(value, TextFormat):
            found[name] = {"strptime": value.pattern, "year": value.year, "zone": value.zone}
    return found


def pattern_json(pattern: Pattern) -> Json:
    """Return a pattern as in `json_text`."""
    match pattern:
        case Literal(value):
            return {"literal": value}
        case Variable(name):
            return {"variable": name}
        case Anything():
            return {"any": True}
        case ObjectPattern(fields):
            return {"object": {name: pattern_json(inner) for name, inner in fields}}
        case ListPattern(items):
            return {"list": list(map(pattern_json, items))}
        case SomeItem(item):
            return {"some": pattern_json(item)}
        case _ as never:
            assert_never(never)


def time_json(time: EventTime | None) -> Json:
    """Return the time of events as in `json_text`."""
    return None if time is None else _record(time, "field format late")


def condition_json(guard: Guard | None) -> Json:
    """Return a guard as in `json_text`."""
    match guard:
        case None:
            return None
        case TimePoint(point=point, node=node):
            return {"point": point, "node": node}
        case Literal() | Variable():
            return pattern_json(guard)
        case Operation(operator, operands):
            return {"operator": operator, "operands": list(map(condition_json, operands))}
        case _ as never:
            assert_never(never)
