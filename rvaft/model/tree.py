"""The tree itself: an immutable RVAFT over a frozen networkx DAG (semantics, section 1).

The constructor checks what makes a structure a tree at all (every `_check_*` one rule); the rules about scenarios are in
`rvaft.rules`. Questions about the graph are asked of networkx.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from heapq import heappop, heappush
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import networkx as nx

from rvaft.errors import ToolFailed, ToolMissing, TreeError
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, EventType, Ignore, Kind, Node, On, Relevant, Topic
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable, substitute, walk
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.topics import by_name

if TYPE_CHECKING:
    from rvaft.analysis.branches import Branch


@dataclass(frozen=True, slots=True)
class Whole:
    """What a restricted tree was made from, and by which selection."""

    tree: "RVAFT"
    branch: int | None = None
    kind: Kind | None = None
    origins: Mapping[str, str] = field(default_factory=dict, hash=False)


class RVAFT:
    """An attack-fault tree with runtime events.

    `nodes` keeps the order of declaration. `alphabet` is what decides relevance under `projected`. A tree restricted to some
    branches of another one is `part_of` it: it keeps the alphabet of the whole, and `origins` maps its nodes to the whole's.

    `topics` says where events come from in ROS, by absolute name (`/command`).

    Trees are equal that are written the same way but for order and places; topics count, although no verdict depends on them.

    Raises `TreeError` for what is no tree: an unknown root or child, a cycle, a child listed twice, a threshold out of
    range, an unknown event type, a wrong number of arguments, a parameter that is not in its pattern, a topic declared
    twice, a name or type that no topic can have.

    >>> from rvaft import Gate, Node
    >>> tree = RVAFT("top", [Node("top", Gate.AND, ("a", "b")), Node("a"), Node("b")])
    >>> tree.order, tree.occurrences
    (('top', 'a', 'b'), ('a', 'b'))
    """

    def __init__(
        self,
        root: str,
        nodes: Iterable[Node],
        events: Iterable[EventType] = (),
        *,
        ignores: Iterable[Ignore] = (),
        topics: Iterable[Topic] = (),
        causality: Causality = Causality.TOP_DOWN,
        part_of: "Whole | None" = None,
    ) -> None:
        self.root = root
        self.nodes: Mapping[str, Node] = MappingProxyType({node.name: node for node in nodes})
        self.events: Mapping[str, EventType] = MappingProxyType({event.name: event for event in events})
        self.ignores = tuple(ignores)
        self.topics: Mapping[str, Topic] = MappingProxyType(by_name(topics))
        self.causality = causality
        self.part_of = part_of
        for event in self.events.values():
            _check_parameters(event)
        for node in self.nodes.values():
            _check_gate(node)
            _check_children(node, self.nodes)
            if node.on is not None:
                _check_call(node.on, self.events, node.name)
        for ignore in self.ignores:
            _check_call(ignore.on, self.events, None)
        if root not in self.nodes:
            raise TreeError(f"the root {root} is not a node of the tree", rule="no-root", nodes=[root])
        if len(list(sorted_topologically({node.name: node.children for node in self.nodes.values()}))) < len(
            self.nodes
        ):
            cycle = [start for start, _ in nx.find_cycle(self.graph)]
            raise TreeError(f"the tree has a cycle: {' -> '.join([*cycle, cycle[0]])}", rule="cycle", nodes=cycle)

    def __reduce__(self) -> tuple[Any, ...]:
        parts = self.root, tuple(self.nodes.values()), tuple(self.events.values())
        stated = {"ignores": self.ignores, "topics": tuple(self.topics.values()), "causality": self.causality}
        return _rebuilt, (parts, {**stated, "part_of": self.part_of})

    # -- order and structure ------------------------------------------------------------------------------------

    @cached_property
    def graph(self) -> nx.DiGraph:
        """The nodes and their children as a frozen graph of networkx; a node of it has its `Node` as `node`."""
        graph = nx.DiGraph()
        graph.add_nodes_from((name, {"node": node}) for name, node in self.nodes.items())
        graph.add_edges_from((name, child) for name, node in self.nodes.items() for child in node.children)
        return nx.freeze(graph)

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The nodes reachable from the root, parents before children, in a stable order."""
        preorder = reachable(self.root, lambda name: self.nodes[name].children)
        return tuple(sorted_topologically({name: self.nodes[name].children for name in preorder}))

    def top_down(self) -> Iterator[Node]:
        """The reachable nodes, parents before children."""
        return (self.nodes[name] for name in self.order)

    def bottom_up(self) -> Iterator[Node]:
        """The reachable nodes, children before parents."""
        return (self.nodes[name] for name in reversed(self.order))

    def parents(self, name: str) -> tuple[str, ...]:
        """The reachable parents of a node, in a stable order."""
        return self._parents.get(name, ())

    @cached_property
    def _parents(self) -> Mapping[str, tuple[str, ...]]:
        parents: dict[str, list[str]] = {}
        for node in self.top_down():
            for child in node.children:
                parents.setdefault(child, []).append(node.name)
        return {child: tuple(names) for child, names in parents.items()}

    @cached_property
    def shared(self) -> frozenset[str]:
        """The reachable nodes with more than one parent."""
        return frozenset(name for name, parents in self._parents.items() if len(parents) > 1)

    # -- events -------------------------------------------------------------------------------------------------

    def pattern(self, name: str) -> Pattern | None:
        """The runtime event of a node with its arguments filled in, or None where it has none."""
        return self._patterns[name]

    @cached_property
    def _patterns(self) -> Mapping[str, Pattern | None]:
        return {node.name: self._pattern_of(node) for node in self.nodes.values()}

    def _pattern_of(self, node: Node) -> Pattern | None:
        if not node.has_event:
            return None
        if node.on is None:
            return ObjectPattern((("event", Literal(self.origins.get(node.name, node.name))),))
        return self.instantiate(node.on)

    def instantiate(self, on: On) -> Pattern:
        """The pattern of an event type with arguments for parameters.

        `_` is a fresh variable: where its parameter stands more than once in the pattern, a local one.
        """
        event = self.events[on.event]
        by: dict[str, Pattern] = {}
        for number, (parameter, argument) in enumerate(zip(event.parameters, on.arguments, strict=True), 1):
            uses = sum(part == Variable(parameter) for part in walk(event.pattern))
            fresh = isinstance(argument, Anything) and uses > 1
            by[parameter] = Variable(f"_{number}") if fresh else argument
        return substitute(event.pattern, by)

    @cached_property
    def occurrences(self) -> tuple[str, ...]:
        """The reachable nodes that have a runtime event, parents before children."""
        return tuple(node.name for node in self.top_down() if node.has_event)

    @property
    def restricted(self) -> bool:
        """Whether the tree is a part of another one and keeps the alphabet of that."""
        return self.part_of is not None

    @property
    def origins(self) -> Mapping[str, str]:
        """Of a restricted tree: the name that each copied node has in the whole."""
        return {} if self.part_of is None else self.part_of.origins

    @cached_property
    def alphabet(self) -> tuple[Relevant, ...]:
        """Which events are relevant, before `ignore` (semantics, section 3): one entry per occurrence."""
        if self.part_of is not None:
            return self.part_of.tree.alphabet
        return tuple(self._relevant(name) for name in self.occurrences)

    def _relevant(self, name: str) -> Relevant:
        pattern, when = self._patterns[name], self.nodes[name].when
        assert pattern is not None
        own = when is not None and set(guard_variables(when)) <= set(pattern_variables(pattern))
        return Relevant(name, pattern, when if own else None)

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """The rigid variables of the runtime events of reachable nodes, in order of first occurrence."""
        names = (v for name in self.occurrences for v in pattern_variables(self._patterns[name] or Anything()))
        return tuple(dict.fromkeys(name for name in names if not name.startswith("_")))

    def branches(self) -> "Iterator[Branch]":
        """The branches in the order of their numbers, from 1; lazily, since there may be very many."""
        found: Iterator[Branch] = import_module("rvaft.analysis.branches").branches(self)  # branches are above the tree
        return found

    # -- pictures -----------------------------------------------------------------------------------------------

    def to_dot(
        self,
        *,
        events: bool = False,
        names: bool = True,
        wrap: int | None = None,
        depth: int | None = None,
        collapse: Iterable[str] = (),
        branch: int | None = None,
        legend: bool = False,
        stagger: bool = False,
    ) -> str:
        """The tree drawn in the DOT language of Graphviz.

        `events` shows runtime events and guards, `names` those of nodes that have a label as well, `wrap` breaks lines at so many
        columns, `depth` and `collapse` leave out what is below a level or a node, `branch` marks the branch of that number,
        `stagger` sets every other leaf of a gate lower, which makes the tree narrower. Raises `OptionError`, and `TreeError` where there is no such branch.
        """
        export = import_module("rvaft.export")  # drawing is above the tree

        look = export.looking(
            self,
            events=events,
            names=names,
            wrap=wrap,
            depth=depth,
            collapse=collapse,
            branch=branch,
            legend=legend,
            stagger=stagger,
        )
        text: str = export.dot_text(self, look)
        return text

    def _repr_svg_(self) -> str | None:
        """The picture that a notebook shows, or None, for the plain `repr`, where Graphviz does not draw it."""
        export = import_module("rvaft.export")  # drawing is above the tree

        try:
            svg: bytes = export.picture(self.to_dot(), "svg", timeout=20)
            return svg.decode()
        except (ToolMissing, ToolFailed):
            return None

    # -- value semantics ----------------------------------------------------------------------------------------

    def _identity(self) -> tuple[object, ...]:
        return (
            self.root,
            frozenset(self.nodes.values()),
            frozenset(self.events.values()),
            self.ignores,
            frozenset(self.topics.values()),
            self.causality,
            self.part_of,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RVAFT) and self._identity() == other._identity()

    def __hash__(self) -> int:
        return hash((self.root, tuple(sorted(self.nodes))))

    def __repr__(self) -> str:
        return f"<RVAFT {self.root}: {len(self.nodes)} nodes>"


