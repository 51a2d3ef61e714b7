"""A tree with times, windows, counted leaves and `pand`, said without them: for engines and languages that know none of these.

The time of a node's event becomes one more variable of the event, bound by the field `TIME` and null where it is undefined; a time point
is that variable, or the least or the greatest of several; `within` is a guard. A leaf with `times N` is N leaves in sequence.
Under `pand` the events with which the parts end are in sequence.

What is in the part of a node depends on the choices below it. Where that matters the tree becomes several, one for each way to make
its choices and to end the parts of its `pand` gates: a trace has the verdict true where it has it for one of them, and false where it has
it for all. The alphabet always is that of the tree as it was.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from math import prod
from typing import Final

from rvaft.analysis.normal_form import Op, body
from rvaft.analysis.scenarios import ScenarioSpace, most_events, path, precedence, resolutions
from rvaft.core.branches import number_of
from rvaft.errors import TooLarge, TreeError
from rvaft.model.event_time import TIME
from rvaft.model.guards import Duration, Guard, Operation, Operator, TimePoint, substitute, time_points, variables
from rvaft.model.nodes import Causality, EventType, Gate, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT, Whole, reachable

LIMIT: Final = 5_000
"""The most trees that one tree may become."""
MOST: Final = 10_000
"""The most events that a leaf may count: each is a leaf of the plain tree."""


def is_plain(tree: RVAFT) -> bool:
    """Whether a tree has nothing that is said in other words here.

    >>> import rvaft
    >>> is_plain(rvaft.loads("top sand a b; a times 3;"))
    False
    """
    return not any(node.times > 1 or node.gate is Gate.PAND or asks_for_time(node) for node in tree.top_down())


def asks_for_time(node: Node) -> bool:
    """Whether a node has a window, or a guard with time points."""
    return node.within is not None or bool(time_points(node.when))


def plain_trees(tree: RVAFT, *, limit: int = LIMIT) -> tuple[RVAFT, ...]:
    """The trees that together say what a tree says, itself where it is plain; raises `TooLarge` beyond `limit`.

    >>> import rvaft
    >>> found, = plain_trees(rvaft.loads("top sand a b; a times 2;"))
    >>> found.nodes["a"].children
    ('a[1]', 'a[2]')
    """
    part_of = tree.part_of or Whole(tree)
    if is_plain(tree) and (part_of.kind is None or is_plain(part_of.tree)):
        return (tree,)
    if part_of.kind is None:  # which of its branches a match of a kind belongs to is asked of the whole
        try:
            return (_Translation(tree, part_of).tree,)
        except _Open:
            pass
    return tuple(_resolved(tree, part_of.tree, limit))


def one_plain_tree(tree: RVAFT, *, limit: int = LIMIT) -> RVAFT:
    """One tree that says what the plain trees of a tree say: the choice of one of them, what is alike in several being shared.

    It has `time` only where it asks for times. Raises `TooLarge` beyond `limit`, and `TreeError` where no scenario is feasible.

    >>> import rvaft
    >>> one_plain_tree(rvaft.loads("top pand x c; x and a b;")).nodes["top"].gate
    <Gate.OR: 'or'>
    """
    trees, timed = plain_trees(tree, limit=limit), any(map(asks_for_time, tree.top_down()))
    if not trees:
        raise TreeError(f"no scenario of {tree.root} is feasible", rule="no-scenario", nodes=[tree.root])
    time = tree.time if timed else None
    if len(trees) == 1:
        return trees[0] if trees[0].time == time else trees[0].changed(time=None)
    known: dict[tuple[object, ...], str] = {}
    roots, nodes, events = list[str](), dict[str, Node](), dict(tree.events)
    origins = dict(tree.origins)
    for plain in trees:
        names: dict[str, str] = {}
        for node in plain.bottom_up():
            pattern, children = plain.pattern(node.name), tuple(names[child] for child in node.children)
            alike = node.name, node.gate, children, node.threshold, node.when, pattern
            if alike not in known:
                number, name, on = 1, node.name, node.on
                while name in nodes or name == tree.root:
                    number += 1
                    name = f"{node.name}/{number}"
                known[alike] = name
                if on is not None and on.event not in tree.events and pattern is not None:
                    on = On(f"{name}()", ())
                    events[on.event] = EventType(on.event, (), pattern)
                nodes[name] = replace(node, name=name, children=children, on=on)
                origins[name] = plain.origins.get(node.name, node.name)
            names[node.name] = known[alike]
        roots.append(names[plain.root])
    root = Node(tree.root, Gate.OR, tuple(dict.fromkeys(roots)))
    part_of = replace(tree.part_of or Whole(tree), origins=origins)
    return tree.changed(nodes=[root, *nodes.values()], events=events.values(), part_of=part_of, time=time)


def without_conditions(tree: RVAFT) -> RVAFT:
    """The tree without times, numbers and order: events that can concern it as it was can concern this one."""
    nodes = [
        replace(
            node,
            gate=Gate.AND if node.gate is Gate.PAND else node.gate,
            times=1,
            within=None,
            when=Literal(value=True)
            if time_points(node.when)
            else node.when,  # a leaf with only a guard observes nothing
            on=node.on or (On(f"{node.name}()", ()) if node.has_event else None),
        )
        for node in tree.nodes.values()
    ]
    own = [EventType(f"{n.name}()", (), p) for n in nodes if (p := tree.pattern(n.name)) is not None]
    return tree.changed(nodes=nodes, events=[*tree.events.values(), *own], part_of=tree.part_of or Whole(tree))


class _Open(Exception):
    """What is in a part, or how it ends, is a matter of choices that are not made."""


def _resolved(tree: RVAFT, whole: RVAFT, limit: int) -> Iterator[RVAFT]:
    """The trees for each way to make the choices."""
    count = 0
    for kept in resolutions(tree, limit=limit):
        nodes = [_without_choice(tree.nodes[name], children) for name, children in kept.items()]
        origin = tree.origins
        choosing = {name: children[0] for name, children in kept.items() if body(tree.nodes[name]).op is Op.ONE}
        choices = {origin.get(name, name): origin.get(child, child) for name, child in choosing.items()}
        asked = None if tree.part_of is None else tree.part_of.branch  # a scenario may be without its choices
        number = asked or number_of(whole, {name: child for name, child in choices.items() if name in whole.nodes})
        part_of = Whole(whole, number or 0, None, origin)  # 0 where finding the number would take too long
        part = tree.changed(nodes=nodes, part_of=part_of)
        ended, known = [node for node in part.top_down() if node.gate is Gate.PAND], _Parts(part)
        # parts that have the same last nodes end with the same one of them
        ends = {known.last(child): None for gate in ended for child in gate.children if child not in known.silent}
        count += prod(map(len, ends))
        if count > limit:
            raise TooLarge("ways to make the choices and to end the parts of `pand` gates", limit=limit)
        for chosen in product(*ends):
            try:
                found = _Translation(part, part_of, dict(zip(ends, chosen, strict=True))).tree
            except _Open:
                continue
            if not ScenarioSpace(found).is_empty:
                yield found


def _without_choice(node: Node, children: tuple[str, ...]) -> Node:
    return replace(node, gate=Gate.AND, threshold=None, children=children) if body(node).chooses else node


# What is in a part, and how it ends.


class _Parts:
    """What the parts of the nodes of a tree have in every scenario, and how they end."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        most = most_events(tree)
        self.silent = {name for name, events in most.items() if events == 0}
        """The nodes of which no part has an event."""
        self.single = {name for name, events in most.items() if events < 2}
        """The nodes of which no scenario has more than one event in the part."""
        self._open: set[str] = set()
        """The nodes below which choices are not made."""
        self._lasts: dict[str, tuple[str, ...]] = {}
        for node in tree.bottom_up():
            below = body(node)
            if not self._open.isdisjoint(node.children) or (below.chooses and len(node.children) > below.need):
                self._open.add(node.name)
            busy = [child for child in below.children if child not in self.silent]
            if node.has_event and (tree.causality is Causality.BOTTOM_UP or not busy):
                lasts: tuple[str, ...] = (node.name,)
            elif busy and (below.op is Op.SEQUENCE or node.gate is Gate.PAND):
                lasts = self._lasts[busy[-1]]
            else:
                lasts = tuple(dict.fromkeys(last for child in busy for last in self._lasts[child]))
            self._lasts[node.name] = lasts

    def below(self, name: str) -> dict[str, tuple[str, ...]]:
        """The nodes of a part with their children; raises `_Open` where choices say which these are."""
        nodes = self.tree.nodes
        if name not in nodes or name in self._open:  # what is not there is in no feasible scenario with who asks
            raise _Open
        return {one: nodes[one].children for one in reachable(name, lambda one: nodes[one].children)}

    def last(self, name: str) -> tuple[str, ...]:
        """The nodes with whose event a part may end, as far as the part itself says; raises `_Open` where choices say more."""
        lasts, below = self._lasts[name], self.below(name)
        if len(lasts) < 2 or not self.tree.shared:
            return lasts
        graph = precedence(self.tree, below)  # a shared node may come before others in a sequence
        return tuple(one for one in lasts if not any(path(graph, one, other) for other in lasts if other != one))


