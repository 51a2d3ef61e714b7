"""The orders in which the events of a tree may come, for languages that say one order at a time: words of letters, each once.

Choices between leaves of which each stands by itself are made within a letter, votes keep no child more than they need (under `scattered`
the others ask for nothing new), and words that differ in one letter become one. All of it is paid from a budget.
"""

from collections import Counter
from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Mapping, Sequence
from functools import reduce
from operator import or_
from typing import TypeVar

import networkx as nx

from rvaft.analysis.normal_form import Op, body, is_constant, is_impossible
from rvaft.analysis.scenarios import Kept, Point, event, precedence, resolutions
from rvaft.errors import TooLarge, TreeError
from rvaft.model import guards, patterns
from rvaft.model.guards import Guard
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT, find_cycle
from rvaft.support.bits import bits

Letter = TypeVar("Letter", bound=Hashable)


class Orders:
    """The feasible scenarios of a plain tree, and the orders of each. Raises `TooLarge` beyond `limit` events of all orders, or `steps` for each.

    `groups` has the leaves of each choice that `tree` has as one leaf; those `apart` stay choices. Votes keep more children than they need if not `minimal`.

    >>> from rvaft import loads
    >>> orders = Orders(loads("top and a o; o or b c;"), limit=100)
    >>> [(*orders.words(kept, {"a": "a", "o": "b|c"}),) for kept in orders.scenarios()], orders.groups
    ([(('a', 'b|c'), ('b|c', 'a'))], {'o': ('b', 'c')})
    """

    def __init__(
        self, tree: RVAFT, *, limit: int, steps: int = 200, apart: Container[str] = (), minimal: bool = True
    ) -> None:
        self._limit, self._left, self._minimal = limit, limit * steps, minimal
        self._graphs: dict[int, nx.DiGraph] = {}
        self._said: set[tuple[Hashable, ...]] = set()
        self._events = 0
        self.groups: dict[str, tuple[str, ...]] = {}
        parents = Counter(child for node in tree.top_down() for child in node.children)
        uses = Counter(name for node in tree.top_down() for name in {*_own(tree, node), *guards.variables(node.when)})

        def stands_alone(name: str) -> bool:
            node = tree.nodes[name]
            own = _own(tree, node)
            leaf = name in self.groups or (not node.children and node.has_event and not is_impossible(node))
            untied = own >= {*guards.variables(node.when)} and all(uses[one] == 1 for one in own)
            return leaf and parents[name] == 1 and untied

        for node in tree.bottom_up():
            bare = body(node).op is Op.ONE and not node.has_event and node.when is None and node.name not in apart
            if bare and all(map(stands_alone, node.children)):
                self.groups[node.name] = node.children
        inside = {child for children in self.groups.values() for child in children}
        nodes = (Node(name) if name in self.groups else node for name, node in tree.nodes.items() if name not in inside)
        self.tree = tree.changed(nodes=list(nodes)) if inside else tree

    def spend(self, steps: int) -> None:
        """Pay for steps of work."""
        self._left -= steps
        if self._left < 0:
            raise TooLarge("events of all orders in which they may come", limit=self._limit)

    def scenarios(self) -> Iterator[Kept]:
        """The feasible ones; `TreeError` where there is none."""
        found = False
        for kept in resolutions(self.tree, minimal=self._minimal, limit=self._limit):
            graph = precedence(self.tree, kept)
            self.spend(len(graph))
            if not find_cycle(graph):
                found, self._graphs = True, {id(kept): graph}
                yield kept
        if not found:
            root = self.tree.root
            raise TreeError(f"no scenario of {root} is feasible", rule="no-scenario", nodes=[root])

    def asked(
        self, kept: Kept, bound: Mapping[str, Container[str]], several: Callable[[str, Guard], Exception | None]
    ) -> dict[str, list[Guard]] | None:
        """What the guards of a scenario ask of each event; None where one of them never holds.

        Each guard is put to one event that has (`bound`) all its variables, that of its own node if it can be. A guard that looks at several
        events is given to `several` with its node; raises what that returns, if it is an error.
        """
        found: dict[str, list[Guard]] = {name: [] for name in bound}
        for node in (self.tree.nodes[name] for name in kept):
            for guard in () if is_constant(node) else guards.conjuncts(node.when):
                mentioned = {*guards.variables(guard)}
                if not mentioned and not guards.holds(guard, {}):
                    return None
                having = (name for name in (node.name, *bound) if all(one in bound.get(name, ()) for one in mentioned))
                holder = next((name for name in having if name in bound), None)
                if holder is not None:
                    found[holder].append(guard)
                elif mentioned and (refusal := several(node.name, guard)) is not None:
                    raise refusal
        return found

    def after(self, kept: Kept) -> dict[str, frozenset[str]]:
        """Of each event of a scenario, that it has just given, those that come after it."""
        graph, names = self._graphs[id(kept)], [name for name in kept if self.tree.nodes[name].has_event]
        later = (nx.descendants(graph, event(name)) for name in names)
        return {
            name: frozenset(one for one in names if event(one) in some) for name, some in zip(names, later, strict=True)
        }

    def words(self, kept: Kept, letters: Mapping[str, Letter]) -> Iterator[tuple[Letter, ...]]:
        """The orders of the events of a scenario, that it has just given, as words of the letters of its nodes; none that was there before."""
        graph, names = self._graphs[id(kept)], list(letters)
        number = {name: 1 << bit for bit, name in enumerate(names)}
        before: dict[Point, int] = {}
        for point in nx.topological_sort(graph):
            earlier = (before[one] | (number[one[1]] if one[0] == "event" else 0) for one in graph.predecessors(point))
            before[point] = reduce(or_, earlier, 0)
        known = [before[event(name)] for name in names]
        needed, last = list(known), dict[Hashable, int]()
        for one, name in enumerate(names):  # what is alike comes in one order
            later = sum(bit for other, bit in number.items() if before[event(other)] & number[name])
            alike = letters[name], known[one], later
            needed[one] |= last.get(alike, 0)
            last[alike] = number[name]
        everything = (1 << len(names)) - 1
        todo: list[tuple[frozenset[int], tuple[Letter, ...]]] = [(frozenset({0}), ())]
        while todo:
            done, word = todo.pop()
            self.spend(len(word) + 1)
            if everything in done:
                if word not in self._said:
                    self._said.add(word)
                    self._events += len(word)
                    self.spend(0 if self._events <= self._limit else self._left + 1)
                    yield word
                continue
            nexts: dict[Letter, set[int]] = {}
            for mask in done:
                self.spend(1 + len(names) // 4)
                for one in bits(everything & ~mask):
                    if not needed[one] & ~mask:
                        nexts.setdefault(letters[names[one]], set()).add(mask | 1 << one)
            todo += [(frozenset(after), (*word, letter)) for letter, after in reversed(nexts.items())]


def _own(tree: RVAFT, node: Node) -> set[str]:
    """The variables of the event of a node."""
    pattern = tree.pattern(node.name)
    return set() if pattern is None else {*patterns.rigid_variables(pattern)}


def merged(
    words: Iterable[tuple[Letter, ...]],
    union: Callable[[Sequence[Letter]], Letter],
    kind: Callable[[Letter], Hashable] = lambda _: None,
) -> list[tuple[Letter, ...]]:
    """The same words with one for those that differ in one letter, of one kind.

    >>> merged([("a", "b"), ("c", "b"), ("b", "a")], "|".join)
    [('a|c', 'b'), ('b', 'a')]
    """
    found = list(dict.fromkeys(words))
    for place in range(max(map(len, found), default=0)):
        alike: dict[Hashable, list[tuple[Letter, ...]]] = {}
        for word in found:
            same = (word[:place], kind(word[place]), word[place + 1 :]) if place < len(word) else (word,)
            alike.setdefault(same, []).append(word)
        found = [
            several[0]
            if len(several) == 1
            else (*several[0][:place], union([word[place] for word in several]), *several[0][place + 1 :])
            for several in alike.values()
        ]
    return found