def reachable(start: str, children: Callable[[str], Sequence[str]]) -> Iterator[str]:
    """The nodes that these children lead to, the first one included, each once, in preorder."""
    seen: set[str] = set()
    todo = [start]
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            yield name
            todo.extend(reversed(children(name)))


def sorted_topologically(children: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """The nodes, parents before children, the first one in the mapping first where several may come; none that a cycle leads to."""
    names = tuple(children)
    rank = {name: index for index, name in enumerate(names)}
    waiting = [0] * len(names)
    for below in children.values():
        for child in below:
            waiting[rank[child]] += 1
    ready = [index for index, count in enumerate(waiting) if count == 0]
    while ready:
        name = names[heappop(ready)]
        yield name
        for child in children[name]:
            index = rank[child]
            waiting[index] -= 1
            if waiting[index] == 0:
                heappush(ready, index)


def _check_parameters(event: EventType) -> None:
    used = pattern_variables(event.pattern)
    for parameter in event.parameters:
        if parameter not in used:
            raise TreeError(
                f"parameter {parameter} of event {event.name} is not in its pattern", rule="unused-parameter"
            )


def _rebuilt(arguments: tuple[Any, ...], keywords: dict[str, Any]) -> RVAFT:
    return RVAFT(*arguments, **keywords)


def _check_gate(node: Node) -> None:
    if (node.gate is None) != (not node.children):
        raise TreeError(
            f"{node.name} needs a gate and children, or neither", rule="gate-without-children", nodes=[node.name]
        )
    if (node.gate is not None and node.gate.counts) != (node.threshold is not None):
        raise TreeError(f"{node.name}: a threshold belongs to a VOT gate alone", rule="threshold", nodes=[node.name])
    if node.threshold is not None and not 1 <= node.threshold <= len(node.children):
        message = f"{node.name}: the threshold {node.threshold} is not between 1 and {len(node.children)}"
        raise TreeError(message, rule="threshold", nodes=[node.name])


def _check_children(node: Node, nodes: Mapping[str, Node]) -> None:
    for child in node.children:
        if child not in nodes:
            raise TreeError(f"{node.name} has an unknown child {child}", rule="unknown-child", nodes=[node.name, child])
    if len(set(node.children)) < len(node.children):
        twice = next(child for child in node.children if node.children.count(child) > 1)
        raise TreeError(f"{node.name} lists its child {twice} twice", rule="duplicate-child", nodes=[node.name, twice])


def _check_call(on: On, events: Mapping[str, EventType], node: str | None) -> None:
    nodes = [] if node is None else [node]
    if on.event not in events:
        raise TreeError(f"unknown event type {on.event}", rule="unknown-event", nodes=nodes)
    expected = len(events[on.event].parameters)
    if len(on.arguments) != expected:
        message = f"event {on.event} takes {expected} arguments, not {len(on.arguments)}"
        raise TreeError(message, rule="event-arity", nodes=nodes)
