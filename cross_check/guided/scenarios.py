"""Random scenarios of a tree (semantics, section 2), drawn from the root down without enumerating them.

What turns out to be impossible is banned for the draws that follow, so that the choices above it are made differently: a node
(its guard cannot hold) or a tree edge (it takes part in a cycle of the precedence). Every feasible scenario can be drawn as
long as nothing is banned.
"""

from collections.abc import Mapping, Sequence
from random import Random
from typing import TypeAlias

from rvaft.guards import holds
from rvaft.guards import variables as guard_variables
from rvaft.model import Gate, Node
from rvaft.tree import RVAFT

Kept: TypeAlias = Mapping[str, tuple[str, ...]]
"""The nodes of a scenario, each with the children it keeps."""

Ban: TypeAlias = str | tuple[str, str]
"""A node, or a tree edge (parent, child), that no scenario drawn may have."""

_MORE_THAN_NEEDED = 0.3
"""How often a `KofN` keeps more than K children."""
_TRIED = 20
"""How many bans to try for one that leaves a scenario."""


class Scenarios:
    """The scenarios of a tree that have nothing banned."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.bans: set[Ban] = set()
        self._never = frozenset(node.name for node in tree.top_down() if _never_holds(node))

    def draw(self, random: Random, *, lean: bool = False) -> Kept | None:
        """One scenario, or None where every one has something banned; `lean` takes the choices with the fewest events.

        Its precedence may be cyclic; of the guards only those without variables hold for sure.
        """
        least = self._least()
        if least[self.tree.root] is None:
            return None
        kept: dict[str, tuple[str, ...]] = {}
        agenda = [self.tree.root]
        while agenda:
            name = agenda.pop()
            if name not in kept:
                kept[name] = self._choice(random, self.tree.nodes[name], least, lean=lean)
                agenda.extend(kept[name])
        return kept

    def ban(self, random: Random, bans: Sequence[Ban]) -> None:
        """Ban one of these, such that scenarios are left; where there is none such, start afresh with nothing banned."""
        for ban in random.sample(bans, min(len(bans), _TRIED)):
            if ban not in self.bans:
                self.bans.add(ban)
                if self._least()[self.tree.root] is not None:
                    return
                self.bans.remove(ban)
        self.bans.clear()

    def _choice(self, random: Random, node: Node, least: Mapping[str, int | None], *, lean: bool) -> tuple[str, ...]:
        if node.gate not in (Gate.OR, Gate.VOT):
            return node.children
        possible = [child for child in node.children if self._possible(node.name, child, least)]
        needed = node.threshold or 1
        if lean:
            random.shuffle(possible)
            chosen = set(sorted(possible, key=lambda child: least[child] or 0)[:needed])
        else:
            more = node.gate is Gate.VOT and random.random() < _MORE_THAN_NEEDED
            chosen = set(random.sample(possible, random.randint(needed, len(possible)) if more else needed))
        return tuple(child for child in node.children if child in chosen)

    def _possible(self, name: str, child: str, least: Mapping[str, int | None]) -> bool:
        return least[child] is not None and (name, child) not in self.bans

    def _least(self) -> dict[str, int | None]:
        """For each node the fewest events that a scenario has there (a shared part counts anew), None where it has none."""
        least: dict[str, int | None] = {}
        for node in self.tree.bottom_up():
            below = sorted(
                count
                for child in node.children
                if (count := least[child]) is not None and (node.name, child) not in self.bans
            )
            needed = _needed(node)
            impossible = node.name in self._never or node.name in self.bans or len(below) < needed
            least[node.name] = None if impossible else node.has_event + sum(below[:needed])
        return least


def _needed(node: Node) -> int:
    if node.gate is Gate.OR:
        return 1
    return len(node.children) if node.threshold is None else node.threshold


def _never_holds(node: Node) -> bool:
    return node.when is not None and not guard_variables(node.when) and not holds(node.when, {})
