"""Mistakes of a translation that are the same as having been given another tree: the table
`MISTAKES` of functions from tree to tree.

A function returns a tree that is equal to the one it got where the mistake has nothing to work on.
`MISREADINGS` are those of a monitor that reads other events than there are.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations, pairwise, product
from math import isfinite
from typing import Any, Final, TypeAlias

from cross_check.generate.times import with_time
from rvaft import RVAFT, Causality, EventType, Gate, Node, On, Side, Without
from rvaft.core.restriction import restrict
from rvaft.model.event_time import EventTime, TextFormat, TimeFormat
from rvaft.model.guards import Guard, Operation, Operator, TimePoint, substitute, walk
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Variable
from rvaft.model.tree import Whole
from rvaft.model.values import Json

Mistake: TypeAlias = Callable[[RVAFT], RVAFT]

NAMED: Final = EventType("named", ("what",), ObjectPattern((("event", Variable("what")),)))
"""The default event of a leaf, for a copy of the leaf that has another name."""


def rebuilt(tree: RVAFT, nodes: Iterable[Node] | None = None, **others: Any) -> RVAFT:
    """The tree with other nodes, or another part of what it declares."""
    names = ("ignores", "causality", "time", "semantics", "part_of")
    kept = {name: getattr(tree, name) for name in names}
    nodes = list(tree.nodes.values() if nodes is None else nodes)
    named = [NAMED] if any(node.on is not None and node.on.event == NAMED.name for node in nodes) else []
    return RVAFT(tree.root, nodes, [*tree.events.values(), *named], **{**kept, **others})


def each(change: Callable[[Node], Mapping[str, Any] | None]) -> Mistake:
    """The mistake that every node has these fields instead, where there is something to change."""
    return lambda tree: rebuilt(tree, (replace(node, **(change(node) or {})) for node in tree.nodes.values()))


def fields(which: Callable[[Node], Any], **others: Any) -> Mistake:
    """The mistake that such nodes have these fields instead."""
    return each(lambda node: others if which(node) else None)


def regated(old: Gate, new: Gate, *, threshold: int | None = None) -> Mistake:
    """The mistake that every gate of one type with two children or more is of another type."""
    return fields(lambda node: node.gate is old and len(node.children) > 1, gate=new, threshold=threshold)


def thresholds(change: int) -> Mistake:
    """The mistake that K is another number, where a vote can have it."""

    def changed(node: Node) -> Mapping[str, Any] | None:
        wrong = (node.threshold or 0) + change
        return {"threshold": wrong} if node.threshold and 1 <= wrong <= len(node.children) else None

    return each(changed)


def exactly(tree: RVAFT) -> RVAFT:
    """K children of a vote, and no more: a choice between all ways to have K."""

    def nodes() -> Iterator[Node]:
        for node in tree.nodes.values():
            if node.gate is not Gate.VOT or node.threshold == len(node.children):
                yield node
                continue
            assert node.threshold is not None
            every = enumerate(combinations(node.children, node.threshold))
            ways = [Node(f"{node.name}'{number}", Gate.AND, chosen) for number, chosen in every]
            yield from ways
            yield replace(node, gate=Gate.OR, threshold=None, children=tuple(way.name for way in ways))

    return rebuilt(tree, nodes())


def without_last(*gates: Gate) -> Mistake:
    """The mistake that the last child of such gates is not there."""

    def changed(node: Node) -> Mapping[str, Any] | None:
        spare = node.gate in gates and len(node.children) > max(1, node.threshold or 0)
        return {"children": node.children[:-1]} if spare else None

    return each(changed)


def order_of_events_alone(tree: RVAFT) -> RVAFT:
    """A sequence orders its leaves and not what is below its gates."""

    def nested(node: Node) -> bool:
        return node.gate in (Gate.SAND, Gate.SAND_RL) and any(tree.nodes[child].children for child in node.children)

    return fields(nested, gate=Gate.AND)(tree)


def doubled(tree: RVAFT) -> RVAFT:
    """A shared leaf is another one below every further parent."""
    nodes: list[Node] = []
    seen: set[str] = set()
    for node in tree.nodes.values():
        children = []
        for child in node.children:
            leaf = tree.nodes[child]
            if child in seen and leaf.leaf:
                on = leaf.on or (On(NAMED.name, (Literal(child),)) if leaf.has_event else None)
                nodes.append(replace(leaf, name=f"{child}'{node.name}", on=on))
                child = nodes[-1].name  # noqa: PLW2901
            seen.add(child)
            children.append(child)
        nodes.append(replace(node, children=tuple(children)))
    return rebuilt(tree, nodes)


def merged(tree: RVAFT) -> RVAFT:
    """Two children of one gate that have the same event are one."""

    def changed(node: Node) -> Mapping[str, Any]:
        first: dict[object, str] = {}
        for child in node.children:
            below = tree.nodes[child]
            first.setdefault((below.on, below.when) if below.leaf and below.on else child, child)
        few = node.threshold is not None and node.threshold > len(first)
        return {"children": tuple(first.values()), "threshold": len(first) if few else node.threshold}

    return each(changed)(tree)


def turned(tree: RVAFT) -> RVAFT:
    """The event of a gate comes on the other side of those below it."""
    other = Causality.TOP_DOWN if tree.causality is Causality.BOTTOM_UP else Causality.BOTTOM_UP
    return rebuilt(tree, causality=other) if any(node.children and node.on for node in tree.top_down()) else tree


def operators(by: Mapping[Operator, Operator | None]) -> Mistake:
    """The mistake that guards, also those of an `ignore`, have other operators, or for None the first operand alone."""

    def changed(guard: Guard) -> Guard:
        if not isinstance(guard, Operation):
            return guard
        other = by.get(guard.operator, guard.operator)
        return changed(guard.operands[0]) if other is None else Operation(other, tuple(map(changed, guard.operands)))

    def wrong(tree: RVAFT) -> RVAFT:
        nodes = (replace(node, when=node.when and changed(node.when)) for node in tree.nodes.values())
        return rebuilt(tree, nodes, ignores=[replace(one, when=one.when and changed(one.when)) for one in tree.ignores])

    return wrong


def unguarded(which: Callable[[Node], bool]) -> Mistake:
    """The mistake that such nodes have no guard; a leaf that has nothing else keeps one that holds."""
    true = Operation(Operator.EQ, (Literal(1), Literal(1)))
    alone = fields(lambda node: which(node) and node.when and node.leaf and not node.on, when=true)
    others = fields(lambda node: which(node) and node.when and not (node.leaf and not node.on), when=None)
    return lambda tree: others(alone(tree))


def asking(node: Node, given: Iterable[Any]) -> Mapping[str, Any]:
    """The fields of a node whose event has other arguments; values of its events' own that are no more among them
    are those that now stand in their place.
    """
    if node.on is None:
        return {}
    on = replace(node.on, arguments=tuple(given))
    pairs = zip(node.on.arguments, on.arguments, strict=True)
    names = {was.name: now.name for was, now in pairs if isinstance(was, Variable) and isinstance(now, Variable)}
    names.update({name: name for name in on.variables})
    distinct, own = (tuple(names[name] for name in given) for given in (node.distinct, node.each))
    return {"on": on, "distinct": distinct, "each": own}


def arguments(change: Callable[[tuple[Any, ...]], Iterable[Any]]) -> Mistake:
    """The mistake that the arguments of events are others."""
    return each(lambda node: asking(node, change(node.on.arguments if node.on else ())))


def literals(change: Callable[[Any], Any]) -> Mistake:
    """The mistake that the values events are asked for are others."""
    return arguments(lambda given: (Literal(change(one.value)) if isinstance(one, Literal) else one for one in given))


def unshared(tree: RVAFT) -> RVAFT:
    """A variable that an earlier node has is another one in a later node."""
    nodes, seen = [], set[str]()
    for node in tree.nodes.values():
        given = node.on.arguments if node.on else ()
        names = {one.name for one in given if isinstance(one, Variable)}
        other = (Variable(f"{one.name}0") if isinstance(one, Variable) and one.name in seen else one for one in given)
        nodes.append(replace(node, **asking(node, other)))
        seen |= names
    return rebuilt(tree, nodes)


def unified(tree: RVAFT) -> RVAFT:
    """All variables of the tree that stand at one place of an event are one."""

    def changed(given: tuple[Any, ...]) -> Iterator[Any]:
        for number, one in enumerate(given):
            yield Variable(f"V{number}") if isinstance(one, Variable) else one

    return tree if any(node.when for node in tree.nodes.values()) else arguments(changed)(tree)


def relevance(whole: Callable[[RVAFT], RVAFT]) -> Mistake:
    """The mistake that another tree decides which events are relevant."""

    def wrong(tree: RVAFT) -> RVAFT:
        other = whole(tree if tree.part_of is None else tree.part_of.tree)
        if other.alphabet == tree.alphabet:
            return tree
        return rebuilt(tree, part_of=Whole(other))

    return wrong


def another_branch(tree: RVAFT) -> RVAFT:
    """The first branch, or for that the second."""
    if tree.part_of is None or tree.part_of.branch is None:
        return tree
    return restrict(tree.part_of.tree, branch=2 if tree.part_of.branch == 1 else 1)


def counted_beside(tree: RVAFT) -> RVAFT:
    """What follows a counted leaf in a sequence follows one of its events, and not all."""
    nodes: list[Node] = []
    for node in tree.nodes.values():
        counted = [child for child in node.children if tree.nodes[child].times > 1]
        if node.gate is not Gate.SAND or not counted or node.on is not None:
            nodes.append(replace(node, times=1) if any(node.name in other.children for other in nodes[:0]) else node)
            continue
        more = []
        for child in counted:
            leaf = tree.nodes[child]
            on = leaf.on or On(NAMED.name, (Literal(child),))
            more.append(replace(leaf, name=f"{child}'", on=on, times=leaf.times - 1))
        inner = replace(node, name=f"{node.name}'", within=None)
        nodes += [*more, inner, replace(node, gate=Gate.AND, children=(inner.name, *(one.name for one in more)))]
    once = {f"{name}'" for name in tree.nodes} & {node.name for node in nodes}
    return rebuilt(tree, [replace(n, times=1) if f"{n.name}'" in once and n.leaf else n for n in nodes])


def beginnings_in_order(tree: RVAFT) -> RVAFT:
    """A `pand` that orders the first events of its parts, not the last."""
    nodes = dict(tree.nodes)

    def leaves(name: str) -> list[str]:
        node = tree.nodes[name]
        return [name] if node.leaf else [leaf for child in node.children for leaf in leaves(child)]

    for gate in tree.nodes.values():
        if gate.gate is not Gate.PAND or all(tree.nodes[child].leaf for child in gate.children):
            continue
        ways = []
        for number, firsts in enumerate(product(*map(leaves, gate.children))):
            pairs = [(one, leaf) for child, one in zip(gate.children, firsts, strict=True) for leaf in leaves(child)]
            pairs = [pair for pair in (*pairs, *pairwise(firsts)) if pair[0] != pair[1]]
            orders = [Node(f"{gate.name}'{number}'{place}", Gate.SAND, pair) for place, pair in enumerate(pairs)]
            children = (*gate.children, *(one.name for one in orders))
            ways.append(Node(f"{gate.name}'{number}", Gate.AND, children))
            nodes.update((one.name, one) for one in (*orders, ways[-1]))
        nodes[gate.name] = replace(gate, gate=Gate.OR, children=tuple(way.name for way in ways))
    return rebuilt(tree, nodes.values())


def windows(change: Callable[[int], int | None]) -> Mistake:
    """The mistake that windows are others."""

    def changed(node: Node) -> Mapping[str, Any] | None:
        wrong = None if node.within is None else change(node.within)
        return {"within": wrong} if wrong is None or wrong >= 0 else None

    return each(changed)


def points(change: Callable[[TimePoint, RVAFT], TimePoint]) -> Mistake:
    """The mistake that guards ask for other times."""

    def wrong(tree: RVAFT) -> RVAFT:
        def changed(node: Node) -> Mapping[str, Any] | None:
            asked = [] if node.when is None else [part for part in walk(node.when) if isinstance(part, TimePoint)]
            by = {point.name: change(point, tree) for point in asked}
            return {"when": substitute(node.when, by)} if node.when is not None and asked else None

        return each(changed)(tree)

    return wrong


def another_leaf(point: TimePoint, tree: RVAFT) -> TimePoint:
    """The same of the leaf before, or of the one after the first."""
    every = [name for name in tree.occurrences if tree.nodes[name].times == 1]
    place = every.index(point.node) if point.node in every else 0
    return TimePoint.of(point.point, every[place - 1 if place else 1]) if len(every) > 1 else point


def clocks(**changes: Callable[[EventTime], Any]) -> Mistake:
    """The mistake that the time of events is declared otherwise."""

    def wrong(tree: RVAFT) -> RVAFT:
        if tree.time is None:
            return tree
        return rebuilt(tree, time=replace(tree.time, **{name: change(tree.time) for name, change in changes.items()}))

    return wrong


def lateness(by: int | None) -> Mistake:
    """The mistake that events may be later, or less late; for None that none is late."""

    def changed(time: EventTime) -> int | None:
        return None if time.late is None or by is None else max(time.late + by, 0)

    return clocks(late=changed)


def absences(change: Callable[[Without], Without]) -> Mistake:
    """The mistake that the clauses of absent events are others."""
    return each(lambda node: {"without": tuple(map(change, node.without))} if node.without else {})


def lasting(clause: Without, by: int) -> Without:
    """The clause with another duration, if it has one."""
    return clause if clause.duration is None else replace(clause, duration=max(clause.duration + by, 0))


def finer(time: EventTime) -> TimeFormat | TextFormat:
    """The next smaller unit."""
    units = [TimeFormat.SECONDS, TimeFormat.MILLISECONDS, TimeFormat.MICROSECONDS, TimeFormat.NANOSECONDS]
    return units[min(units.index(time.format) + 1, 3)] if time.format in units else time.format


def rewritten(change: Callable[[Operation], Guard]) -> Mistake:
    """The mistake that the operations of guards are others."""

    def changed(guard: Guard) -> Guard:
        if not isinstance(guard, Operation):
            return guard
        return change(Operation(guard.operator, tuple(map(changed, guard.operands))))

    return each(lambda node: {"when": changed(node.when)} if node.when is not None else None)


def anchored_before_alone(guard: Operation) -> Guard:
    """A glob that may stop before the end of the text."""
    match guard:
        case Operation(Operator.LIKE, (text, Literal(str() as glob))):
            return Operation(Operator.LIKE, (text, Literal(f"{glob}*")))
        case _:
            return guard


MISTAKES: Final[Mapping[str, Mistake]] = {
    # gates
    "a sand reversed": regated(Gate.SAND, Gate.SAND_RL),
    "a sand_rl from left to right": regated(Gate.SAND_RL, Gate.SAND),
    "a sand in any order": regated(Gate.SAND, Gate.AND),
    "an and in order": regated(Gate.AND, Gate.SAND),
    "an and as a choice": regated(Gate.AND, Gate.OR),
    "an or that wants all": regated(Gate.OR, Gate.AND),
    "an or of which more may come": regated(Gate.OR, Gate.VOT, threshold=1),
    "K-1 for K": thresholds(-1),
    "K+1 for K": thresholds(+1),
    "exactly K for at least K": exactly,
    "the last alternative forgotten": without_last(Gate.OR),
    "the last child of a vote forgotten": without_last(Gate.VOT),
    "the last child of an and or a sequence forgotten": without_last(Gate.AND, Gate.SAND, Gate.SAND_RL),
    "an order lost through a nested gate": order_of_events_alone,
    # events
    "a gate's own event forgotten": fields(lambda node: node.children, on=None),
    "a leaf's event taken for that of its name": fields(lambda node: node.leaf and not node.when, on=None),
    "a shared node twice": doubled,
    "one event for two nodes": merged,
    "causality turned": turned,
    # guards
    "no guard": unguarded(lambda _: True),
    "no guard on an event": unguarded(lambda node: node.has_event),
    "no guard on a node without an event": unguarded(lambda node: not node.has_event),
    "no guard on a gate": unguarded(lambda node: bool(node.children)),
    "`>=` for `>`": operators({Operator.GT: Operator.GE}),
    "`>` for `>=`": operators({Operator.GE: Operator.GT}),
    "`<` for `<=`": operators({Operator.LE: Operator.LT}),
    "`==` for `!=`": operators({Operator.NE: Operator.EQ}),
    "`or` for `and`": operators({Operator.AND: Operator.OR}),
    "`and` for `or`": operators({Operator.OR: Operator.AND}),
    "`-` for `+`": operators({Operator.ADD: Operator.SUB}),
    "a `not` dropped": operators({Operator.NOT: None}),
    "the first of two conditions alone": operators({Operator.AND: None}),
    "the first term of a sum alone": operators({Operator.ADD: None}),
    # values
    'the number 1 as the text "1"': literals(
        lambda value: str(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else value
    ),
    'the text "1" as the number 1': literals(lambda value: int(value) if value == "1" else value),
    "true as 1": literals(lambda value: 1 if value is True else value),
    "literals not looked at": arguments(
        lambda given: (Anything() if isinstance(one, Literal) else one for one in given)
    ),
    "arguments in the other order": arguments(lambda given: given[::-1]),
    "a variable not shared": unshared,
    "two variables taken for one": unified,
    # ends and counts
    "a pand as an and": regated(Gate.PAND, Gate.AND),
    "a pand as a sand": regated(Gate.PAND, Gate.SAND),
    "a pand that orders beginnings": beginnings_in_order,
    "N-1 for N": each(lambda node: {"times": node.times - 1} if node.times > 1 else None),
    "N+1 for N": each(lambda node: {"times": node.times + 1} if node.times > 1 else None),
    "what follows a counted leaf follows its first event": counted_beside,
    "different values not asked for": each(
        lambda node: {"distinct": (), "each": node.distinct} if node.distinct else {}
    ),
    "values of their own taken for one": each(lambda node: {"each": ()} if node.each else {}),
    # absent events
    "a `without` ignored": each(lambda node: {"without": ()} if node.without else {}),
    "a `without` without its guard": absences(lambda clause: replace(clause, when=None)),
    "a time of absence a nanosecond too long": absences(lambda clause: lasting(clause, +1)),
    "a time of absence a nanosecond too short": absences(lambda clause: lasting(clause, -1)),
    "an absence before as one between": absences(
        lambda clause: clause if clause.side is Side.AFTER else replace(clause, side=Side.DURING, duration=None)
    ),
    "an absence after as one before": absences(
        lambda clause: replace(clause, side=Side.BEFORE) if clause.side is Side.AFTER else clause
    ),
    # times
    "a window a nanosecond too long": windows(lambda within: within + 1),
    "`<` for `<=` in a window": windows(lambda within: within - 1),
    "a window in thousandths": windows(lambda within: within // 1000),
    "no windows": windows(lambda _: None),
    "the end for the start": points(lambda one, _: TimePoint.of("end", one.node) if one.point == "start" else one),
    "the start for the end": points(lambda one, _: TimePoint.of("start", one.node) if one.point == "end" else one),
    "the time of another node": points(another_leaf),
    "the finer unit of a time": clocks(format=finer),
    "a nanosecond more for late events": lateness(+1),
    "a nanosecond less for late events": lateness(-1),
    "late events used": lateness(None),
    # functions
    "`in` as the first literal alone": rewritten(
        lambda guard: replace(guard, operands=guard.operands[:2]) if guard.operator is Operator.IN else guard
    ),
    "`like` without the end of the text": rewritten(anchored_before_alone),
    "`lower` forgotten": operators({Operator.LOWER: None}),
    "`number` forgotten": operators({Operator.NUMBER: None}),
    "`abs` forgotten": operators({Operator.ABS: None}),
    "`contains` for `startswith`": operators({Operator.STARTSWITH: Operator.CONTAINS}),
    "`contains` for `endswith`": operators({Operator.ENDSWITH: Operator.CONTAINS}),
    "`startswith` for `contains`": operators({Operator.CONTAINS: Operator.STARTSWITH}),
    "`min` for `max`": operators({Operator.MAX: Operator.MIN}),
    # parts and relevance
    "another branch": another_branch,
    "`ignore` forgotten": lambda tree: rebuilt(tree, ignores=()),
    "an `ignore` without its guard": lambda tree: rebuilt(
        tree, ignores=[replace(one, when=None) for one in tree.ignores]
    ),
    "the events of one branch alone relevant": lambda tree: rebuilt(tree, part_of=None),
    "an event relevant whatever its guard says": relevance(unguarded(lambda _: True)),
    "the events of gates not relevant": relevance(fields(lambda node: node.children, on=None)),
}


# -- events that are read otherwise than they are
# -------------------------------------------------------------------------

Misreading: TypeAlias = Callable[[RVAFT, Json], Json]


def values(change: Callable[[Json], Json]) -> Misreading:
    """The mistake that the values in events are others."""

    def changed(value: Json) -> Json:
        if isinstance(value, dict):
            return {name: changed(inner) for name, inner in value.items()}
        return [changed(inner) for inner in value] if isinstance(value, list) else change(value)

    return lambda _, event: changed(event)


def times(change: Callable[[str], str]) -> Misreading:
    """The mistake that times that are texts are others."""

    def changed(tree: RVAFT, event: Json) -> Json:
        if tree.time is None or tree.time.read(event) is None:
            return event
        value = event
        for name in tree.time.field:
            value = value[name]
        return with_time(event, tree.time.field, change(value)) if isinstance(value, str) else event

    return changed


def _undefined(value: Json) -> bool:
    return isinstance(value, float) and not isfinite(value)


MISREADINGS: Final[Mapping[str, Misreading]] = {
    "NaN equals itself": values(lambda value: "NaN" if _undefined(value) else value),
    "NaN is a number": values(lambda value: 0 if _undefined(value) else value),
    "the offset of a zone ignored": times(lambda text: re.sub(r"(?<=:\d\d)(.*?)[-+]\d\d(:?\d\d)?$", r"\1", text)),
    "half a nanosecond rounded up": times(lambda text: re.sub(r"^(\d+[.]\d*|.*[.,]\d{9})5(?=Z?$)", r"\g<1>6", text)),
    "second 60 as the last of its minute": times(lambda text: re.sub(r":60(?=\D|$)", ":59", text)),
    "a fraction of a second forgotten": times(lambda text: re.sub(r"(?<=:\d\d:\d\d)[.,]\d+", "", text)),
}
