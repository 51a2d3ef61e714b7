"""Random traces for a tree: events over its patterns, and detecting traces.

A detecting trace is an order of a random scenario, with matching values and harmless noise.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from random import Random
from typing import Final, TypeAlias, assert_never

from cross_check.generate.times import SECOND, Schedule, in_between, timed, walked
from cross_check.generate.values import (
    LOGGED,
    Demand,
    LogValues,
    Unmet,
    ValueSearch,
    fitting,
    guard_demands,
    interesting_values,
)
from cross_check.letters import answers
from rvaft.backend import Observed
from rvaft.core.precedence import Edge, Point, Precedence, edges_along, node_of, path, point_of, precedence
from rvaft.core.property import (
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    Kept,
    One,
    Part,
    Property,
    Times,
    WithoutEvent,
    fewest,
)
from rvaft.core.restriction import property_of
from rvaft.core.scenarios import Fewest, fewest_events, is_constant
from rvaft.engine import Engine
from rvaft.errors import RvaftError, TooLarge
from rvaft.model.guards import holds, time_points, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Anything, Binding, Literal, Pattern, match, rigid_variables
from rvaft.model.tree import RVAFT, find_cycle, own_name, reachable
from rvaft.model.values import Json, equal
from rvaft.model.verdict import Semantics, Verdict
from rvaft.support.wording import listing


def random_event(random: Random, tree: RVAFT, values: Sequence[Json]) -> Json:
    """Return an event: mostly one that matches a pattern, else two, disturbed, or irrelevant."""
    patterns = [*(entry.pattern for entry in tree.alphabet), *(pattern for _, _, pattern in tree.absences)]
    dice = random.random()
    if dice < 0.05:
        return {"noise": random.choice(values)}
    event = fitting(random, random.choice(patterns), values)
    if dice < 0.25:
        event = {**event, **fitting(random, random.choice(patterns), values)}
    elif dice < 0.35 and event:
        event.pop(random.choice(sorted(event)))
    elif 0.35 <= dice < 0.45 and event:
        event[random.choice(sorted(event))] = random.choice(values)
    return event


def random_trace(random: Random, tree: RVAFT, *, max_length: int = 8, plain: bool = False) -> list[Json]:
    """Return a trace of up to `max_length` events over a few values, so that values repeat.

    With `plain`, all times are readable.
    """
    everything = interesting_values(tree)
    values = [random.choice(everything) for _ in range(3)]
    events = [random_event(random, tree, values) for _ in range(random.randint(0, max_length))]
    return walked(random, tree, events, plain=plain)


def some_event(random: Random, tree: RVAFT, values: Sequence[Json]) -> Json:
    """Return an event that matches a random runtime event of the tree."""
    event = fitting(random, random.choice(tree.alphabet).pattern, values)
    return event if isinstance(event, dict) else {"event": event}


def noise(random: Random, tree: RVAFT, values: Sequence[Json]) -> Json | None:
    """Return an irrelevant event, or None if none was found."""
    for _ in range(10):
        event: Json = {"event": random.choice(LOGGED), "value": random.choice(values)}
        if random.random() < 0.3:
            event = some_event(random, tree, values)
            event.pop(random.choice(sorted(event)), None) if event else None
        if not is_relevant(tree, event):
            return event
    return None


def is_relevant(tree: RVAFT, event: Json) -> bool:
    """Return whether the event matches a runtime event, without its guard, and is not ignored."""
    return any(match(entry.pattern, event, {}) is not None for entry in tree.alphabet) and not is_ignored(tree, event)


def may_break(tree: RVAFT, event: Json) -> bool:
    """Return whether the event matches an absent event, for some values of variables."""
    return any(match(pattern, event, {}) is not None for _, _, pattern in tree.absences)


def is_ignored(tree: RVAFT, event: Json) -> bool:
    """Return whether an `ignore` declaration matches the event."""
    return any(answers((Observed(tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores), event))


# Random scenarios of a tree (semantics, section 2), drawn top-down without enumeration.
# Impossible choices are banned for later draws: a node whose guard cannot hold, or a tree edge on a
# cycle of the precedence. Without bans, every feasible scenario can be drawn.

Ban: TypeAlias = str | Edge

_MORE_THAN_NEEDED: Final = 0.3
"""Probability that a choice of at least K keeps more than K children."""
_TRIED: Final = 20
_SCHEDULES: Final = 6
_ENDS: Final = 8
_REMEMBERED: Final = 10_000


@dataclass
class Cyclic(Exception):
    """An event precedes itself; `edges` are the tree edges of one cycle."""

    edges: list[Edge]


class Scenarios:
    """The scenarios of a tree without banned nodes and edges."""

    def __init__(self, tree: RVAFT) -> None:
        self.prop = property_of(tree)
        self.bans: set[Ban] = set()
        conditions = [part for part in self.prop.parts if isinstance(part, Condition)]
        self._never = {part for part in conditions if is_constant(part) and not holds(part.guard, {})}
        self._fewest = fewest_events(self.prop.parts, without=self._never)
        self._precedences: dict[Hashable, Precedence] = {}

    def draw(self, random: Random, *, lean: bool = False) -> Kept | None:
        """Return the kept parts of a random scenario, or None if all are banned.

        `lean` prefers choices with the fewest events. The precedence may be cyclic; only conditions
        without variables are known to hold.
        """
        least = self._least() if self.bans else self._fewest
        if self.prop.root not in least:
            return None
        kept: dict[Part, tuple[Part, ...]] = {}
        agenda = [self.prop.root]
        while agenda:
            part = agenda.pop()
            if part not in kept:
                kept[part] = self._choice(random, part, least, lean=lean)
                agenda.extend(kept[part])
        return {part: kept[part] for part in reversed(self.prop.parts) if part in kept}

    def ban(self, random: Random, bans: Sequence[Ban]) -> None:
        """Ban one of these such that scenarios remain; otherwise clear all bans."""
        for ban in random.sample(bans, min(len(bans), _TRIED)):
            if ban not in self.bans:
                self.bans.add(ban)
                if self.prop.root in self._least():
                    return
                self.bans.remove(ban)
        self.bans.clear()

    def order(self, random: Random, kept: Kept) -> list[str]:
        """Return the node of each event in a random order; raises `Cyclic` if there is none.

        Every order that respects the precedence can occur.
        """
        ordered = [part for part in kept if isinstance(part, EndInOrder)]
        for _ in range(_ENDS):
            graph = self._precedence(kept)
            if ordered:
                graph = graph.copy()
            for part in ordered:
                _end_in_order(random, kept, part, graph)
            try:
                return [node_of(event) for event in _drawn_order(random, graph)]
            except Cyclic as found:
                cyclic = found
                if not ordered:
                    break
        raise cyclic

    def _precedence(self, kept: Kept) -> Precedence:
        scenario = tuple(kept.items())
        if scenario not in self._precedences:
            if sum(map(len, self._precedences.values())) > _REMEMBERED:
                self._precedences.clear()
            self._precedences[scenario] = precedence(kept)
        return self._precedences[scenario]

    def _choice(self, random: Random, part: Part, least: Mapping[Part, Fewest], *, lean: bool) -> tuple[Part, ...]:
        if not isinstance(part, One | AtLeast):
            return part.parts
        possible = [inner for inner in part.parts if inner in least and (part, inner) not in self.bans]
        need = fewest(part)
        if lean:
            random.shuffle(possible)
            chosen = set(sorted(possible, key=lambda inner: least[inner].events)[:need])
        else:
            more = isinstance(part, AtLeast) and random.random() < _MORE_THAN_NEEDED
            chosen = set(random.sample(possible, random.randint(need, len(possible)) if more else need))
        return tuple(inner for inner in part.parts if inner in chosen)

    def _least(self) -> dict[Part, Fewest]:
        banned = self._never | {part for part in self.prop.parts if node_of(part) in self.bans}
        edges = {ban for ban in self.bans if not isinstance(ban, str)}
        return fewest_events(self.prop.parts, without=banned, without_edges=edges)


def _drawn_order(random: Random, graph: Precedence) -> list[Event | Times]:
    """Return the events of a precedence in a random linear extension, with repetitions.

    Points that are not events are passed at once, so that every order can occur.
    """
    waits = {point: len(earlier) for point, earlier in graph.predecessors.items()}
    ready: list[Point] = []
    silent = [point for point, number in waits.items() if number == 0]
    order: list[Event | Times] = []
    left = {part: part.count for _, part, _ in waits if isinstance(part, Times)}
    while silent or ready:
        if silent:
            point = silent.pop()
        else:
            index = random.randrange(len(ready))
            ready[index], ready[-1] = ready[-1], ready[index]
            point = ready.pop()
            event = point[1]
            assert isinstance(event, Event | Times)
            order.append(event)
            if isinstance(event, Times) and left[event] > 1:
                left[event] -= 1
                ready.append(point)
                continue
        del waits[point]
        for later in graph[point]:
            waits[later] -= 1
            if waits[later] == 0:
                (ready if later[0] == "event" else silent).append(later)
    if waits:
        rest = graph.restricted(waits)
        cycle = find_cycle(rest)
        raise Cyclic(edges_along(rest, [*cycle, cycle[0]]))
    return order


def _end_in_order(random: Random, kept: Kept, ordered: Part, graph: Precedence) -> None:
    before: Part | None = None
    for inner in kept[ordered]:
        events = [part for part in reachable(inner, kept.__getitem__) if isinstance(part, Event | Times)]
        lasts = [one for one in events if not any(path(graph, one, other) for other in events if other is not one)]
        if not events:
            continue
        last = random.choice(lasts or events)
        earlier = [one for one in events if one is not last] + ([] if before is None else [before])
        for one in earlier:
            graph.add(point_of(one), point_of(last), (ordered, inner))
        before = last


# Traces guided by a scenario.

_NOISE: Final = 3
_COUNTED: Final = 1_000
"""Maximum `times` of a leaf: the monitor's memory grows with it."""
_BUILDS: Final = 40
"""Number of attempts to build an event that is not ignored; after a quarter, all values are used.
"""


