"""The immutable attack-fault tree (semantics, section 1), and traversals of graphs.

The constructor checks the structure; the rules about scenarios are in `rvaft.rules`.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from heapq import heappop, heappush
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rvaft.errors import TreeError, one_of
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Guard, renamed, time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import (
    Assumption,
    Causality,
    EventType,
    Ignore,
    Kind,
    Node,
    On,
    Relevant,
    Side,
    Topic,
    Without,
    by_name,
)
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable, substitute, walk
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.verdict import Semantics
from rvaft.support.plugins import display

if TYPE_CHECKING:
    import networkx as nx

T = TypeVar("T", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Whole:
    """The origin of a restricted tree: the whole tree and the restriction."""

    tree: "RVAFT"
    branch: int | None = None
    kind: Kind | None = None


class RVAFT:
    """An attack-fault tree with runtime events.

    `nodes` has the order of declaration. A restricted tree has its origin in `part_of` and keeps
    the `alphabet` of the whole tree. `translated` is whether dynamic gates of Galileo were read as others, for
    monitors. `topics` are the ROS topics by absolute name; `time` and
    `semantics` may be None. `assumes` are the stated assumptions; ORDER is among them if `time` has
    a lateness. `shows` are the variables of `show`, and
    `repeat_by` that of `repeat by`. Trees with equal content are equal regardless of
    order and positions.

    Raises `TreeError` for an unknown root or child, a cycle, a duplicate child, a threshold out of
    range, an unknown event type, a wrong number of arguments, an unused parameter, a duplicate or
    invalid topic, an invalid `times` or `within`, and a time point of an unknown node.

    >>> from rvaft import Gate, Node
    >>> tree = RVAFT("top", [Node("top", "and", ("a", "b")), Node("a"), Node("b")])
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
        time: EventTime | None = None,
        semantics: Semantics | None = None,
        assumes: Iterable[Assumption] = (),
        shows: Iterable[str] = (),
        repeat_by: str | None = None,
        part_of: "Whole | None" = None,
        translated: bool = False,
    ) -> None:
        self.root = root
        self.nodes: Mapping[str, Node] = MappingProxyType({node.name: node for node in nodes})
        self.events: Mapping[str, EventType] = MappingProxyType({event.name: event for event in events})
        self.ignores = tuple(ignores)
        self.topics: Mapping[str, Topic] = MappingProxyType(by_name(topics))
        self.causality = causality
        self.time = time
        self.semantics = semantics
        order = {Assumption.ORDER} if time is not None and time.late is not None else set()
        self.assumes = (frozenset(map(Assumption, assumes)) - {Assumption.ORDER}) | order
        self.shows = tuple(dict.fromkeys(shows))
        self.repeat_by = repeat_by
        self.part_of = part_of
        self.translated = translated
        for event in self.events.values():
            used = pattern_variables(event.pattern)
            for parameter in event.parameters:
                if parameter not in used:
                    message = f"parameter {parameter} of event {event.name} is not in its pattern"
                    raise TreeError(message, rule="unused-parameter")
        for node in self.nodes.values():
            _check_node(node, self.nodes)
            for point in time_points(node.when) if part_of is None else ():
                if point.node not in self.nodes:
                    message = f"the guard of {node.name} uses {point.name}, but there is no node {point.node}"
                    raise TreeError(message, rule="unbound-time", nodes=[node.name])
            if node.on is not None:
                _check_call(node.on, self.events, [node.name])
            for clause in node.without:
                _check_call(clause.on, self.events, [node.name])
            if node.own_values:
                _check_own_values(node, self.nodes)
        for ignore in self.ignores:
            _check_call(ignore.on, self.events, [])
        if repeat_by is not None and part_of is None and repeat_by not in self.variables:
            own = any(repeat_by in node.own_values for node in self.nodes.values())
            why = "of which each counted event has its own" if own else "which no event of a node binds"
            raise TreeError(f"`repeat by` names {repeat_by}, {why}", rule="shown-variable")
        for name in self.shows if part_of is None else ():
            if not any(node.on is not None and name in node.on.variables for node in self.nodes.values()):
                raise TreeError(f"`show` lists {name}, which no event of a node binds", rule="shown-variable")
        if root not in self.nodes:
            raise TreeError(f"the root {root} is not a node of the tree", rule="no-root", nodes=[root])
        if len(self.order) < len(self.nodes) and (cycle := find_cycle({n: self.nodes[n].children for n in self.nodes})):
            raise TreeError(f"the tree has a cycle: {' -> '.join([*cycle, cycle[0]])}", rule="cycle", nodes=cycle)

    def changed(self, **parts: Any) -> "RVAFT":
        """Return the tree with other arguments of the constructor; raises the same errors.

        >>> from rvaft import loads
        >>> loads("semantics strict; top and a b;").changed(semantics=None).semantics
        """
        return RVAFT(**{**_stated(self), **parts})

    def with_guards(self, change: Callable[[Guard], Guard]) -> "RVAFT":
        """Return the tree with each guard replaced, also those of absent and of ignored events.

        It is this tree if `change` returns each guard itself.
        """

        def changed(one: Any, **parts: Any) -> Any:
            parts |= {} if one.when is None else {"when": change(one.when)}
            return one if all(getattr(one, name) == part for name, part in parts.items()) else replace(one, **parts)

        nodes = [changed(node, without=tuple(map(changed, node.without))) for node in self.nodes.values()]
        ignores = tuple(map(changed, self.ignores))
        whole = self.part_of and replace(self.part_of, tree=self.part_of.tree.with_guards(change))
        same = nodes == [*self.nodes.values()] and ignores == self.ignores and whole == self.part_of
        return self if same else self.changed(nodes=nodes, ignores=ignores, part_of=whole)

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(RVAFT, **_stated(self)), ()

    @cached_property
    def graph(self) -> "nx.DiGraph":
        """The nodes and children as a frozen networkx graph; the attribute `node` is the `Node`."""
        import networkx as nx  # noqa: PLC0415 -- slow to import

        graph = nx.DiGraph()
        graph.add_nodes_from((name, {"node": node}) for name, node in self.nodes.items())
        graph.add_edges_from((name, child) for name, node in self.nodes.items() for child in node.children)
        return nx.freeze(graph)

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The nodes reachable from the root, parents before children, in a stable order."""
        preorder = reachable(self.root, lambda name: self.nodes[name].children)
        return tuple(sorted_topologically({name: self.nodes[name].children for name in preorder}))

    @cached_property
    def rank(self) -> Mapping[str, int]:
        """The place of each reachable node in `order`."""
        return {name: place for place, name in enumerate(self.order)}

    def top_down(self) -> Iterator[Node]:
        """Iterate over the reachable nodes, parents before children."""
        return (self.nodes[name] for name in self.order)

    def bottom_up(self) -> Iterator[Node]:
        """Iterate over the reachable nodes, children before parents."""
        return (self.nodes[name] for name in reversed(self.order))

    def parents(self, name: str) -> tuple[str, ...]:
        """Return the reachable parents of a node, in a stable order."""
        return tuple(self._parents.get(name, ()))

    @cached_property
    def _parents(self) -> Mapping[str, list[str]]:
        parents: dict[str, list[str]] = {}
        for node in self.top_down():
            for child in node.children:
                parents.setdefault(child, []).append(node.name)
        return parents

    @cached_property
    def shared(self) -> frozenset[str]:
        """The reachable nodes with more than one parent."""
        return frozenset(name for name, parents in self._parents.items() if len(parents) > 1)

    def pattern(self, name: str) -> Pattern | None:
        """Return the pattern of a node's runtime event with its arguments, or None.

        A variable of each counted event (`distinct`, `each`) is local: it is called `_X` instead of `X`.
        """
        return self._patterns[name]

    @cached_property
    def _patterns(self) -> Mapping[str, Pattern | None]:
        found: dict[str, Pattern | None] = {}
        for name, node in self.nodes.items():
            default = ObjectPattern((("event", Literal(name)),)) if node.has_event else None
            found[name] = default if node.on is None else self.instantiate(node.on)
            if node.own_values and (whole := found[name]) is not None:
                found[name] = substitute(whole, {one: Variable(own_name(one)) for one in node.own_values})
        return found

    def guard(self, name: str) -> Guard | None:
        """Return the guard of a node, in which a variable of each counted event has another name."""
        node = self.nodes[name]
        return node.when if node.when is None or not node.own_values else renamed(node.when, own_names(node))

    def instantiate(self, on: On) -> Pattern:
        """Return the pattern of an event type with arguments for parameters.

        `_` is a fresh variable, local if its parameter occurs more than once in the pattern.
        """
        event = self.events[on.event]
        by: dict[str, Pattern] = {}
        for number, (parameter, argument) in enumerate(zip(event.parameters, on.arguments, strict=True), 1):
            by[parameter] = argument
            if isinstance(argument, Anything) and list(walk(event.pattern)).count(Variable(parameter)) > 1:
                by[parameter] = Variable(f"_{number}")
        return substitute(event.pattern, by)

    @cached_property
    def occurrences(self) -> tuple[str, ...]:
        """The reachable nodes with a runtime event, parents before children."""
        return tuple(node.name for node in self.top_down() if node.has_event)

    @property
    def restricted(self) -> bool:
        """Whether the tree is a restriction of another tree."""
        return self.part_of is not None

    @cached_property
    def alphabet(self) -> tuple[Relevant, ...]:
        """The relevant events before `ignore` (semantics, section 3): one entry per occurrence."""
        if self.part_of is not None:
            return self.part_of.tree.alphabet
        found: list[Relevant] = []
        for name in self.occurrences:
            node = self.nodes[name]
            pattern, when = self._patterns[name], node.when
            assert pattern is not None
            if node.own_values and node.on is not None:
                pattern = self.instantiate(node.on)
            own = when is not None and set(guard_variables(when)) <= set(pattern_variables(pattern))
            found.append(Relevant(name, pattern, when if own else None))
        return tuple(found)

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """The rigid variables of the reachable nodes' events, in order of first occurrence."""
        names = (v for name in self.occurrences for v in pattern_variables(self._patterns[name] or Anything()))
        return tuple(dict.fromkeys(name for name in names if not name.startswith("_")))

    @cached_property
    def absences(self) -> tuple[tuple[str, Without, Pattern], ...]:
        """The absent events of the reachable nodes: node, clause and pattern."""
        clauses = ((node.name, clause) for node in self.top_down() for clause in node.without)
        return tuple((name, clause, self.instantiate(clause.on)) for name, clause in clauses)

    def own_variables(self, clause: Without) -> frozenset[str]:
        """Return the variables of a `without` that no node's event binds: they are local to it."""
        tree = self if self.part_of is None else self.part_of.tree
        return frozenset(clause.variables).difference(tree.variables)

    def _repr_svg_(self) -> str:
        return cast("str", display("tree")(self))

    @cached_property
    def _identity(self) -> tuple[object, ...]:
        unordered = (frozenset(stated.values()) for stated in (self.nodes, self.events, self.topics))
        settings = self.ignores, self.causality, self.time, self.semantics, self.assumes, self.shows, self.repeat_by
        return (self.root, *unordered, *settings, self.part_of)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, RVAFT) and self._identity == other._identity)

    @cached_property
    def _hash(self) -> int:
        """Hash without nested values, so that hashing does not recurse."""
        return hash((self.root, frozenset((node.name, node.gate, node.children) for node in self.nodes.values())))

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"<RVAFT {self.root}: {len(self.nodes)} nodes>"


