"""Units: the alternatives below the choices at the root, for matches that need no joins.

In a unit nodes are not shared, no event can serve two occurrences that have no order, and no guard
relates occurrences, but for variables that all occurrences have: the *key*. So each value of the
key is an *instance* that is followed alone, and the matches of one gate join freely. Guards may also
bound differences of time points; the matches of a node then have the times that later bounds need.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from itertools import chain, combinations, product
from typing import Final, NamedTuple, Self

from rvaft.core.overlaps import Overlaps
from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    Property,
    Source,
    Times,
    Within,
    WithoutEvent,
)
from rvaft.core.property import Sequence as Ordered
from rvaft.core.times import point_bounds
from rvaft.model.guards import Guard, Operation, Operator, TimePoint, conjuncts, renamed, time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Pattern, Variable, rigid_variables, substitute
from rvaft.model.tree import reachable, shown_name
from rvaft.support.bits import mask_of

DEEPEST: Final = 100
"""The maximum depth of a unit: the steps of its matches are nested as deep."""
EFFORT: Final = 1_000_000
"""The maximum number of steps to find unordered occurrences that one event can serve."""


class Op(Enum):
    """How a node is complete."""

    LEAF = auto()
    ALL = auto()
    SEQUENCE = auto()
    ENDS = auto()
    ONE = auto()
    AT_LEAST = auto()


@dataclass(eq=False, slots=True)
class _Draft:
    """A node with at least one event; conditions are with the leaves."""

    op: Op
    name: str
    parts: list["_Draft"] = field(default_factory=list)
    kept: tuple[str, ...] = ()
    """The names of the children between which the gate chooses, in order of `parts`."""
    need: int = 0
    window: int | None = None
    event: Event | Times | None = None
    guards: list[Guard] = field(default_factory=list)
    bounds: list["_DraftBound"] = field(default_factory=list)
    """The bounds on time points in the guard of the node."""

    def leaves(self) -> Iterator["_Draft"]:
        """Iterate over the leaves in order."""
        return (node for node in reachable(self, lambda node: node.parts) if node.event is not None)


class _DraftBound(NamedTuple):
    """The condition that one time point is at most so much later than another."""

    plus: tuple[_Draft, bool]
    """A node, and whether its `start` is meant."""
    minus: tuple[_Draft, bool]
    most: int


class UnitPoint(NamedTuple):
    """The `start` or `end` of a node."""

    node: int
    start: bool


class PointBound(NamedTuple):
    """The condition that point `plus` is at most `most` later than point `minus`, for matches of `top`."""

    top: int
    plus: int
    minus: int
    most: int


class UnitLeaf(NamedTuple):
    """An occurrence, or `number` of them at one node, and when an event may serve it."""

    node: int
    source: str
    pattern: Pattern
    guard: Guard | None
    number: int
    own: tuple[str, ...]
    """The variables, besides the key, in which the events of a counted leaf agree."""
    after: int
    """The node whose sequence must be complete up to it before; -1 for none."""
    timed: bool
    """Whether a window depends on the time of the event."""
    distinct: str = ""
    """The variable of the pattern in which the counted events differ, if they must."""


class GatePlace(NamedTuple):
    """The place of a node in its gate.

    `before` is the elder sibling (-1 for the first), `siblings` are all children of the gate.
    """

    gate: int
    op: Op
    before: int
    last: bool
    siblings: tuple[int, ...]
    need: int


@dataclass(frozen=True, eq=False)
class Unit:
    """The nodes of a unit as numbers, parents first; node 0 is its root.

    `settled` nodes need to be complete once; `direct` nodes are leaves with one event, the next part of a
    sequence.
    """

    key: tuple[str, ...]
    leaves: tuple[UnitLeaf, ...]
    names: tuple[str, ...]
    children: tuple[tuple[int, ...], ...]
    places: tuple[GatePlace, ...]
    windows: tuple[int | None, ...]
    limits: tuple[int | None, ...]
    """The shortest window at each node or above it."""
    settled: tuple[bool, ...]
    direct: tuple[bool, ...]
    again: tuple[bool, ...]
    """Whether a node may have to be complete again: below a later child of a `pand`."""
    elders: tuple[int, ...]
    """For each node of a unit with choices, the leaves that sequences order before it, as bits."""
    younger: tuple[int, ...]
    """The leaves that sequences order after it."""
    choices: Mapping[str, Mapping[str, frozenset[int]]]
    """For each gate that chooses one child, the leaves below each."""
    chosen: Mapping[str, str]
    """The choices above the unit."""
    kept: Mapping[int, tuple[str, ...]]
    """The names of the children of nodes that may keep fewer than all."""
    points: tuple[UnitPoint, ...] = ()
    """The time points that guards bound."""
    bounds: tuple[PointBound, ...] = ()

    @property
    def distinct(self) -> bool:
        """Whether some counted events must differ."""
        return any(leaf.distinct for leaf in self.leaves)

    @property
    def timed(self) -> bool:
        """Whether the unit has a window."""
        return any(window is not None for window in self.windows)

    @property
    def window(self) -> int | None:
        """The duration in nanoseconds in which all events of a match lie."""
        return self.windows[0]


class PositionUse(NamedTuple):
    """For each node, whether positions matter besides times.

    `inside`: the first position of a match, in a later child of a sequence. `followed`: the last one,
    to the next child.
    """

    inside: tuple[bool, ...]
    followed: tuple[bool, ...]

    @classmethod
    def of(cls, unit: Unit) -> Self:
        """Return the use of positions in a unit."""
        size = len(unit.places)
        inside, followed = [False] * size, [False] * size
        for node in range(1, size):
            gate, op, before, *_ = unit.places[node]
            timed = op is Op.SEQUENCE and unit.limits[gate] is not None
            inside[node] = inside[gate] or (timed and before >= 0 and not unit.direct[node])
            if timed and before >= 0 and not unit.direct[node]:
                followed[before] = True
        return cls(tuple(inside), tuple(followed))


class _NotApart(Exception):
    """The matches of a tree need joins."""


def units(prop: Property, *, branches: bool = True, points: bool = False) -> tuple[Unit, ...] | None:
    """Return the units of a property with its constants decided, or None if it has joins.

    With `branches` also None if not all events that a branch may need can be remembered; without `points`
    also if a guard has time points.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> text = "event e(n, u) = { n: n, u: u }; top or x y; x and a b; a on e(1, U); b on e(2, U); y on e(3, _);"
    >>> [(unit.key, unit.names) for unit in units(build(rvaft.loads(text)))]
    [(('U',), ('x', 'a', 'b')), ((), ('y',))]
    """
    try:
        root = _drafted(prop, points=points)
        _push_windows(root)
        found = [_unit(node, chosen, branches=branches) for node, chosen in _alternatives(root)]
    except _NotApart:
        return None
    return tuple(found)


def _drafted(prop: Property, *, points: bool) -> _Draft:
    """Return the tree of drafts; raises `_NotApart` for shared nodes and for guards that relate nodes."""
    drafts: dict[Part, _Draft | None] = {}
    taken: set[Part] = set()
    timed = list[tuple[_Draft, Guard]]()

    def inner(part: Part) -> list[_Draft]:
        found = [(one, draft) for one in part.parts if (draft := drafts.get(one)) is not None]
        for one, _ in found:
            if one in taken:
                raise _NotApart
            taken.add(one)
        return [draft for _, draft in found]

    def conditions(part: Part) -> list[Condition]:
        return [one for one in part.parts if isinstance(one, Condition)]

    for part in prop.parts:
        name = "" if part.source is None else part.source.node
        match part:
            case Times(distinct=distinct) if len(distinct) > 1:
                raise _NotApart
            case Event() | Times():
                drafts[part] = _Draft(Op.LEAF, name, event=part)
            case Condition():
                drafts[part] = None
            case All() | Ordered() | EndInOrder():
                below, guards = inner(part), conditions(part)
                single = all(isinstance(draft.event, Event) for draft in below)
                in_order = isinstance(part, Ordered) or (isinstance(part, EndInOrder) and single)
                op = Op.ALL if isinstance(part, All) else Op.SEQUENCE if in_order else Op.ENDS
                if guards and not below:
                    raise _NotApart
                drafts[part] = whole = None if not below else below[0] if len(below) == 1 else _Draft(op, name, below)
                for one in guards:
                    if points and whole is not None and time_points(one.guard):
                        timed.append((whole, one.guard))
                    else:
                        _push_guard(one, part, below)
            case One() | AtLeast():
                below = inner(part)
                if len(below) < len(part.parts) or (isinstance(part, One) and part.source is None):
                    raise _NotApart
                kept = tuple("" if one.source is None else one.source.node for one in part.parts)
                need = part.need if isinstance(part, AtLeast) else 1
                op = Op.ONE if isinstance(part, One) else Op.AT_LEAST
                drafts[part] = _Draft(op, name, below, kept, need)
            case Within(parts=(inside,), duration=duration):
                drafts[part] = draft = drafts[inside]
                taken.add(inside)
                if draft is not None:
                    draft.window = duration if draft.window is None else min(duration, draft.window)
            case WithoutEvent():
                raise _NotApart
            case _:
                raise AssertionError("a window has one part")
    root = drafts[prop.root]
    assert root is not None, "a scenario has an event"
    for place, guard in timed:
        place.bounds += _bounds_of(guard, prop, drafts)
    return root


def _bounds_of(guard: Guard, prop: Property, made: Mapping[Part, _Draft | None]) -> Iterator[_DraftBound]:
    """Iterate over the bounds of a guard over time points; raises `_NotApart` if it has anything else."""
    events = {part.source.node: part for part in made if isinstance(part, Event)}

    def place(point: TimePoint) -> tuple[_Draft, bool]:
        part = events.get(point.node) if point.point == "at" else prop.wholes.get(Source(point.node, point.number))
        draft = None if part is None else made.get(part)
        if draft is None:
            raise _NotApart
        return draft, point.point != "end"

    for part in conjuncts(guard):
        found = [*point_bounds(part)]
        if not found:
            raise _NotApart
        yield from (_DraftBound(place(plus), place(minus), most) for plus, minus, most in found)


def _push_guard(condition: Condition, part: Part, below: Sequence[_Draft]) -> None:
    """Give a condition to the leaves that decide it."""
    guard = condition.guard
    names = set(guard_variables(guard))
    if time_points(guard) or not names:
        raise _NotApart
    owns = {*part.parts, *chain.from_iterable(inner.parts for inner in part.parts)}
    own = [
        leaf
        for leaf in chain.from_iterable(draft.leaves() for draft in below)
        if leaf.event in owns and leaf.event is not None and leaf.event.source.node == condition.source.node
    ]
    if len(own) == 1 and own[0].event is not None and names.issubset(_bound_by(own[0].event)):
        own[0].guards.append(guard)
        return
    leaves = [leaf for draft in below for leaf in draft.leaves()]
    if not all(leaf.event is not None and names.issubset(rigid_variables(leaf.event.pattern)) for leaf in leaves):
        raise _NotApart
    for leaf in leaves:
        leaf.guards.append(guard)


def _bound_by(event: Event | Times) -> set[str]:
    """Return the variables that have values in an event."""
    return {*rigid_variables(event.pattern), *(event.own if isinstance(event, Times) else ())}


def _values_of(event: Event | Times) -> dict[str, str]:
    """Return the names by which a unit reads the values that each counted event has for itself."""
    return {name: shown_name(name) for name in event.own} if isinstance(event, Times) else {}


def _push_windows(root: _Draft) -> None:
    """Move the windows of choices, and the bounds on their own time points, to their children."""
    for node in reachable(root, lambda node: node.parts):
        if node.op is Op.ONE and node.window is not None:
            for child in node.parts:
                child.window = node.window if child.window is None else min(node.window, child.window)
            node.window = None
        if node.op is Op.ONE:
            for one in [one for one in node.bounds if one.plus[0] is node and one.minus[0] is node]:
                node.bounds.remove(one)
                for child in node.parts:
                    child.bounds.append(one._replace(plus=(child, one.plus[1]), minus=(child, one.minus[1])))


def _alternatives(root: _Draft) -> Iterator[tuple[_Draft, dict[str, str]]]:
    agenda: list[tuple[_Draft, dict[str, str]]] = [(root, {})]
    while agenda:
        node, chosen = agenda.pop()
        if node.op is Op.ONE:
            if node.bounds:
                raise _NotApart
            ways = zip(node.parts, node.kept, strict=True)
            agenda += [(child, {**chosen, node.name: kept}) for child, kept in ways][::-1]
        else:
            yield node, chosen


def _unit(root: _Draft, chosen: Mapping[str, str], *, branches: bool) -> Unit:
    nodes = list[_Draft]()
    agenda, depth = [root], {id(root): 0}
    while agenda:
        nodes.append(one := agenda.pop())
        agenda.extend(reversed(one.parts))
        depth.update(dict.fromkeys(map(id, one.parts), depth[id(one)] + 1))
    if max(depth.values()) > DEEPEST:
        raise _NotApart
    number = {id(one): node for node, one in enumerate(nodes)}
    children = tuple(tuple(number[id(child)] for child in one.parts) for one in nodes)
    parent, slots = [-1] * len(nodes), [0] * len(nodes)
    for node, below in enumerate(children):
        for slot, child in enumerate(below):
            parent[child], slots[child] = node, slot
    key, own = _variables(nodes)
    below_of = _leaves_below(nodes, children)
    guards = _guards(nodes, parent, below_of, key)
    points, bounds = _bounds(nodes, number, parent)
    has_point = {point.node for point in points}
    after, direct, repeats = [-1] * len(nodes), [False] * len(nodes), [node in has_point for node in range(len(nodes))]
    timed = [*repeats]
    limits: list[int | None] = [one.window for one in nodes]
    for node, draft in enumerate(nodes):
        gate, slot = parent[node], slots[node]
        if gate < 0:
            continue
        timed[node] = timed[node] or timed[gate]
        after[node], op = after[gate], nodes[gate].op
        single = isinstance(draft.event, Event)
        if slot and (op is Op.SEQUENCE or (op is Op.ENDS and single)):
            after[node], direct[node] = children[gate][slot - 1], single
        repeats[node] = repeats[node] or repeats[gate] or (slot > 0 and op is Op.ENDS)
        above = limits[gate]
        limits[node] = above if draft.window is None else draft.window if above is None else min(above, draft.window)
    leaves = list[UnitLeaf]()
    for node, draft in enumerate(nodes):
        if (event := draft.event) is not None:
            count, distinct = (event.count, event.distinct) if isinstance(event, Times) else (1, ())
            names, guard = _values_of(event), _all(guards[node])
            pattern = substitute(event.pattern, {old: Variable(new) for old, new in names.items()})
            leaves.append(
                UnitLeaf(
                    node,
                    event.source.node,
                    pattern,
                    None if guard is None else renamed(guard, names),
                    count,
                    own[node],
                    after[node],
                    limits[node] is not None or timed[node],
                    names[distinct[0]] if distinct and count > 1 else "",
                )
            )
    if bounds and any(leaf.number > 1 for leaf in leaves):
        raise _NotApart  # the last events need not be the best ones
    _refuse_overlaps(leaves, parent, nodes)
    places = tuple(
        _place(nodes[gate], gate, children[gate], slot) if gate >= 0 else GatePlace(-1, Op.ONE, -1, True, (), 0)
        for gate, slot in zip(parent, slots, strict=True)
    )
    choices = {
        node.name: {kept: below_of[child] for kept, child in zip(node.kept, below, strict=True)}
        for node, below in zip(nodes, children, strict=True)
        if node.op is Op.ONE
    }
    windows = tuple(node.window for node in nodes)
    if branches and choices and any(leaf.distinct for leaf in leaves):
        raise _NotApart  # the events that a branch needs are not the last ones
    if branches and choices and windows[0] is None and any(window is not None for window in windows):
        raise _NotApart  # the events that a branch needs may be older than any window
    return Unit(
        key,
        tuple(leaves),
        tuple(node.name if node.event is None else node.event.source.node for node in nodes),
        children,
        places,
        windows,
        tuple(limits),
        tuple(limit is None and not again and not bounds for limit, again in zip(limits, repeats, strict=True)),
        tuple(direct),
        tuple(repeats),
        *(_orders(nodes, children, below_of) if choices else ((), ())),
        choices,
        chosen,
        {number: node.kept for number, node in enumerate(nodes) if node.kept},
        points,
        bounds,
    )


def _bounds(
    nodes: Sequence[_Draft], number: Mapping[int, int], parent: Sequence[int]
) -> tuple[tuple[UnitPoint, ...], tuple[PointBound, ...]]:
    """Return the time points of a unit and their bounds; raises `_NotApart` if a scenario may lack a point."""
    points, bounds = dict[UnitPoint, int](), list[PointBound]()

    def place(point: tuple[_Draft, bool]) -> int:
        if id(point[0]) not in number:
            raise _NotApart
        return points.setdefault(UnitPoint(number[id(point[0])], point[1]), len(points))

    for node, draft in enumerate(nodes):
        for bound in draft.bounds:
            plus, minus = place(bound.plus), place(bound.minus)
            places = node, *(point.node for point, place in points.items() if place in (plus, minus))
            paths = list[list[int]]()
            for start in places:
                path = [start]
                while parent[path[-1]] >= 0:
                    path.append(parent[path[-1]])
                paths.append(path)
            top = max(set(paths[0]).intersection(*paths[1:]))
            for path in paths:
                above = path[1 : path.index(top) + 1]
                if any(nodes[gate].op in (Op.ONE, Op.AT_LEAST) for gate in above):
                    raise _NotApart
            bounds.append(PointBound(top, plus, minus, bound.most))
    return tuple(points), tuple(bounds)


def _place(draft: _Draft, gate: int, children: tuple[int, ...], slot: int) -> GatePlace:
    need = draft.need if draft.op is Op.AT_LEAST else len(children)
    return GatePlace(gate, draft.op, children[slot - 1] if slot else -1, slot == len(children) - 1, children, need)


def _leaves_below(nodes: Sequence[_Draft], children: Sequence[tuple[int, ...]]) -> list[frozenset[int]]:
    found = [frozenset[int]()] * len(nodes)
    for node in range(len(nodes) - 1, -1, -1):
        found[node] = frozenset[int]().union(*(found[child] for child in children[node])) or frozenset([node])
    return found


def _guards(
    nodes: Sequence[_Draft], parent: Sequence[int], below: Sequence[frozenset[int]], key: Sequence[str]
) -> dict[int, tuple[Guard, ...]]:
    """Return the guards of each leaf: one over the key decides all events that need its node."""
    guards_of: dict[int, dict[Guard, None]] = {node: {} for node, draft in enumerate(nodes) if draft.event is not None}
    effort = 0
    for node, own in guards_of.items():
        for guard in nodes[node].guards:
            top = node
            if {*key}.issuperset(guard_variables(guard)):
                while top and nodes[parent[top]].op in (Op.ALL, Op.SEQUENCE, Op.ENDS):
                    top = parent[top]
            effort += len(below[top])
            if effort > EFFORT:
                raise _NotApart
            for leaf in below[top]:
                guards_of[leaf][guard] = None
            own[guard] = None
    return {node: tuple(own) for node, own in guards_of.items()}


def _orders(
    nodes: Sequence[_Draft], children: Sequence[tuple[int, ...]], below: Sequence[frozenset[int]]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the leaves that sequences order before each node, and after it, as bits."""
    elders, younger = [0] * len(nodes), [0] * len(nodes)
    for node, draft in enumerate(nodes):
        before, after = elders[node], younger[node]
        in_order = draft.op in (Op.SEQUENCE, Op.ENDS)
        for child in children[node]:
            elders[child] = before
            before |= mask_of(below[child]) if in_order else 0
        for child in reversed(children[node]):
            younger[child] = after
            after |= mask_of(below[child]) if in_order else 0
    return tuple(elders), tuple(younger)


