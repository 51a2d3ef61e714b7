"""The number of a branch, without enumerating those before it where no node is shared (semantics, section 2).

Branches are ordered by the digits of their `or` gates, the gate that is last in breadth-first order counting most; a gate that a branch
does not reach has digit 0. So the number is one more than, summed over the gates from the last to the first, the
count of branches that agree on the gates after it and have a smaller digit there. Such a count is a product over gates, a sum over
the choices of an `or`.
"""

from collections.abc import Mapping

from rvaft.branches import number_of
from rvaft.model import Gate, Kind
from rvaft.tree import RVAFT

MOST = 10**9
"""Counts stop here; a number beyond is not told."""

EFFORT = 20_000_000
"""How many steps to spend on counting."""


def or_gates(tree: RVAFT) -> list[str]:
    """The reachable `or` gates in breadth-first order."""
    order, seen = [tree.root], {tree.root}
    for name in order:
        new = [child for child in tree.nodes[name].children if child not in seen]
        seen.update(new)
        order.extend(new)
    return [name for name in order if tree.nodes[name].gate is Gate.OR]


def lowest_number(tree: RVAFT, choices: Mapping[str, str], kind: Kind | None = None) -> int | None:
    """The lowest number of a branch that makes these choices (and has the kind); None where counting takes too long."""
    if tree.shared or kind is not None:
        return number_of(tree, choices, kind=kind)
    counts = _Counts(tree)
    number = 1
    for name in reversed(or_gates(tree)):
        digit = tree.nodes[name].children.index(choices[name]) if name in choices else 0
        if digit:
            number += counts.below(name, digit)
        counts.fix(name, digit)
        if number > MOST or counts.effort > EFFORT:
            return None
    return number


class _Counts:
    """For each node the ways to resolve what is below it, and whether it may stay unreached, given the digits fixed so far."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.effort = 0
        self._digits: dict[str, range] = {}
        self._ways: dict[str, int] = {}
        self._idle: dict[str, bool] = {}
        for node in tree.bottom_up():
            self._ways[node.name], self._idle[node.name] = self._evaluate(node.name)

    def _evaluate(self, name: str) -> tuple[int, bool]:
        node = self.tree.nodes[name]
        self.effort += 1 + len(node.children)
        busy = [child for child in node.children if not self._idle[child]]
        if node.gate is not Gate.OR:
            ways = 1
            for child in node.children:
                ways = min(ways * self._ways[child], MOST)
            return ways, not busy
        digits = self._digits.get(name, range(len(node.children)))
        possible = (node.children[digit] for digit in digits)
        ways = sum(self._ways[child] for child in possible if all(other == child for other in busy))
        return min(ways, MOST), not busy and 0 in digits

    def fix(self, name: str, digit: int) -> None:
        """Fix the digit of a gate."""
        self._digits[name] = range(digit, digit + 1)
        self._refresh(name, {})

    def below(self, name: str, digit: int) -> int:
        """The number of branches where a gate has a smaller digit."""
        self._digits[name] = range(digit)
        before: dict[str, tuple[int, bool]] = {}
        possible = self._refresh(name, before)
        count = self._ways[self.tree.root] if possible else 0
        for node, (ways, idle) in before.items():
            self._ways[node], self._idle[node] = ways, idle
        return count

    def _refresh(self, name: str, before: dict[str, tuple[int, bool]]) -> bool:
        """Bring a node and those above it up to date; False, and stop, at one that must be reached and cannot be resolved."""
        while True:
            old = self._ways[name], self._idle[name]
            new = self._evaluate(name)
            if new == old:
                return True
            before[name] = old
            self._ways[name], self._idle[name] = new
            if new == (0, False):
                return False
            parents = self.tree.parents(name)
            if not parents:
                return True
            name = parents[0]