@dataclass(frozen=True, slots=True)
class Manner:
    """The style of generated events (probabilities), and the effort.

    A `believable` trace has increasing times and typical values per field; otherwise free values
    are those that affect the tree. An `overlapping` event has also the fields of another runtime
    event. `longest` bounds the events of a trace, `attempts` the scenarios drawn.
    """

    believable: bool = False
    overlapping: float = 0.0
    noise: float = 0.4
    longest: int | None = None
    attempts: int = 100


WILD: Final = Manner(overlapping=0.1)
"""For tests: values that may cause failures."""

PLAIN: Final = Manner(believable=True)
"""For readers: values of a typical log."""


class NoTraceFound(RvaftError, LookupError):
    """No detecting trace was found, although one may exist; `nodes` have the failing guards or
    events.
    """

    def __init__(self, why: str, *, attempts: int, nodes: Sequence[str] = ()) -> None:
        self.why = why
        self.attempts = attempts
        self.nodes = tuple(nodes)
        super().__init__(f"no detecting trace found in {attempts} attempt{'s' if attempts > 1 else ''}: {why}")


def detecting(
    random: Random, tree: RVAFT, semantics: Semantics = Semantics.PROJECTED, manner: Manner = WILD
) -> list[Json]:
    """Return a trace with ⊤ at its last event and not before, for a valid tree.

    Raises `NoTraceFound`, and `TooLarge` for leaves counted too often or as the monitor does.
    """
    if max((node.times for node in tree.top_down()), default=1) > _COUNTED:
        raise TooLarge("times of a counted leaf in example traces", limit=_COUNTED)
    for used in (manner, replace(manner, believable=False)) if manner.believable else (manner,):
        trace = guided(random, tree, semantics, used)
        monitor = Engine(tree, semantics)
        for position, event in enumerate(trace, 1):
            if monitor.step(event) is Verdict.TRUE:
                return trace[:position]
    # The trace contains a match by construction; skipping it would hide a fault from the
    # cross-check.
    raise AssertionError(f"the monitor does not detect {tree.root} under {semantics} in {trace}")


