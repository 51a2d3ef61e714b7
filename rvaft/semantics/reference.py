"""Detection and verdicts (definition, sections 3 and 4)."""

import json
from collections.abc import Hashable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple, Self

from rvaft.errors import TreeError
from rvaft.model.nodes import Kind, Node, Relevant, Side, Without
from rvaft.model.patterns import Variable
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics.events import (
    Binding,
    arguments,
    bound_by,
    defined,
    holds,
    matches,
    names,
    observe,
    same,
    time_of,
)
from rvaft.semantics.scenarios import ReferenceScenario, Resolution, branches, feasible_scenarios, of_branch


class Partial(NamedTuple):
    """A downward-closed set of a scenario's occurrences, in one of its orders, with their bindings.

    `times` are the times of their events, None if undefined, and `places` the indices of their events
    in the `Past` (if the scenario has absent events).
    """

    scenario: int
    order: int
    assigned: frozenset[str]
    binding: Binding
    times: Mapping[str, int | None]
    places: Mapping[str, int] = {}

    @property
    def key(self) -> Hashable:
        """A hashable key, equal for equal partial matches."""
        values = frozenset((name, value_key(value)) for name, value in self.binding.items())
        times, places = frozenset(self.times.items()), frozenset(self.places.items())
        return self.scenario, self.order, self.assigned, values, times, places


class TraceStep(NamedTuple):
    """One event of the trace, or None where only time has passed; its time, and whether it is late."""

    event: Any
    time: int | None
    late: bool


class Reference(Monitor):
    """The verdict after each prefix, by following every partial match of every feasible scenario.

    A restricted tree is evaluated as the whole tree with its branch or kind. Raises `TreeError` if
    the branch or kind does not exist, no scenario is feasible, or a guard is unbound.
    """

    def __init__(
        self,
        tree: RVAFT,
        semantics: Semantics | str | None = None,
        *,
        branch: int | None = None,
        kind: Kind | str | None = None,
    ) -> None:
        super().__init__()
        part_of = tree.part_of
        if part_of is not None and branch is None and kind is None:
            tree, branch, kind = part_of.tree, part_of.branch, part_of.kind
        self.tree = tree
        self.semantics = Semantics(semantics or tree.semantics or Semantics.PROJECTED)
        self.scenarios = chosen_scenarios(tree, branch, None if kind is None else Kind(kind))
        numbers = [(number, order) for number, s in enumerate(self.scenarios) for order in range(len(s.orders))]
        self._starts = [Partial(scenario, order, frozenset(), {}, {}) for scenario, order in numbers]
        self._partials = {partial.key: partial for partial in self._starts}
        self._latest: int | None = None
        self._past: tuple[TraceStep, ...] = ()
        """All events of the trace, if the tree has absent events."""
        self._absences = any(node.without for scenario in self.scenarios for node in scenario.nodes)

    @property
    def state(self) -> Hashable:
        """The verdict, the partial matches and the maximum time so far."""
        return self.verdict, frozenset(self._partials), self._latest, json.dumps(self._past)

    def go_on_after(self, earlier: Self) -> None:
        """Clause: lateness and `before` look at the whole trace."""
        super().go_on_after(earlier)
        self._latest, self._past = earlier._latest, earlier._past

    def pass_time(self, time: Any) -> Verdict:
        """Clause: a live monitor may be told that the time t has come; that is an event of time t without
        content, at no position.
        """
        if self.verdict is Verdict.UNKNOWN and self.tree.time is not None:
            now = self.tree.time.now(time)
            self._is_late(now)
            self._verdict = self._after_event(dict(self._partials), TraceStep(None, now, late=False))
        return self.verdict

    def finish(self) -> Verdict:
        """Clause: after the end of the trace every `after` is decided."""
        if self.verdict is Verdict.UNKNOWN and any(self._is_whole(partial) for partial in self._partials.values()):
            self._verdict = Verdict.TRUE
        return self.verdict

    def _advance(self, event: Any) -> Verdict:
        """Clauses: *true*: some prefix contains a match. *false*: not true, and no partial match is
        left.
        """
        time = time_of(self.tree.time, event)
        late = self._is_late(time)
        found = {partial.key: partial for partial in self._after(event, time, late=late)}
        return self._after_event(found, TraceStep(event, time, late))

    def _after_event(self, found: dict[Hashable, Partial], last: TraceStep) -> Verdict:
        if self._absences:
            self._past = (*self._past, last)
            whole = [(key, one, self.scenarios[one.scenario]) for key, one in found.items()]
            found = {key: one for key, one, scenario in whole if unbroken(scenario, one, self._past)}
        if any(self._complete(partial) for partial in found.values()):
            self._partials = {}
            return Verdict.TRUE
        self._partials = found
        lasting = self.semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
        return Verdict.UNKNOWN if found or lasting else Verdict.FALSE

    def _is_late(self, time: int | None) -> bool:
        """Clause: an event whose time is more than D before the greatest time of the events before
        it is late.
        """
        allowed, greatest = self.tree.time.late if self.tree.time else None, self._latest
        if allowed is None or time is None:
            return False
        self._latest = time if greatest is None else max(time, greatest)
        return greatest is not None and greatest - time > allowed

    def _after(self, event: Any, time: int | None, *, late: bool) -> Iterator[Partial]:
        """Clauses: which positions a match may use, and that no match uses a late event.

        No position is used twice: an event extends a partial match by one occurrence at most.
        """
        match self.semantics:
            case Semantics.STRICT | Semantics.SCATTERED:
                takes, passes = not late, self.semantics is Semantics.SCATTERED
            case Semantics.PROJECTED | Semantics.CONSECUTIVE:
                takes = not late and relevant(self.tree, event)
                passes = not takes
        for partial in self._partials.values():
            # Clause: a complete match that waits for a decision counts as a partial match.
            if passes or self._is_whole(partial):
                yield partial
            if takes:
                yield from self._extended(partial, event, time)
        if self.semantics is Semantics.CONSECUTIVE:
            yield from self._starts

    def _extended(self, partial: Partial, event: Any, time: int | None) -> Iterator[Partial]:
        """Clause: precedence is kept, every event matches its occurrence under one assignment of
        the variables.
        """
        scenario = self.scenarios[partial.scenario]
        before = scenario.orders[partial.order]
        for occurrence in sorted(scenario.occurrences - partial.assigned):
            if before[occurrence] <= partial.assigned:
                for binding in observed(scenario, occurrence, event, partial.binding):
                    times = {**partial.times, occurrence: time} if scenario.points else {}
                    places = {**partial.places, occurrence: len(self._past)} if self._absences else {}
                    assigned = partial.assigned | {occurrence}
                    found = partial._replace(assigned=assigned, binding=binding, times=times, places=places)
                    if guards_hold(scenario, found):
                        yield found

    def _complete(self, partial: Partial) -> bool:
        """Clause: a match maps all its occurrences. Every guard holds, since all its variables are
        known.
        """
        scenario = self.scenarios[partial.scenario]
        return self._is_whole(partial) and decided(scenario, partial, self._past)

    def _is_whole(self, partial: Partial) -> bool:
        return partial.assigned == self.scenarios[partial.scenario].occurrences


