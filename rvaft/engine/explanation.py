"""The explanation of a detection, and the awaited events of branches (semantics, sections 2 and 4).

A node is pending in a branch if some partial match has everything that precedes the node's event,
but not that event. Whether the variables and guards can ever agree is ignored. Only partial matches
that the engine follows count. Under `scattered` it drops subsumed ones, and under `consecutive` and
`scattered` those that the times rule out.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import islice
from typing import Final, NamedTuple, TypeAlias

from rvaft.core.branches import branches, number_of, or_gates
from rvaft.core.part_numbers import PartKind
from rvaft.core.passes import with_choices
from rvaft.core.property import One, Property, Source
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import SURE, TOUCHED, Configuration, Witness, history
from rvaft.engine.partial_matches import Following, Matching
from rvaft.engine.scattered_linear import LinearMonitor, LinearRun, possible_nodes
from rvaft.errors import TooLarge
from rvaft.model.expressions import event_text
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json, fingerprint
from rvaft.monitors import DEFAULT_BRANCHES, Awaited, Explanation, MatchedEvent, Pending
from rvaft.support.bits import mask_of

SEARCHING: Final = 20_000_000
"""The maximum number of visited nodes."""
BRANCHES: Final = 20_000
"""The maximum number of tried branches."""
REMEMBERED: Final = 10_000
"""The maximum number of remembered searches for the match to explain."""

_new: Final = tuple.__new__  # twice as fast as the constructors of the classes
Choices: TypeAlias = Mapping[str, str]
"""The child that each `or` gate keeps, if reached."""


class Step(NamedTuple):
    """An occurrence and its event."""

    source: Source
    position: int
    values: Mapping[str, Json]


class FoundMatch(NamedTuple):
    """A match: its steps in event order, and the kept children of nodes."""

    steps: list[Step]
    kept: Mapping[str, tuple[str, ...]]


def kept_nodes(tree: RVAFT, chosen: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return the reachable nodes with their kept children."""

    def children(name: str) -> tuple[str, ...]:
        return chosen.get(name, tree.nodes[name].children)

    return {name: children(name) for name in reachable(tree.root, children)}


def made_choices(prop: Property) -> dict[str, str]:
    """Return the child that each `or` gate keeps, after all choices."""
    gates = [part for part in prop.parts if isinstance(part, One) and part.source is not None]
    kept = ((gate.source, gate.parts[0].source) for gate in gates)
    return {gate.node: child.node for gate, child in kept if gate is not None and child is not None}


class MatchFinder:
    """A search for matches under choices in the state of a strategy."""

    def __init__(self, strategy: Following | LinearMonitor) -> None:
        self.strategy = strategy
        self.compiled = strategy.compiled
        self.prop = strategy.compiled.prop

    def find(self, choices: Choices) -> FoundMatch | None:
        """Return a match with these choices, or None."""
        strategy = self.strategy
        if isinstance(strategy, LinearMonitor):
            run = self._run(strategy, choices)
            if not run.detected:
                return None
            kept = dict(run.scenario())
            steps = _taken(self.compiled, (Witness(None, node, *run.fired[node]) for node in kept if node in run.fired))
            return _found(self.compiled, sorted(steps, key=lambda step: step.position), kept)
        for matching, match in self._replayed([history(match.witness) for match in strategy.matches], choices):
            if matching.standing(match)[0]:
                steps = _taken(matching.compiled, history(match.witness))
                return _found(matching.compiled, steps, _scenario(matching, match))
        return None

    def waiting(
        self, choices: Choices | None, histories: Iterable[list[Witness]]
    ) -> Iterator[tuple[set[str], Mapping[str, Json]]]:
        """Iterate over the awaited nodes after these steps, by the values of variables."""
        if isinstance(self.strategy, LinearMonitor):
            yield {self.compiled.names[node] for node in self._run(self.strategy, choices or {}).awaited()}, {}
            return
        found: dict[Hashable, tuple[set[str], Mapping[str, Json]]] = {}
        histories = list(histories)
        replayed = list(self._replayed(histories, choices))
        # the partial matches of this branch have been subsumed
        if not replayed and choices and not self.strategy.uses_up:
            sources = {event.source for event in with_choices(self.prop, choices).events}
            rest = [[step for step in steps if self.compiled.events[step.node] in sources] for steps in histories]
            replayed = list(self._replayed(rest, choices)) or list(self._replayed([[]], choices))
        for matching, match in replayed:
            names = found.setdefault(fingerprint(match.binding), (set(), dict(match.binding)))[0]
            names.update(matching.admitted(match))
        yield from found.values()

    def _run(self, strategy: LinearMonitor, choices: Choices) -> LinearRun:
        compiled = self.compiled
        made = {gate: child for gate, child in choices.items() if gate in compiled.choices}
        return strategy.run_under({compiled.choices[gate]: compiled.child(gate, child) for gate, child in made.items()})

    def _replayed(
        self, histories: Iterable[list[Witness]], choices: Choices | None
    ) -> Iterator[tuple[Matching, Configuration]]:
        assert isinstance(self.strategy, Following), "the linear way follows no matches"
        matching, sources = self.strategy.matching, self.compiled.events
        if choices:
            under, made = matching.under, frozenset(choices.items())
            if made not in under:
                chosen = with_choices(self.prop, choices)
                if not chosen.feasible:
                    return
                if len(under) >= DEFAULT_BRANCHES:
                    under.clear()
                under[made] = Matching(CompiledTree(chosen), limit=self.strategy.limit, early=matching.early)
            matching = under[made]
        else:
            for steps in histories:
                match = matching.after(steps[-1] if steps else None)
                if match is not None:
                    yield matching, match
            return
        node_of = matching.compiled.occurrences
        for steps in histories:
            places = [(sources[step.node], step) for step in steps]
            if all(source in node_of for source, _ in places):
                taken = ((node_of[source], one.values, one.position) for source, one in places if source is not None)
                match = matching.replayed(taken)
                if match is not None:
                    yield matching, match

    def is_possible(self, gate: str, child: str) -> bool:
        """Return False if no match can keep this child of a choice.

        For the first child, a match that avoids the choice counts too. True is not certain.
        """
        if gate not in self.compiled.choices:
            return False
        able, unavoidable = self._limits
        is_first = self.prop.tree.nodes[gate].children[0] == child
        return self.compiled.child(gate, child) in able or (is_first and self.compiled.choices[gate] not in unavoidable)

    @cached_property
    def _limits(self) -> tuple[set[int], set[int]]:
        strategy, compiled = self.strategy, self.compiled
        if isinstance(strategy, LinearMonitor):
            came = {node for node in range(len(compiled.names)) if strategy.came(node)}
        else:
            taken = mask_of(step.node for match in strategy.matches for step in history(match.witness))
            came = {node for node, own in enumerate(compiled.own) if not own or taken >> node & 1}
        able = possible_nodes(compiled, compiled.children.__getitem__, among=came)
        unavoidable = {compiled.root}
        for node, children in enumerate(compiled.children):
            candidates = [child for child in children if child in able]
            if node in unavoidable and len(candidates) == compiled.need[node]:
                unavoidable.update(candidates)
        return able, unavoidable