def _variables(nodes: Sequence[_Draft]) -> tuple[tuple[str, ...], dict[int, tuple[str, ...]]]:
    """Return the key, and by leaf the other variables in which the events of a counted leaf agree."""
    bound = {
        node: tuple(dict.fromkeys(rigid_variables(draft.event.pattern)))
        for node, draft in enumerate(nodes)
        if draft.event is not None
    }
    counted = {node for node in bound if isinstance(nodes[node].event, Times)}
    common = set.intersection(*(set(names) for names in bound.values()))
    if len(bound) == 1 and not counted:
        common = set()
    seen = set[str]()
    for names in bound.values():
        for name in names:
            if name in seen and name not in common:
                raise _NotApart
            seen.add(name)
    first = next(iter(bound.values()))
    key = tuple(name for name in first if name in common)
    return key, {node: tuple(name for name in bound[node] if name not in common and node in counted) for node in bound}


def _all(guards: Sequence[Guard]) -> Guard | None:
    if not guards:
        return None
    return guards[0] if len(guards) == 1 else Operation(Operator.AND, tuple(guards))


def _refuse_overlaps(leaves: Sequence[UnitLeaf], parent: Sequence[int], nodes: Sequence[_Draft]) -> None:
    """Raise `_NotApart` if an event may serve two occurrences that have no order."""
    serving: dict[Pattern, list[int]] = {}
    for leaf in leaves:
        serving.setdefault(leaf.pattern, []).append(leaf.node)
    groups = list(serving.values())
    alike = (pair for group in groups for pair in combinations(group, 2))
    pairs = Overlaps(list(serving)).pairs()
    effort = 0
    for one, other in chain(alike, (pair for a, b in pairs for pair in product(groups[a], groups[b]))):
        above = {one}
        node = one
        while node >= 0:
            above.add(node)
            node = parent[node]
            effort += 1
        node = other
        while node not in above:
            node = parent[node]
            effort += 1
        if nodes[node].op not in (Op.SEQUENCE, Op.ONE) or effort > EFFORT:
            raise _NotApart