def observed(scenario: ReferenceScenario, occurrence: str, event: Any, binding: Binding) -> list[Binding]:
    """Return the binding extended in each way in which the event is that of an occurrence.

    Clause: each of the counted events has its own value of a variable of `distinct` or `each`.
    """
    node = scenario.observing[occurrence]
    found = observe(scenario.tree, node, event, binding)
    return [{f"{n}#{occurrence}" if n in node.own_values else n: v for n, v in one.items()} for one in found]


def guards_hold(scenario: ReferenceScenario, partial: Partial) -> bool:
    """Clause: guards all of whose variables and time points are known hold.

    Clause: a point is known when all events of its part are there, and undefined where one of their times is.
    """
    known = dict(partial.binding)
    for point, events in scenario.points.items():
        if events <= partial.assigned:
            times = [partial.times[event] for event in events]
            defined = [time for time in times if time is not None]
            known[point] = None if len(defined) < len(times) else max(defined) if point[0] == "e" else min(defined)
    for node in scenario.nodes:
        # Clause: the guard holds for each of the events; without their own values it may be known before.
        for own in ({}, *_own_values(scenario, partial, node)):
            if node.when is not None and names(node.when) <= {*known, *own} and not holds(node.when, {**known, **own}):
                return False
        # Clause: the values of `distinct` are pairwise different, as the guard says that compares them.
        for one, other in combinations(_own_values(scenario, partial, node), 2) if node.distinct else ():
            if not _differ([(one[name], other[name]) for name in node.distinct]):
                return False
        # Clause: `within D` is the guard end - start <= D.
        if node.within is not None and f"end({node.name})" in known:
            start, end = known[f"start({node.name})"], known[f"end({node.name})"]
            if start is None or end is None or end - start > node.within:
                return False
    return True