def own_name(name: str) -> str:
    """Return the local name of a variable of each counted event."""
    return f"_{name}"


def shown_name(local: str) -> str:
    """Return the name of such a variable as it is written in the tree."""
    return local.removeprefix("_")


def own_names(node: Node) -> dict[str, str]:
    """Return the local names of the variables of each counted event."""
    return {name: own_name(name) for name in node.own_values}


def reachable(start: T, children: Callable[[T], Sequence[T]]) -> Iterator[T]:
    """Iterate over the nodes reachable from `start`, each once, in preorder."""
    seen: set[T] = set()
    todo = [start]
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            yield name
            todo.extend(reversed(children(name)))


def sorted_topologically(children: Mapping[T, Sequence[T]]) -> Iterator[T]:
    """Iterate over the nodes, parents before children; ties follow the order of the mapping.

    Nodes on or below a cycle are omitted.
    """
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


def find_cycle(children: Mapping[T, Iterable[T]]) -> list[T]:
    """Return the nodes of one cycle in order; an empty list if acyclic."""
    done: set[T] = set()
    for start in children:
        path = {start: iter(children[start])} if start not in done else {}
        while path:
            name = next(reversed(path))
            below = next((child for child in path[name] if child not in done), None)
            if below is None:
                done.add(name)
                del path[name]
            elif below in path:
                return list(path)[list(path).index(below) :]
            else:
                path[below] = iter(children[below])
    return []


