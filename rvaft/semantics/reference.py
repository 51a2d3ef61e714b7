"""Detection and verdicts (definition, sections 3 and 4)."""

from collections.abc import Hashable, Iterator, Mapping
from typing import Any, NamedTuple

from rvaft.errors import TreeError
from rvaft.model.nodes import Kind, Relevant
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics.events import Binding, arguments, bound_by, holds, matches, names, observe, time_of
from rvaft.semantics.scenarios import Resolution, Scenario, branches, feasible_scenarios, of_branch


class Partial(NamedTuple):
    """A downward-closed set of a scenario's occurrences, in one of its orders, with their bindings.

    `times` are the times of their events, None if undefined.
    """

    scenario: int
    order: int
    assigned: frozenset[str]
    binding: Binding
    times: Mapping[str, int | None]

    @property
    def key(self) -> Hashable:
        """A hashable key, equal for equal partial matches."""
        values = frozenset((name, value_key(value)) for name, value in self.binding.items())
        return self.scenario, self.order, self.assigned, values, frozenset(self.times.items())


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

    @property
    def state(self) -> Hashable:
        """The verdict, the partial matches and the maximum time so far."""
        return self.verdict, frozenset(self._partials), self._latest

    def _advance(self, event: Any) -> Verdict:
        """Clauses: *true*: some prefix contains a match. *false*: not true, and no partial match is
        left.
        """
        time = time_of(self.tree.time, event)
        late = self._is_late(time)
        found = {partial.key: partial for partial in self._after(event, time, late=late)}
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
            if passes:
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
                for binding in observe(self.tree, scenario.observing[occurrence], event, partial.binding):
                    times = {**partial.times, occurrence: time} if scenario.points else {}
                    found = partial._replace(assigned=partial.assigned | {occurrence}, binding=binding, times=times)
                    if guards_hold(scenario, found):
                        yield found

    def _complete(self, partial: Partial) -> bool:
        """Clause: a match maps all its occurrences. Every guard holds, since all its variables are
        known.
        """
        return partial.assigned == self.scenarios[partial.scenario].occurrences


def guards_hold(scenario: Scenario, partial: Partial) -> bool:
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
        if node.when is not None and names(node.when) <= set(known) and not holds(node.when, known):
            return False
        # Clause: `within D` is the guard end - start <= D.
        if node.within is not None and f"end({node.name})" in known:
            start, end = known[f"start({node.name})"], known[f"end({node.name})"]
            if start is None or end is None or end - start > node.within:
                return False
    return True


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
    for node in Scenario(tree, {name: node.children for name, node in tree.nodes.items()}).part(tree.root):
        if _relevant_to(tree, node, event):
            return True
    return False


def _relevant_to(tree: RVAFT, name: str, event: Any) -> bool:
    node = tree.nodes[name]
    if node.on is None and (node.gate is not None or node.when is not None):
        return False
    found = observe(tree, node, event, {})
    own = node.when is not None and names(node.when) <= bound_by(node)
    return any(node.when is None or not own or holds(node.when, one) for one in found)


def _served(entry: Relevant, event: Any) -> bool:
    found = matches(entry.pattern, event, {}, {})
    return any(entry.when is None or holds(entry.when, one) for one in found)


def chosen_scenarios(tree: RVAFT, branch: int | None, kind: Kind | None) -> list[Scenario]:
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


def _check_scenario(scenario: Scenario) -> None:
    if scenario.points and scenario.tree.time is None:
        raise TreeError("a condition on time in a tree without `time`", rule="no-time")
    for point, events in scenario.points.items():
        if not events:
            raise TreeError(f"{point} has no event, or several", rule="unbound-time")
    for node in scenario.nodes:
        unbound = names(node.when) - scenario.bound - set(scenario.points) if node.when is not None else set()
        if unbound:
            raise TreeError(f"{min(unbound)} is unbound in the guard of {node.name}", rule="unbound-variable")
    if not scenario.occurrences:
        raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario")


def value_key(value: Any) -> Hashable:
    """Return a key that is equal for values that no guard distinguishes."""
    if isinstance(value, dict):
        return "object", frozenset((name, value_key(inner)) for name, inner in value.items())
    if isinstance(value, list):
        return "list", tuple(map(value_key, value))
    return isinstance(value, bool), value  # 1 and 1.0 are one number, `true` is no number