def _found(compiled: CompiledTree, steps: list[Step], kept: Mapping[int, Iterable[int]]) -> FoundMatch:
    tree, chosen = compiled.prop.tree, dict[str, tuple[str, ...]]()
    for node, children in kept.items():
        gate = tree.nodes.get(compiled.names[node])
        if gate is not None and compiled.ops[node] is not PartKind.SEQUENCE:
            names = {compiled.names[child] for child in children}
            own = tuple(child for child in gate.children if child in names)
            if own:
                chosen[gate.name] = own
    return FoundMatch(steps, kept_nodes(tree, chosen))


def _scenario(matching: Matching, match: Configuration) -> dict[int, tuple[int, ...]]:
    compiled = matching.compiled
    kept: dict[int, tuple[int, ...]] = {}
    agenda = [compiled.root]
    if compiled.core:
        kept.update(next(matching.shared.resolutions(match, complete=True)))
        agenda = [child for children in kept.values() for child in children if child not in compiled.members]
    while agenda:
        node = agenda.pop()
        children = compiled.children[node]
        if compiled.chooses >> node & 1:
            flags = {child: matching.progress.flags(match, child) for child in children}
            touched = tuple(child for child in children if flags[child] & TOUCHED)
            silent = tuple(child for child in children if flags[child] & SURE and not flags[child] & TOUCHED)
            children = touched + silent[: max(compiled.need[node] - len(touched), 0)]
        kept[node] = children
        agenda.extend(children)
    return kept


class Explained(NamedTuple):
    """What the explanations of similar detections share: the number of the match, and its branch."""

    match: int
    branch: int | None
    kinds: frozenset[Kind]
    kept: Mapping[str, tuple[str, ...]]


def explain(strategy: Following | LinearMonitor) -> Explanation:
    """Return the explanation of a detection; its branch is None if the search takes too long.

    The branch depends on the nodes of the matches, in order, and on their failed guards only.
    """
    compiled = strategy.compiled
    if isinstance(strategy, LinearMonitor):
        found, explained = _search(strategy)
        return _explanation(compiled.prop.tree, found.steps, explained)
    matches, known = strategy.matches, compiled.explained
    histories = [history(match.witness) for match in matches]
    nodes = [(*[step[1] for step in steps],) for steps in histories]
    alike = tuple([(own, one.dead, one.closed) for own, one in zip(nodes, matches, strict=True)])
    if alike not in known:
        if len(known) >= REMEMBERED:
            known.clear()
        found, explained = _search(strategy)
        place = next(place for place, steps in enumerate(histories) if _taken(compiled, steps) == found.steps)
        known[alike] = explained._replace(match=place)
    explained = known[alike]
    return _explanation(compiled.prop.tree, _taken(compiled, histories[explained.match]), explained)