class _Translation:
    """A tree said in fewer words; raises `_Open` where that needs the choices to be made, or `ends`: of last nodes the one at the end."""

    def __init__(self, tree: RVAFT, part_of: Whole, ends: Mapping[tuple[str, ...], str] | None = None) -> None:
        self._old = tree
        self._parts = _Parts(tree)
        self._ends = ends
        self._nodes = dict(tree.nodes)
        self._events: dict[str, EventType] = {}
        self._times: dict[str, str] = {}
        self._variables = {*tree.variables, *(v for n in tree.nodes.values() for v in variables(n.when))}
        self._moved: dict[str, tuple[str, ...]] = {}
        for node in tree.top_down():
            if node.times > 1:
                self._count(node)
        for node in tree.bottom_up():  # what is below a node is said in other words before it is moved
            if node.gate is Gate.PAND:
                self._end_in_sequence(node)
        for node in tree.top_down():
            if points := {one.name: self._point(one) for one in time_points(node.when)}:
                assert node.when is not None
                self._change(node.name, when=substitute(_differences(node.when), points))
            if node.within is not None:
                self._open_window(node)
        for name, variable in self._times.items():
            pattern = self._pattern(name)
            fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
            self._observe(name, ObjectPattern((*fields, (TIME, Variable(variable)))))
        origins = dict(part_of.origins)
        for name in [name for name in self._nodes if name not in tree.nodes]:
            before, bracket, number = name.rpartition("[")
            if before in origins:
                origins[name] = f"{origins[before]}{bracket}{number}"
        part_of = replace(part_of, origins=origins)
        events = {**tree.events, **self._events}.values()
        self.tree = tree.changed(nodes=self._nodes.values(), events=events, part_of=part_of)

    def _change(self, name: str, **parts: object) -> None:
        self._nodes[name] = replace(self._nodes[name], **parts)  # type: ignore[arg-type]

    def _add(self, node: Node) -> str:
        """Add a node, under its name or, where that is taken, a longer one."""
        name = node.name
        while name in self._nodes:
            name += "'"
        self._nodes[name] = replace(node, name=name)
        return name

    def _pattern(self, name: str) -> Pattern:
        on = self._nodes[name].on
        known = None if on is None else self._events.get(on.event)
        pattern = known.pattern if known else self._old.instantiate(on) if on else self._old.pattern(name)
        assert pattern is not None, "only nodes with events are observed"
        return pattern

    def _observe(self, name: str, pattern: Pattern) -> None:
        """Let a node observe events of this pattern, whose variables are those of the tree."""
        self._events[f"{name}()"] = EventType(f"{name}()", (), pattern)
        self._change(name, on=On(f"{name}()", ()))

    def _count(self, node: Node) -> None:
        """A leaf with `times N` as N leaves in sequence, all with its guard unless that asks for times."""
        own = None if time_points(node.when) else node.when
        if node.times > MOST:
            raise TooLarge(f"events that {node.name} counts, {node.times:,}", limit=MOST, remedy="ask for fewer")
        copies = []
        for number in range(1, node.times + 1):
            copies.append(self._add(Node(f"{node.name}[{number}]", on=node.on, when=own)))
            if node.on is None:
                self._observe(copies[-1], self._pattern(node.name))
        when = node.when if own is None else None
        self._moved[node.name] = tuple(copies)
        self._change(node.name, gate=Gate.SAND, children=tuple(copies), on=None, when=when, times=1)

    def _point(self, point: TimePoint) -> Guard:
        below = self._parts.below(point.node)
        names = [point.node] if point.point == "at" else [*below]
        observing = [name for name in names if self._old.nodes[name].has_event]
        times = tuple(Variable(self._time(one)) for name in observing for one in self._moved.get(name, (name,)))
        operator = Operator.MIN if point.point == "start" else Operator.MAX
        if not times:  # no event has that time: undefined
            return Operation(Operator.DIV, (Literal(0), Literal(0)))
        return times[0] if len(times) == 1 else Operation(operator, times)

    def _time(self, name: str) -> str:
        """The variable that the time of a node's event binds."""
        if name not in self._times:
            word = "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in f"At_{name}")
            while word in self._variables:
                word += "_"
            self._variables.add(word)
            self._times[name] = word
        return self._times[name]

    def _open_window(self, node: Node) -> None:
        start, end = (self._point(TimePoint.of(point, node.name)) for point in ("start", "end"))
        guard = Operation(Operator.LE, (Operation(Operator.SUB, (end, start)), Literal(node.within)))
        changed = self._nodes[node.name]
        if changed.when is None:
            self._change(node.name, within=None, when=guard)
        elif body(changed).chooses:
            raise _Open
        else:  # decided maybe later than the node's own guard
            window = self._add(Node(f"{node.name}[within]", when=guard))
            self._change(node.name, within=None, children=(*changed.children, window))

    def _end_in_sequence(self, node: Node) -> None:
        """A `pand` as all of its parts, and the events with which they end in sequence."""
        parts = [child for child in node.children if child not in self._parts.silent]
        if self._parts.single.issuperset(parts):
            self._change(node.name, gate=Gate.SAND)
            return
        ended, more = [], list[str]()
        for child in parts:
            lasts = (child,) if child in self._parts.single else self._parts.last(child)
            if not lasts:  # each event of the part comes before another: no scenario has it
                ended, more = [child] * 2, []
                break
            if len(lasts) > 1 and self._ends is None:
                raise _Open
            last = lasts[0] if self._ends is None or len(lasts) == 1 else self._ends[lasts]
            ended.append(self._event_of(last))
            for other in lasts:
                if other != last:
                    pair = self._event_of(other), ended[-1]
                    more.append(self._add(Node(f"{node.name}[{other} before {last}]", Gate.SAND, pair)))
        twice = len(set(ended)) < len(ended)
        if len(ended) > 1 and not twice:
            more.append(self._add(Node(f"{node.name}[ends]", Gate.SAND, tuple(ended))))
        never = [self._add(Node(f"{node.name}[never]", when=Literal(value=False)))] if twice else []
        self._change(node.name, gate=Gate.AND, children=(*node.children, *more, *never))

    def _event_of(self, name: str) -> str:
        """The leaf that observes the event of a node, or the last of them."""
        node = self._old.nodes[name]
        if name in self._moved:
            return self._moved[name][-1]
        below = not self._parts.silent.issuperset(node.children)
        if not node.has_event or self._old.causality is Causality.TOP_DOWN or not below:
            return name
        changed = self._nodes[name]  # the event after all that is below becomes a leaf
        if body(changed).chooses:  # branches are told by the choices of gates that the tree has
            raise _Open
        inner = self._add(Node(f"{name}[below]", changed.gate, changed.children, changed.threshold))
        own = self._add(Node(f"{name}[event]", on=changed.on))
        self._moved[name] = (own,)
        self._change(name, gate=Gate.SAND, children=(inner, own), threshold=None, on=None)
        return own


def _differences(guard: Guard) -> Guard:
    """The guard with durations as numbers, and times that are compared for equality subtracted: null, an undefined time, equals null."""
    if not isinstance(guard, Operation):
        return Literal(guard.value) if isinstance(guard, Duration) else guard
    if guard.operator in (Operator.EQ, Operator.NE) and time_points(guard):
        difference = Operation(Operator.SUB, tuple(map(_differences, guard.operands)))
        return Operation(guard.operator, (difference, Literal(0)))
    return Operation(guard.operator, tuple(map(_differences, guard.operands)))
