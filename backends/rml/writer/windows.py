"""Windows over times that are integers of events: a window becomes a guard over their variables."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count

from rvaft.core.property import Property
from rvaft.core.restriction import property_of
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.assumptions import places
from rvaft.model.event_time import UNITS
from rvaft.model.guards import Operation, Operator
from rvaft.model.nodes import Gate, Node, ValueType
from rvaft.model.patterns import Anything, Literal, Variable
from rvaft.model.tree import RVAFT, reachable


def without_windows(prop: Property) -> Property:
    """Return the property of the tree in which guards replace windows.

    The tree assumes `types`, `present` and `exact`. Raises `NotExpressible` if an event of a window
    has no parameter of type `integer` for its time, or if it may be left out.
    """
    tree = prop.tree
    windows = [name for name, node in tree.nodes.items() if node.within is not None]
    if tree.part_of is not None:
        raise NotExpressible(unwritten("windows are written for whole trees"), nodes=windows)
    unit = UNITS.get(str(tree.time.format)) if tree.time is not None else None
    if unit is None:
        raise NotExpressible(unwritten("times are written as integers of one unit alone"), nodes=windows)
    nodes, times = dict(tree.nodes), dict[str, str]()
    for name in windows:
        below = _below(tree, name)
        named = [_time(tree, nodes, times, one) for one in below if one in tree.occurrences]
        gate = replace(nodes[name], within=None)
        if len(named) > 1:
            most = Operation(Operator.MAX, tuple(map(Variable, named)))
            least = Operation(Operator.MIN, tuple(map(Variable, named)))
            length = Operation(Operator.SUB, (most, least))
            limit = (tree.nodes[name].within or 0) // unit
            leaf = _free(f"window of {name}", nodes)
            nodes[leaf] = Node(leaf, when=Operation(Operator.LE, (length, Literal(limit))))
            gate = replace(gate, children=(*gate.children, leaf))
        nodes[name] = gate
    found = property_of(tree.changed(nodes=nodes.values()))
    return replace(found, assumes=prop.assumes, extensions=prop.extensions, time=prop.time)


def _below(tree: RVAFT, name: str) -> Sequence[str]:
    """Return the nodes of a window; raises `NotExpressible` for choices and counted events."""
    found = list(reachable(name, lambda one: tree.nodes[one].children))
    for one in found:
        node = tree.nodes[one]
        if node.gate in (Gate.OR, Gate.VOT) or node.times > 1:
            raise NotExpressible(
                unwritten("windows are written over events that all matches have, each once"), nodes=[one]
            )
    return found


def _time(tree: RVAFT, nodes: dict[str, Node], times: dict[str, str], name: str) -> str:
    """Return the variable that holds the time of a node's event, which the node may get here."""
    if name in times:
        return times[name]
    on = nodes[name].on
    path = tree.time.field if tree.time is not None else ()
    event = None if on is None else tree.events[on.event]
    parameter = None
    if event is not None:
        found = (part for way, part, _ in places(event.pattern) if way == tuple(path) and isinstance(part, Variable))
        parameter = next((part.name for part in found if part.name in event.parameters), None)
    if on is None or event is None or parameter is None or event.type_of(parameter) is not ValueType.INTEGER:
        raise NotExpressible(
            unwritten("the time of an event in a window is a parameter of type `integer`"), nodes=[name]
        )
    place = event.parameters.index(parameter)
    match on.arguments[place]:
        case Variable(known):
            times[name] = known
        case Anything():
            times[name] = _free("Time", {v for node in nodes.values() if node.on for v in node.on.variables})
            arguments = (*on.arguments[:place], Variable(times[name]), *on.arguments[place + 1 :])
            nodes[name] = replace(nodes[name], on=replace(on, arguments=arguments))
        case _:
            raise NotExpressible(unwritten("a time in a window is a constant"), nodes=[name])
    return times[name]


def _free(wanted: str, taken: dict[str, Node] | set[str]) -> str:
    return next(name for number in count(1) if (name := f"{wanted}{number if number > 1 else ''}") not in taken)