def _taken(compiled: CompiledTree, steps: Iterable[Witness]) -> list[Step]:
    return [_new(Step, (compiled.events[node], position, values)) for _, node, position, values in steps]


def _explanation(tree: RVAFT, steps: Sequence[Step], explained: Explained) -> Explanation:
    values: dict[str, Json] = {}
    for step in reversed(steps):
        values.update(step.values)
    matched = tuple([_new(MatchedEvent, (*source, position)) for source, position, _ in steps])
    own = tree.variables
    variables = {name: value for name, value in values.items() if name in own}
    return Explanation(explained.branch, explained.kinds, matched, variables, explained.kept)


def _search(strategy: Following | LinearMonitor) -> tuple[FoundMatch, Explained]:
    """Return a match in the lowest branch."""
    finder = MatchFinder(strategy)
    prop, tree = finder.prop, finder.prop.tree
    found = finder.find({})
    assert found is not None, "what detected is a match"
    number = prop.branch
    if number is None and prop.resolved:
        number = number_of(tree, made_choices(prop))
    elif number is None and prop.kind is None:
        found, number = _lowest(tree, finder, found)
    elif number is None:
        of_kind = (branch for branch in islice(branches(tree), BRANCHES) if prop.kind in branch.kinds)
        matches = ((match, branch.number) for branch in of_kind if (match := finder.find(branch.choices)) is not None)
        found, number = next(matches, (found, None))
    kinds = (tree.nodes[name].kind for name in found.kept)
    return found, Explained(0, number, frozenset(kind for kind in kinds if kind is not None), found.kept)


def _lowest(tree: RVAFT, finder: MatchFinder, found: FoundMatch) -> tuple[FoundMatch, int | None]:
    """Return the match with the lowest branch, and its number unless the search takes too long.

    Digits are minimized from the most significant on; unreached choices have digit 0.
    """
    fixed: dict[str, str] = {}
    effort = 0
    order = or_gates(tree)
    for name in reversed(order):
        children = tree.nodes[name].children
        digit = children.index(found.kept[name][0]) if name in found.kept else 0
        for lower in range(digit):
            if finder.is_possible(name, children[lower]):
                effort += len(tree.nodes)
                if effort > SEARCHING:
                    return found, None
                better = finder.find({**fixed, name: children[lower]})
                if better is not None:
                    found, digit = better, lower
                    break
        fixed[name] = children[digit]
    return found, number_of(tree, {name: found.kept[name][0] for name in order if name in found.kept})


def pending(strategy: Following | LinearMonitor, *, limit: int, before: int | None = None) -> tuple[Pending, ...]:
    """Return the awaited events of each live branch.

    `before` selects the state before the event at this position. Beyond `limit` branches, all
    branches are joined.
    """
    finder = MatchFinder(strategy)
    prop, tree = finder.prop, finder.prop.tree
    selected: list[tuple[int | None, Choices | None]] = [(None, None)]
    if prop.branch is not None:
        selected = [(prop.branch, {})]
    elif prop.resolved:
        selected = [(number_of(tree, made_choices(prop)), {})]
    else:
        with suppress(TooLarge):
            first = list(islice(branches(tree), limit + 1))
            if len(first) <= limit:
                wanted = (one for one in first if prop.kind is None or prop.kind in one.kinds)
                selected = [(branch.number, branch.choices) for branch in wanted]
    histories: list[list[Witness]] = []
    if isinstance(strategy, Following):
        matches = strategy.combined if before is None else strategy.lost
        steps = (history(match.witness) for match in matches)
        histories = [[one for one in some if before is None or one.position < before] for some in steps]
    return tuple(
        Pending(number, awaited(tree, names), {n: value for n, value in variables.items() if n in tree.variables})
        for number, choices in selected
        for names, variables in finder.waiting(choices, histories)
        if names
    )


def together(waiting: Iterable[Pending], *, numbered: bool = True) -> tuple[Pending, ...]:
    """Return the entries, joined by branch and values; unless `numbered`, by values."""
    found: dict[Hashable, tuple[Pending, dict[Awaited, None]]] = {}
    for one in waiting:
        place = one.branch if numbered else None, fingerprint(one.variables)
        found.setdefault(place, (one, {}))[1].update(dict.fromkeys(one.awaited))
    return tuple(Pending(one.branch if numbered else None, tuple(all_), one.variables) for one, all_ in found.values())


def awaited(tree: RVAFT, names: Iterable[str]) -> tuple[Awaited, ...]:
    """Return these nodes in tree order with their events."""
    wanted = set(names)
    nodes = (tree.nodes[name] for name in tree.order if name in wanted)
    return tuple(Awaited(n.name, event_text(n)) for n in nodes)