def _own_values(scenario: ReferenceScenario, partial: Partial, node: Node) -> list[dict[str, Any]]:
    """Return the values that each event of a counted leaf has for itself; one entry for other nodes."""
    if not node.own_values:
        return [{}]
    there = [occurrence for occurrence in sorted(partial.assigned) if scenario.observing[occurrence].name == node.name]
    return [{name: partial.binding[f"{name}#{occurrence}"] for name in node.own_values} for occurrence in there]


def _differ(pairs: Sequence[tuple[Any, Any]]) -> bool:
    """Clause: `X != X' or Y != Y'`, read from left to right; undefined does not hold."""
    for one, other in pairs:
        if not (defined(one) and defined(other)):
            return False
        if not same(one, other):
            return True
    return False


def unbroken(scenario: ReferenceScenario, partial: Partial, past: Sequence[TraceStep]) -> bool:
    """Return whether no position breaks a `without`, as far as the events of its part are there.

    Clause: a position breaks the clause if the match does not use it, its event is not late, matches,
    and the guard holds, under the assignment of the match extended to the clause's own variables.
    Clause: with an undefined time of the part, a clause with a duration does not hold.
    """
    for clause, events in _clauses(scenario):
        places = [partial.places[event] for event in events & partial.assigned]
        if not places:
            continue
        first, last, complete = min(places), max(places), events <= partial.assigned
        times = [time for place in places if (time := past[place].time) is not None]
        if clause.duration is not None and complete and len(times) < len(places):
            return False
        end = decision(scenario, partial, past, clause, events) if complete and clause.side is Side.AFTER else None
        for place, (event, time, late) in enumerate(past):
            match clause.side:
                case Side.DURING:
                    inside = first < place and (place < last or not complete)
                case Side.AFTER:
                    inside = complete and last < place and (end is None or place < end)
                    inside = inside and time is not None and time <= max(times) + (clause.duration or 0)
                case Side.BEFORE:
                    inside = place < first
                    if clause.duration is not None:
                        inside = inside and time is not None and any(time >= own - clause.duration for own in times)
            used = place in partial.places.values()
            if inside and not late and not used and _matches(scenario.tree, clause, event, partial.binding):
                return False
    return True


def _matches(tree: RVAFT, clause: Without, event: Any, binding: Binding) -> bool:
    if event is None:
        return False
    found = matches(tree.events[clause.on.event].pattern, event, binding, arguments(tree, clause.on))
    return any(clause.when is None or holds(clause.when, one) for one in found)


def decided(scenario: ReferenceScenario, partial: Partial, past: Sequence[TraceStep]) -> bool:
    """Clause: true needs a match all of whose clauses are decided."""
    return all(
        clause.side is not Side.AFTER or decision(scenario, partial, past, clause, events) is not None
        for clause, events in _clauses(scenario)
    )


def decision(
    scenario: ReferenceScenario, partial: Partial, past: Sequence[TraceStep], clause: Without, events: frozenset[str]
) -> int | None:
    """Return the place that decides `for D after`, or None.

    Clause: the first position after the part whose defined time exceeds end(n) + D + L.
    """
    places = [partial.places[event] for event in events]
    times = [time for place in places if (time := past[place].time) is not None]
    late = scenario.tree.time.late if scenario.tree.time else None
    limit = max(times) + (clause.duration or 0) + (late or 0)
    later = range(max(places) + 1, len(past))
    return next((place for place in later if (own := past[place].time) is not None and own > limit), None)


def _clauses(scenario: ReferenceScenario) -> Iterator[tuple[Without, frozenset[str]]]:
    for node in scenario.nodes:
        for clause in node.without:
            yield clause, scenario.events(node.name)


def relevant(tree: RVAFT, event: Any) -> bool:
    """Return whether an event is relevant.

    Clause: no `ignore` matches it and, for some assignment, it matches the runtime event of some
    reachable node, that node's own `when` included if all the guard's variables occur in its `on`.
    """
    for ignore in tree.ignores:
        # Clause: the variables of an `ignore` are its own.
        found = matches(tree.events[ignore.on.event].pattern, event, {}, arguments(tree, ignore.on))
        if any(ignore.when is None or holds(ignore.when, one) for one in found):
            return False
    if tree.restricted:
        return any(_served(entry, event) for entry in tree.alphabet)
    for node in ReferenceScenario(tree, {name: node.children for name, node in tree.nodes.items()}).part(tree.root):
        if _relevant_to(tree, node, event):
            return True
    return False