def guided(
    random: Random,
    tree: RVAFT,
    semantics: Semantics = Semantics.PROJECTED,
    manner: Manner = WILD,
    scenarios: Scenarios | None = None,
    *,
    broken: bool = False,
) -> list[Json]:
    """Return a trace that contains a match of a random scenario by construction, without a monitor.

    It may be detected before its end. If `broken`, an event that had to be absent comes in it, or comes just
    outside of where it had to be absent. `scenarios` can be shared between calls. Raises `NoTraceFound`.
    """
    scenarios = scenarios or Scenarios(tree)
    making = _Making(random, tree, scenarios.prop, Semantics(semantics), manner)
    scenarios.bans.clear()
    longest, attempts = manner.longest, manner.attempts
    why, nodes, shortest = "", list[str](), None
    for attempt in range(attempts):
        kept = scenarios.draw(random, lean=longest is not None and attempt >= attempts // 2)
        if kept is None:
            why = "every scenario has a guard without variables that does not hold"
            break
        try:
            order = scenarios.order(random, kept)
            if longest is None or len(order) <= longest:
                trace = making.trace(kept, order)
                if making.has_times(kept, order, trace):
                    whole = making.broken(kept, order, trace) if broken else making.noisy(trace)
                    return making.decided(kept, whole)
            shortest = len(order) if shortest is None else min(shortest, len(order))
        except Cyclic as cyclic:
            scenarios.ban(random, cyclic.edges)
            why = why or "every scenario met has an event that comes before itself"
        except Unmet as unmet:
            refusing = {demand.node for demand in unmet.refusing}
            nodes = [name for name in tree.order if name in refusing]
            scenarios.ban(random, nodes)
            why = _objection(nodes, unmet.refusing)
    if shortest is not None:
        why = f"the shortest scenario met has {shortest} events" + (f"; {why}" if why else "")
    raise NoTraceFound(why, attempts=attempts, nodes=nodes)


class _Making:
    def __init__(self, random: Random, tree: RVAFT, prop: Property, semantics: Semantics, manner: Manner) -> None:
        self.random = random
        self.tree = tree
        self.prop = prop
        self.semantics = semantics
        self.manner = manner
        self.others = interesting_values(tree)
        self.values: Sequence[Json] = tuple(random.choice(self.others) for _ in range(4))
        self.look = LogValues(random, tree) if manner.believable else None
        self._bound: Binding = {}
        """The values of variables in the last trace."""
        self._seen: dict[str, list[list[Json]]] = {}
        """The different values that counted events have so far, by node."""

    def trace(self, kept: Kept, order: list[str]) -> list[Json]:
        """Return an event per occurrence, in order; raises `Unmet`."""
        events: dict[str, Json] = {}

        self._seen.clear()

        def passes(name: str, binding: Binding) -> bool:
            if self.tree.nodes[name].own_values:
                return True
            for build in range(_BUILDS):
                event = self._event(patterns[name], binding, self.values if build < _BUILDS // 4 else self.others)
                if not is_ignored(self.tree, event):
                    events[name] = event
                    return True
            return False

        conditions = (part for part in kept if isinstance(part, Condition))
        single = (part for part in conditions if not self.tree.nodes[part.source.node].own_values)
        every = (demand for part in single for demand in guard_demands(part.source.node, part.guard))
        demands = [demand for demand in every if not time_points(demand.guard)]
        patterns = {name: self.tree.pattern(name) or Anything() for name in order}
        if self.semantics.projects and self.tree.ignores:
            demands += [
                Demand(name, rigid_variables(pattern), partial(passes, name)) for name, pattern in patterns.items()
            ]
        binding = self._binding(demands, list(patterns.values()))
        if self.tree.time is not None:
            schedule = Schedule(self.random, self.prop, kept, order, binding, plain=self.look is not None)
            return self._timed(schedule)
        self._bound = binding
        return [events[name] if name in events else self._event_of(name, binding) for name in order]

    def _timed(self, schedule: Schedule) -> list[Json]:
        tree, plain = self.tree, self.look is not None
        for _ in range(_SCHEDULES):
            if (times := schedule.times()) is None:
                continue
            binding = schedule.bound(times)
            events = []
            for name, time, free in zip(schedule.order, times, schedule.free, strict=True):
                event = self._event_of(name, binding)
                events.append(timed(self.random, tree, event, time, plain=plain) if free else event)
            right = tree.time is None or [*map(tree.time.read, events)] == times
            if right and (self.semantics is Semantics.STRICT or not any(is_ignored(tree, event) for event in events)):
                self._bound = binding
                return events
        raise Unmet([Demand(name, (), lambda _: False, Literal(value=False)) for name in schedule.constrained])

    def _binding(self, demands: list[Demand], patterns: list[Pattern]) -> dict[str, Json]:
        names = list(dict.fromkeys(name for pattern in patterns for name in rigid_variables(pattern)))
        if self.look is None:
            return ValueSearch(self.random, lambda _: self.values, self.others).meeting(demands, names)
        for growth in self.look.growing(patterns):  # increasing times with steps, then non-decreasing times, then any
            try:
                search = ValueSearch(self.random, self.look.values, self.others, near=False)
                return search.meeting([*demands, *growth], names)
            except Unmet:
                continue
        return ValueSearch(self.random, self.look.values, self.others).meeting(demands, names)

    def _event_of(self, name: str, binding: Binding) -> Json:
        """Return an event of a node; a counted one may have values of its own. Raises `Unmet`."""
        node, pattern, guard = self.tree.nodes[name], self.tree.pattern(name) or Anything(), self.tree.guard(name)
        if not node.own_values:
            return self._event(pattern, binding, self.values)
        seen = self._seen.setdefault(name, [])
        for _ in range(_BUILDS):
            some = [*self.values, *self.others, *(self.random.randint(-9, 9_999) for _ in range(len(self.others) + 4))]
            own = {own_name(one): self.random.choice(some) for one in node.own_values}
            values = [own[own_name(one)] for one in node.distinct]
            known = {**binding, **own}
            fits = guard is None or not known.keys() >= {*variables(guard)} or holds(guard, known)
            if fits and not any(all(map(equal, values, others)) for others in seen if values):
                seen.append(values)
                return self._event(pattern, known, self.values)
        raise Unmet([Demand(name, (), lambda _: False, guard)])

    def _event(self, pattern: Pattern, binding: Binding, values: Sequence[Json]) -> Json:
        if self.look is not None:
            return self.look.event(pattern, binding)
        event = fitting(self.random, pattern, values, binding)
        if self.random.random() < self.manner.overlapping:
            event = {**some_event(self.random, self.tree, values), **event}
        return event

    def has_times(self, kept: Kept, order: list[str], trace: list[Json]) -> bool:
        """Return whether the events that absent events are timed by have times."""
        time = self.tree.time
        timed_ = (part for part in kept if isinstance(part, WithoutEvent) and part.duration is not None)
        roots: list[Part] = [*timed_]
        nodes = {node_of(inner) for part in roots for inner in reachable(part, kept.__getitem__)}
        pairs = zip(order, trace, strict=True)
        return time is None or all(time.read(event) is not None for name, event in pairs if name in nodes)

    def decided(self, kept: Kept, trace: list[Json]) -> list[Json]:
        """Return the trace with a time after which no absent event can come any more."""
        after = [part.duration or 0 for part in kept if isinstance(part, WithoutEvent) and part.side is Side.AFTER]
        time = self.tree.time
        if not after or time is None:
            return trace
        known = [now for event in trace if (now := time.read(event)) is not None]
        last = max(known) + max(after) + (time.late or 0) + SECOND
        return [*trace, timed(self.random, self.tree, {}, last, plain=True)]

    def broken(self, kept: Kept, order: list[str], trace: list[Json]) -> list[Json]:
        """Return the trace of an order with an event of a random `without` where it breaks it, or just outside."""
        clauses = [part for part in kept if isinstance(part, WithoutEvent)]
        if not clauses:
            return trace
        clause = self.random.choice(clauses)
        root: Part = clause
        nodes = {node_of(one) for one in reachable(root, kept.__getitem__) if isinstance(one, Event | Times)}
        own = [place for place, name in enumerate(order) if name in nodes]
        event = self._absent(clause)
        read = (lambda _: None) if self.tree.time is None else self.tree.time.read
        near = self.random.choice((0, 0, -1, 1))
        match clause.side:
            case Side.DURING:
                place, instant = self.random.randint(own[0], own[-1] + 1), None
            case Side.BEFORE:
                place, start = self.random.randint(0, own[0]), read(trace[own[0]])
                instant = None if start is None or clause.duration is None else start - clause.duration + near
            case Side.AFTER:
                place, end = self.random.randint(own[-1] + 1, len(trace)), read(trace[own[-1]])
                instant = None if end is None or clause.duration is None else end + clause.duration + near
            case _ as never:
                assert_never(never)
        plain = self.look is not None
        if instant is None:
            event = in_between(self.random, self.tree, trace, place, event, plain=plain)
        else:
            event = timed(self.random, self.tree, event, instant, plain=plain)
        return [*trace[:place], event, *trace[place:]]

    def _absent(self, clause: WithoutEvent) -> Json:
        """Return an event of an absence, under the values of the match, that its guard accepts if one was found."""
        shared = {name: self._bound[name] for name in clause.shared if name in self._bound}
        event: Json = {}
        for _ in range(_BUILDS):
            event = self._event(clause.pattern, shared, self.others)
            found = match(clause.pattern, event, dict(shared))
            if found is not None and (clause.guard is None or holds(clause.guard, {**self._bound, **found})):
                break
        return event

    def noisy(self, trace: list[Json]) -> list[Json]:
        """Return the trace with harmless noise events; `strict` allows none."""
        result = list(trace)
        if self.semantics is not Semantics.STRICT and self.random.random() < self.manner.noise:
            longest = self.manner.longest
            room = _NOISE if longest is None else min(_NOISE, longest - len(trace))
            for _ in range(self.random.randint(0, max(room, 0))):
                event = self._noise()
                if event is not None and not may_break(self.tree, event):
                    at = self.random.randint(0, len(result))
                    there = in_between(self.random, self.tree, result, at, event, plain=self.look is not None)
                    harmless = self.semantics is Semantics.SCATTERED or not is_relevant(self.tree, there)
                    result.insert(at, there if harmless else event)
        return result if self.look is None else self.look.timed(result)

    def _noise(self) -> Json | None:
        if self.look is not None:
            event = self.look.noise()
            return None if is_relevant(self.tree, event) else event
        if self.semantics is Semantics.SCATTERED and self.random.random() < 0.5:
            return some_event(self.random, self.tree, self.values)
        return noise(self.random, self.tree, self.values)


def _objection(nodes: Sequence[str], refusing: Sequence[Demand]) -> str:
    failed = {(demand.node, demand.guard is not None) for demand in refusing}
    guarded, dropped = ([name for name in nodes if (name, guards) in failed] for guards in (True, False))
    reasons = []
    if guarded:
        whose = f"the guards of {listing(guarded)} do" if len(guarded) > 1 else f"the guard of {guarded[0]} does"
        reasons.append(f"{whose} not hold with any value that was tried")
    if dropped:
        reasons.append(f"`ignore` takes the events of {listing(dropped)} with any value that was tried")
    return "; ".join(reasons)
