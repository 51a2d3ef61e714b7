"""The explanation of a detection, and the awaited events of branches (semantics, sections 2 and 4).

A strategy provides a `MatchSearch`: a match under choices of `or` gates, and the nodes awaited under
choices. The searches for the lowest branch and over all branches are here.

A node is pending in a branch if some partial match has everything that precedes the node's event,
but not that event. Whether the variables and guards can ever agree is ignored. Only partial matches
that the engine follows count. Under `scattered` it drops subsumed ones, and under `consecutive` and
`scattered` those that the times rule out.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import islice
from typing import Final, NamedTuple, TypeAlias

from rvaft.core.branches import branches, number_of, or_gates
from rvaft.core.property import PartKind, Property, Source
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.errors import TooLarge
from rvaft.model.expressions import event_text
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json, fingerprint
from rvaft.monitors import Awaited, AwaitedAbsence, Explanation, MatchedEvent, Pending

SEARCHING: Final = 20_000_000
"""The maximum number of visited nodes."""
BRANCHES: Final = 20_000
"""The maximum number of tried branches."""

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


class Waiting(NamedTuple):
    """The nodes awaited by partial matches with the same values, and what they wait for not to come."""

    names: Iterable[str]
    variables: Mapping[str, Json]
    absent: tuple[AwaitedAbsence, ...] = ()


class MatchSearch(ABC):
    """A search for matches under choices in the state of a strategy."""

    prop: Property

    @abstractmethod
    def find(self, choices: Choices) -> FoundMatch | None:
        """Return a match with these choices, or None."""

    @abstractmethod
    def waiting(self, choices: Choices | None) -> Iterable[Waiting]:
        """Iterate over the awaited nodes under these choices, by the values of variables.

        None stands for all branches together.
        """

    @abstractmethod
    def is_possible(self, gate: str, child: str) -> bool:
        """Return False if no match can keep this child of a choice.

        For the first child, a match that avoids the choice counts too. True is not certain.
        """


class CompiledSearch(MatchSearch):
    """A search in a compiled tree."""

    def __init__(self, compiled: CompiledTree) -> None:
        self.compiled = compiled
        self.prop = compiled.prop

    @property
    @abstractmethod
    def came(self) -> Container[int]:
        """The nodes whose own event, if any, may have occurred."""

    def is_possible(self, gate: str, child: str) -> bool:
        """As `MatchSearch.is_possible`, by the nodes whose events came."""
        if gate not in self.compiled.choices:
            return False
        able, unavoidable = self._limits
        is_first = self.prop.tree.nodes[gate].children[0] == child
        nodes = self.compiled.choices[gate]
        return any(self.compiled.child(node, child) in able or (is_first and node not in unavoidable) for node in nodes)

    @cached_property
    def _limits(self) -> tuple[set[int], set[int]]:
        compiled = self.compiled
        able = possible_nodes(compiled, compiled.children.__getitem__, among=self.came)
        unavoidable = {compiled.root}
        for node, children in enumerate(compiled.children):
            candidates = [child for child in children if child in able]
            if node in unavoidable and len(candidates) == compiled.need[node]:
                unavoidable.update(candidates)
        return able, unavoidable


def possible_nodes(
    compiled: CompiledTree, children: Callable[[int], Sequence[int]], among: Container[int] | None = None
) -> set[int]:
    """Return the nodes that can be complete with these children at any time.

    Only nodes in `among` have their event.
    """
    able: set[int] = set()
    for node in range(len(compiled.names) - 1, -1, -1):
        if (among is None or node in among) and sum(child in able for child in children(node)) >= compiled.need[node]:
            able.add(node)
    return able


def found_match(compiled: CompiledTree, steps: list[Step], kept: Mapping[int, Iterable[int]]) -> FoundMatch:
    """Return a match of these steps, in event order, that keeps these children of nodes."""
    tree, chosen = compiled.prop.tree, dict[str, tuple[str, ...]]()
    for node, children in kept.items():
        gate = tree.nodes.get(compiled.names[node])
        if gate is not None and compiled.ops[node] is not PartKind.SEQUENCE:
            names = {compiled.names[child] for child in children}
            own = tuple(child for child in gate.children if child in names)
            if own:
                chosen[gate.name] = own
    return FoundMatch(steps, kept_nodes(tree, chosen))


class Explained(NamedTuple):
    """What the explanations of similar detections share: the number of the match, and its branch."""

    match: int
    branch: int | None
    kinds: frozenset[Kind]
    kept: Mapping[str, tuple[str, ...]]


def explanation_of(tree: RVAFT, steps: Sequence[Step], explained: Explained) -> Explanation:
    """Return the explanation of a match of these steps."""
    values: dict[str, Json] = {}
    for step in reversed(steps):
        values.update(step.values)
    matched = tuple([_new(MatchedEvent, (*source, position)) for source, position, _ in steps])
    own = tree.variables
    variables = {name: value for name, value in values.items() if name in own}
    return Explanation(explained.branch, explained.kinds, matched, variables, explained.kept)


def explained_match(search: MatchSearch) -> tuple[FoundMatch, Explained]:
    """Return a match in the lowest branch; its branch is None if the search takes too long, or too many events."""
    prop, tree = search.prop, search.prop.tree
    found = search.find({})
    assert found is not None, "what detected is a match"
    number = prop.branch
    with suppress(TooLarge):  # not all events that the search needs are remembered
        if number is None and prop.kind is None:
            found, number = _lowest(tree, search, found)
        elif number is None:
            of_kind = (branch for branch in islice(branches(tree), BRANCHES) if prop.kind in branch.kinds)
            matches = ((m, branch.number) for branch in of_kind if (m := search.find(branch.choices)) is not None)
            found, number = next(matches, (found, None))
    kinds = (tree.nodes[name].kind for name in found.kept)
    return found, Explained(0, number, frozenset(kind for kind in kinds if kind is not None), found.kept)


def _lowest(tree: RVAFT, search: MatchSearch, found: FoundMatch) -> tuple[FoundMatch, int | None]:
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
            if search.is_possible(name, children[lower]):
                effort += len(tree.nodes)
                if effort > SEARCHING:
                    return found, None
                better = search.find({**fixed, name: children[lower]})
                if better is not None:
                    found, digit = better, lower
                    break
        fixed[name] = children[digit]
    return found, number_of(tree, {name: found.kept[name][0] for name in order if name in found.kept})


def pending(search: MatchSearch, *, limit: int) -> tuple[Pending, ...]:
    """Return the awaited events of each live branch.

    Beyond `limit` branches, all branches are joined.
    """
    prop, tree = search.prop, search.prop.tree
    selected: list[tuple[int | None, Choices | None]] = [(None, None)]
    if prop.branch is not None:
        selected = [(prop.branch, {})]
    else:
        with suppress(TooLarge):
            first = list(islice(branches(tree), limit + 1))
            if len(first) <= limit:
                wanted = (one for one in first if prop.kind is None or prop.kind in one.kinds)
                selected = [(branch.number, branch.choices) for branch in wanted]
    return tuple(
        Pending(number, awaited(tree, names), {n: v for n, v in variables.items() if n in tree.variables}, absent)
        for number, choices in selected
        for names, variables, absent in search.waiting(choices)
        if names or absent
    )


def together(waiting: Iterable[Pending], *, numbered: bool = True) -> tuple[Pending, ...]:
    """Return the entries, joined by branch and values; unless `numbered`, by values."""
    found: dict[Hashable, tuple[Pending, dict[Awaited, None], dict[AwaitedAbsence, None]]] = {}
    for one in waiting:
        place = one.branch if numbered else None, fingerprint(one.variables)
        _, all_, absent = found.setdefault(place, (one, {}, {}))
        all_.update(dict.fromkeys(one.awaited))
        absent.update(dict.fromkeys(one.absent))
    return tuple(
        Pending(one.branch if numbered else None, tuple(all_), one.variables, tuple(absent))
        for one, all_, absent in found.values()
    )


def awaited(tree: RVAFT, names: Iterable[str]) -> tuple[Awaited, ...]:
    """Return these nodes in tree order with their events."""
    wanted = set(names)
    nodes = (tree.nodes[name] for name in tree.order if name in wanted)
    return tuple(Awaited(n.name, event_text(n)) for n in nodes)
