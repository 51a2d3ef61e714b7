"""Trees for other programs: complete as JSON, and reduced in Galileo's format.

`docs/how-to/drawing.md` has the JSON schema. Galileo has no SAND: it becomes `pand`, which is
equivalent over single events. `losses` lists what else the Galileo text lacks.
"""

import sys
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, Final, assert_never

from rvaft.errors import OptionError
from rvaft.export.layout import turn
from rvaft.model.event_time import EventTime, TextFormat
from rvaft.model.expressions import WORD, bare_value, guard_text
from rvaft.model.guards import Guard, Operation, Operator, TimePoint, walk
from rvaft.model.nodes import Causality, Gate, Node, Without
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
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


def galileo_text(tree: RVAFT) -> str:
    """Return the reachable nodes as Galileo statements, parents first; raises `OptionError`.

    >>> import rvaft
    >>> print(galileo_text(rvaft.loads("top sand_rl a b; a fault;")), end="")
    toplevel "top";
    "top" pand "b" "a";
    "a";
    "b";
    """
    return "\n".join([f"toplevel {_name(tree.root)};", *map(_statement, tree.top_down())]) + "\n"


def losses(tree: RVAFT) -> Iterator[str]:
    """Yield what the Galileo text lacks, one clause each."""
    nodes = list(tree.top_down())
    several = _with_several_leaves(tree)
    ordered = sum(node.gate in _SEQUENCES and not several.isdisjoint(node.children) for node in nodes)
    again = len(_failing_again(tree))
    unwritable = sum(not _is_plain(*pair) for node in nodes for pair in node.attributes)
    unrated = sum(node.leaf and not node.attributes for node in nodes)
    for lost, what in (
        (ordered, "sand gate{} written as pand, which orders how parts end, and not all that is in them"),
        (again, "gate{} written as pand, of which a later input may fail again, or together: in Galileo it fails once"),
        (sum(node.on is not None for node in nodes), "runtime event{} left out"),
        (sum(node.times > 1 for node in nodes), "number{} of events (times) left out"),
        (sum(node.within is not None for node in nodes), "window{} (within) left out"),
        (sum(len(node.without) for node in nodes), "absent event{} (without) left out"),
        (sum(node.when is not None for node in nodes), "guard{} left out"),
        (sum(node.kind is not None for node in nodes), "fault or attack mark{} left out"),
        (sum(node.label is not None for node in nodes), "label{} left out"),
        (unwritable, "attribute{} left out whose name or value Galileo cannot write"),
    ):
        if lost:
            yield f"{lost} {what.format('s' * (lost != 1))}"
    for declared, what in (
        (tree.ignores, "ignore declarations"),
        (tree.topics, "topic declarations"),
        (tree.causality is Causality.BOTTOM_UP, "causality bottom_up"),
        (tree.time, "the time of events"),
        (tree.assumes, "assumptions"),
    ):
        if declared:
            yield f"{what} left out"
    if tree.semantics != Semantics.SCATTERED:
        yield f"semantics {tree.semantics or 'projected'} left out; the file is read as scattered: failures persist"
    if unrated:
        yield f"{unrated} basic event{'s' * (unrated != 1)} without a rate or probability, which most tools require"


def _with_several_leaves(tree: RVAFT) -> set[str]:
    """Return the nodes with several leaves in some scenario."""
    most: dict[str, int] = {}
    for node in tree.bottom_up():
        below = [most[child] for child in node.children]
        most[node.name] = min(2, max(below) if node.gate is Gate.OR else sum(below)) if below else 1
    return {name for name, leaves in most.items() if leaves > 1}


def _failing_again(tree: RVAFT) -> set[str]:
    """Return the ordered gates whose inputs in order of their ends are not those in order of their failures.

    They are, if every match of each input but the first ends when it fails, and no two can end with one event.
    """
    found: set[str] = set()
    choosing: set[str] = set()
    last: dict[str, frozenset[str]] = {}
    for node in tree.bottom_up():
        children = _written_children(node)
        if node.gate in (Gate.OR, Gate.VOT) and (node.threshold or 1) < len(children):
            choosing.add(node.name)
        if not node.leaf and _GATES[node.gate] == "pand":  # type: ignore[index]
            last[node.name] = last[children[-1]]
            if any(y in choosing or last[x] & last[y] for x, y in pairwise(children)):
                found.add(node.name)
            choosing.update([node.name] if children[-1] in choosing else ())
            continue
        last[node.name] = (
            frozenset[str]().union(*[last[child] for child in children]) if children else frozenset([node.name])
        )
        choosing.update([node.name] if not choosing.isdisjoint(children) else ())
    return found


_GATES: Final[Mapping[Gate, str]] = {
    Gate.AND: "and",
    Gate.OR: "or",
    Gate.SAND: "pand",
    Gate.SAND_RL: "pand",
    Gate.PAND: "pand",
    Gate.VOT: "{}of{}",
}
assert set(_GATES) == set(Gate), "every gate has a word"
_SEQUENCES: Final = frozenset(gate for gate, word in _GATES.items() if word == "pand") - {Gate.PAND}


def _statement(node: Node) -> str:
    gate = [] if node.gate is None else [_GATES[node.gate].format(node.threshold, len(node.children))]
    children = _written_children(node)
    attributes = [f"{key}={value}" for key, value in node.attributes if _is_plain(key, value)]
    return " ".join([_name(node.name), *gate, *map(_name, children), *attributes]) + ";"


def _written_children(node: Node) -> list[str]:
    """Return the children in the order in which Galileo has them."""
    turns = {child: turn(node, place) for place, child in enumerate(node.children)}
    return sorted(node.children, key=turns.__getitem__)


def _name(name: str) -> str:
    if '"' in name or "\\" in name or not name.isprintable():
        raise OptionError(f"Galileo cannot write the name {name!r}: rename the node")
    return f'"{name}"'


def _is_plain(key: str, value: str) -> bool:
    """Whether Galileo, which does not quote values, can write an attribute."""
    return WORD.fullmatch(key) is not None and bare_value(value)
