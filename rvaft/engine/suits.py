"""Whether the linear way to monitor `scattered` means the same as the general one (see `earliest`)."""

from collections.abc import Iterable
from itertools import combinations, product

from rvaft.engine.letters import Letters
from rvaft.engine.overlap import overlapping
from rvaft.engine.plan import Plan
from rvaft.engine.starts import Starts, starts_of
from rvaft.model import Gate

EFFORT = 1_000_000
"""How many steps to spend on the question; beyond, the answer is no."""


def linear_starts(plan: Plan, letters: Letters) -> Starts | None:
    """The starts of the nodes where no variable ties events together and nothing competes for an event, else None."""
    if any(plan.exported):
        return None
    starts = starts_of(plan)
    if starts is None or _Contest(plan, letters).found():
        return None
    return starts


class _Contest:
    """Two occurrences of one scenario, neither before the other, that one event can serve."""

    def __init__(self, plan: Plan, letters: Letters) -> None:
        self.plan = plan
        self.serves = [nodes for nodes in letters.serves if nodes]
        self.patterns = [letter.pattern for letter, nodes in zip(letters.letters, letters.serves, strict=True) if nodes]
        self.core = frozenset(plan.core)
        self.effort = 0

    def found(self) -> bool:
        """Whether there are two, or the search for them takes too long."""
        if any(self._among(combinations(nodes, 2)) for nodes in self.serves):
            return True
        for left, right in overlapping(self.patterns):
            self.effort += 1
            if self._among(product(self.serves[left], self.serves[right])):
                return True
        return False

    def _among(self, pairs: Iterable[tuple[int, int]]) -> bool:
        return any(self.effort > EFFORT or self._compete(a, b) for a, b in pairs)

    def _compete(self, a: int, b: int) -> bool:
        """Whether two nodes may compete: not if one is above the other, or their lowest common gate orders or separates them.

        Between nodes that sharing relates, the answer is always yes.
        """
        plan = self.plan
        if a in self.core or b in self.core or plan.part_of[a] != plan.part_of[b]:
            return True
        above = {a}
        node = a
        while plan.parent[node] >= 0:
            node = plan.parent[node]
            above.add(node)
            self.effort += 1
        node = b
        while node not in above:
            node = plan.parent[node]
            self.effort += 1
        if node in (a, b) or plan.gates[node] in (Gate.SAND, Gate.SAND_RL, Gate.OR):
            return False
        return not (plan.gates[node] is Gate.VOT and plan.thresholds[node] == 1)