def _relevant_to(tree: RVAFT, name: str, event: Any) -> bool:
    node = tree.nodes[name]
    if node.on is None and (node.gate is not None or node.when is not None):
        return False
    found = observe(tree, node, event, {})
    own = node.when is not None and names(node.when) <= bound_by(node) | {*node.own_values}
    return any(node.when is None or not own or holds(node.when, one) for one in found)


def _served(entry: Relevant, event: Any) -> bool:
    found = matches(entry.pattern, event, {}, {})
    return any(entry.when is None or holds(entry.when, one) for one in found)


def chosen_scenarios(tree: RVAFT, branch: int | None, kind: Kind | None) -> list[ReferenceScenario]:
    """Return the feasible scenarios of the selected branches.

    Raises `TreeError` if there is none or a guard is unbound.
    """
    chosen = _chosen(tree, branch, kind)
    found = [
        scenario
        for scenario in feasible_scenarios(tree)
        if any(of_branch(scenario, resolution) for resolution in chosen)
    ]
    if not found:
        raise TreeError("no feasible scenario", rule="no-scenario", nodes=[tree.root])
    for scenario in found:
        _check_scenario(scenario)
    return found


def _chosen(tree: RVAFT, branch: int | None, kind: Kind | None) -> list[Resolution]:
    """Clause: the monitor of a kind is that of all branches having it."""
    every = branches(tree)
    if branch is not None and not 1 <= branch <= len(every):
        raise TreeError(f"there is no branch {branch}; the tree has {len(every)}", rule="no-branch")
    chosen = every if branch is None else [every[branch - 1]]
    if kind is not None:
        chosen = [b for b in chosen if any(tree.nodes[name].kind is kind for name in b)]
    if not chosen:
        raise TreeError(f"no branch has the kind {kind}", rule="no-branch")
    return chosen


def _check_scenario(scenario: ReferenceScenario) -> None:
    if scenario.points and scenario.tree.time is None:
        raise TreeError("a condition on time in a tree without `time`", rule="no-time")
    for point, events in scenario.points.items():
        if not events:
            raise TreeError(f"{point} has no event, or several", rule="unbound-time")
    for node in scenario.nodes:
        unbound = names(node.when) - scenario.bound - set(scenario.points) if node.when is not None else set()
        unbound -= {*node.own_values}
        if unbound:
            raise TreeError(f"{min(unbound)} is unbound in the guard of {node.name}", rule="unbound-variable")
    for clause, events in _clauses(scenario):
        _check_clause(scenario, clause, events)
    if not scenario.occurrences:
        raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario")


def _check_clause(scenario: ReferenceScenario, clause: Without, events: frozenset[str]) -> None:
    """Clause: shared variables must be bound when they are needed: without `after` by each occurrence
    that may come first or one before it, with `after` by an occurrence of the part or one before it.
    """
    tree = scenario.tree
    if not events:
        raise TreeError("the part of a `without` has no occurrence", rule="unbound-absence")
    if clause.duration is not None and tree.time is None:
        raise TreeError("a duration in a tree without `time`", rule="no-time")
    everywhere = {name for node in tree.nodes.values() if node.name in tree.order for name in bound_by(node)}
    used = {part.name for part in clause.on.arguments if isinstance(part, Variable)}
    used |= names(clause.when) if clause.when is not None else set()
    if not used - everywhere <= {part.name for part in clause.on.arguments if isinstance(part, Variable)}:
        raise TreeError("no event binds a variable of a `without`", rule="unbound-absence")
    for order in scenario.orders:
        first = [{event} for event in events if order[event].isdisjoint(events)]
        for needed in [set(events)] if clause.side is Side.AFTER else first:
            there = needed.union(*(order[event] for event in needed))
            bound = {name for event in there for name in bound_by(scenario.observing[event])}
            if not (used & everywhere) <= bound:
                raise TreeError("a variable of a `without` is not bound", rule="unbound-absence")


def value_key(value: Any) -> Hashable:
    """Return a key that is equal for values that no guard distinguishes."""
    if isinstance(value, dict):
        return "object", frozenset((name, value_key(inner)) for name, inner in value.items())
    if isinstance(value, list):
        return "list", tuple(map(value_key, value))
    return isinstance(value, bool), value  # 1 and 1.0 are one number, `true` is no number
