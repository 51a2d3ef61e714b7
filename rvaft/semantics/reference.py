"""Detection and verdicts (definition, sections 3 and 4)."""

from collections.abc import Hashable, Iterator
from typing import Any, NamedTuple

from rvaft.errors import TreeError
from rvaft.model.nodes import Kind, Relevant
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics.events import Binding, arguments, bound_by, holds, matches, names, observe
from rvaft.semantics.scenarios import Resolution, Scenario, branches, feasible_scenarios, of_branch


class Partial(NamedTuple):
    """A downward-closed set of a scenario's occurrences that some positions of the prefix serve, and its variables."""

    scenario: int
    assigned: frozenset[str]
    binding: Binding

    @property
    def key(self) -> Hashable:
        """Equal for equal partial matches."""
        return self.scenario, self.assigned, frozenset((name, _key(value)) for name, value in self.binding.items())


class Reference(Monitor):
    """The verdict after each prefix, by following every partial match of every feasible scenario.

    Raises `TreeError` where the branch or kind does not exist, no scenario is left, or a guard is unbound.
    """

    def __init__(
        self,
        tree: RVAFT,
        semantics: Semantics | str = Semantics.PROJECTED,
        *,
        branch: int | None = None,
        kind: Kind | str | None = None,
    ) -> None:
        super().__init__()
        self.tree = tree
        self.semantics = Semantics(semantics)
        chosen = _chosen(tree, branch, None if kind is None else Kind(kind))
        self.scenarios = [s for s in feasible_scenarios(tree) if any(of_branch(s, b) for b in chosen)]
        if not self.scenarios:
            raise TreeError("no feasible scenario", rule="no-scenario", nodes=[tree.root])
        for scenario in self.scenarios:
            _check_scenario(scenario)
        start = [Partial(number, frozenset(), {}) for number in range(len(self.scenarios))]
        self._partials = {partial.key: partial for partial in start}

    @property
    def state(self) -> Hashable:
        """The verdict and the partial matches so far."""
        return self.verdict, frozenset(self._partials)

    def _advance(self, event: Any) -> Verdict:
        """Clauses: *true*: some prefix contains a match. *false*: not true, and no partial match is left."""
        found = {partial.key: partial for partial in self._after(event)}
        if any(self._complete(partial) for partial in found.values()):
            self._partials = {}
            return Verdict.TRUE
        self._partials = found
        return Verdict.UNKNOWN if found or self.semantics is Semantics.SCATTERED else Verdict.FALSE

    def _after(self, event: Any) -> Iterator[Partial]:
        """Clauses: `strict` uses up all positions, `projected` all relevant ones, `scattered` any.

        No position is used twice: an event extends a partial match by one occurrence at most.
        """
        skips = self.semantics is Semantics.SCATTERED
        skips = skips or (self.semantics is Semantics.PROJECTED and not relevant(self.tree, event))
        takes = self.semantics is not Semantics.PROJECTED or not skips
        for partial in self._partials.values():
            if skips:
                yield partial
            if takes:
                yield from self._extended(partial, event)

    def _extended(self, partial: Partial, event: Any) -> Iterator[Partial]:
        """Clause: precedence is kept, every event matches its occurrence under one assignment of the variables."""
        scenario = self.scenarios[partial.scenario]
        for name in sorted(scenario.occurrences - partial.assigned):
            if scenario.before[name] <= partial.assigned:
                binding = observe(self.tree, self.tree.nodes[name], event, partial.binding)
                if binding is not None and _guards_hold(scenario, binding):
                    yield Partial(partial.scenario, partial.assigned | {name}, binding)

    def _complete(self, partial: Partial) -> bool:
        """Clause: a match maps all its occurrences; every guard holds (all its variables are bound by then)."""
        return partial.assigned == self.scenarios[partial.scenario].occurrences


def _guards_hold(scenario: Scenario, binding: Binding) -> bool:
    """Clause: guards whose variables are all bound hold."""
    guards = [node.when for node in scenario.nodes if node.when is not None]
    return all(holds(guard, binding) for guard in guards if names(guard) <= set(binding))


def relevant(tree: RVAFT, event: Any) -> bool:
    """Clause: no `ignore` matches it and, for some assignment, it matches the runtime event of some reachable node, that
    node's own `when` included if all the guard's variables occur in that node's `on`.
    """  # noqa: D205 -- a quotation
    for ignore in tree.ignores:
        # Clause: the variables of an `ignore` are its own.
        found = matches(tree.events[ignore.on.event].pattern, event, {}, arguments(tree, ignore.on))
        if found is not None and (ignore.when is None or holds(ignore.when, found)):
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
    return found is not None and (node.when is None or not own or holds(node.when, found))


def _served(entry: Relevant, event: Any) -> bool:
    found = matches(entry.pattern, event, {}, {})
    return found is not None and (entry.when is None or holds(entry.when, found))


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
    for node in scenario.nodes:
        unbound = names(node.when) - scenario.bound if node.when is not None else set()
        if unbound:
            raise TreeError(f"{min(unbound)} is unbound in the guard of {node.name}", rule="unbound-variable")
    if not scenario.occurrences:
        raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario")


def _key(value: Any) -> Hashable:
    if isinstance(value, dict):
        return "object", frozenset((name, _key(inner)) for name, inner in value.items())
    if isinstance(value, list):
        return "list", tuple(map(_key, value))
    return type(value).__name__, value  # 1 and 1.0 are equal, but arithmetic may tell them apart: integers are exact