def knots(children: Mapping[T, Iterable[T]]) -> list[set[T]]:
    """Return the non-trivial strongly connected components."""
    import networkx as nx  # noqa: PLC0415 -- slow to import

    graph = nx.DiGraph((name, child) for name in children for child in children[name])
    return [knot for knot in nx.strongly_connected_components(graph) if graph.subgraph(knot).size()]


def _stated(tree: RVAFT) -> dict[str, Any]:
    names = (
        "root",
        "ignores",
        "causality",
        "time",
        "semantics",
        "assumes",
        "shows",
        "repeat_by",
        "part_of",
        "translated",
    )
    kept = {name: getattr(tree, name) for name in names}
    return {**kept, **{name: tuple(getattr(tree, name).values()) for name in ("nodes", "events", "topics")}}


def _check_node(node: Node, nodes: Mapping[str, Node]) -> None:
    name, children = node.name, node.children
    if (node.gate is None) != (not children):
        raise TreeError(f"{name} needs a gate and children, or neither", rule="gate-without-children", nodes=[name])
    if (node.gate is not None and node.gate.counts) != (node.threshold is not None):
        raise TreeError(
            f"{name}: a VOT gate needs a threshold, and no other gate has one", rule="threshold", nodes=[name]
        )
    if node.threshold is not None and not 1 <= node.threshold <= len(children):
        message = f"{name}: the threshold {node.threshold} is not between 1 and {len(children)}"
        raise TreeError(message, rule="threshold", nodes=[name])
    if node.times < 1 or (node.times > 1 and not (node.leaf and node.has_event)):
        message = f"{name}: `times {node.times}` requires a leaf with an event, and a number of at least 1"
        raise TreeError(message, rule="times", nodes=[name])
    own = () if node.on is None else node.on.variables
    if node.own_values and (not node.leaf or len({*node.own_values} & {*own}) < len(node.own_values)):
        message = f"{name}: `distinct` and `each` name variables of the events that the leaf counts, each once"
        raise TreeError(message, rule="own-values", nodes=[name])
    for clause in node.without:
        side, length = clause.side, clause.duration
        if (length is None and side is Side.AFTER) or (length is not None and (side is Side.DURING or length < 0)):
            message = f"{name}: `without` has a duration, of at least 0 s, with `after` and perhaps with `before`"
            raise TreeError(message, rule="without", nodes=[name])
    if node.within is not None and (node.within < 0 or node.leaf):
        message = f"{name}: `within` requires a gate, and a duration of at least 0 s"
        raise TreeError(message, rule="within", nodes=[name])
    for child in children:
        if child not in nodes:
            raise TreeError(f"{name} has an unknown child {child}", rule="unknown-child", nodes=[name, child])
    if len(set(children)) < len(children):
        twice = next(child for child in children if children.count(child) > 1)
        raise TreeError(f"{name} lists its child {twice} twice", rule="duplicate-child", nodes=[name, twice])


def _check_own_values(node: Node, nodes: Mapping[str, Node]) -> None:
    names = {*node.own_values}
    if time_points(node.when) and names & {*guard_variables(node.when)}:
        message = f"the guard of {node.name} compares times, and values that each of its events has for itself"
        raise TreeError(message, rule="own-values", nodes=[node.name])
    for other in nodes.values():
        used = {name for clause in other.without for name in clause.variables}
        if other.name != node.name:
            used.update(() if other.on is None else other.on.variables, guard_variables(other.when))
        if shared := names & used:
            message = (
                f"{min(shared)} has a value of its own in each event of {node.name}, so {other.name} cannot use it"
            )
            raise TreeError(message, rule="own-values", nodes=[node.name, other.name])


def _check_call(on: On, events: Mapping[str, EventType], nodes: list[str]) -> None:
    if on.event not in events:
        raise TreeError(f"unknown event type {on.event}", rule="unknown-event", nodes=nodes)
    expected = len(events[on.event].parameters)
    if len(on.arguments) != expected:
        message = f"event {on.event} takes {expected} arguments, not {len(on.arguments)}"
        raise TreeError(message, rule="event-arity", nodes=nodes)


def resolve_repetition(tree: RVAFT, by: str | None, *, repeat: bool) -> str | None:
    """Return the given variable of repetition, else that of the tree if it is repeated."""
    return by if by is not None else tree.repeat_by if repeat else None


def resolve_semantics(tree: RVAFT, semantics: Semantics | str | None = None) -> Semantics:
    """Return the given semantics, else that of the tree, else `projected`; raises `OptionError`.

    >>> from rvaft import loads
    >>> resolve_semantics(loads("semantics scattered; top or a b;"))
    <Semantics.SCATTERED: 'scattered'>
    """
    return (tree.semantics or Semantics.PROJECTED) if semantics is None else one_of(Semantics, semantics)
