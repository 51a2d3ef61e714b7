"""Trees with shared nodes: what the core allows a configuration to be.

The core (see `plan`) is what shared nodes tie together: a shared gate is resolved once, and whether one of its events precedes
another depends on which gates above are in the scenario. Parts stand in it as single *elements*: whatever orders one event
of a part against the rest of the tree orders all of them.
"""

from collections.abc import Iterator
from functools import cached_property

from rvaft.engine.configuration import Configuration
from rvaft.engine.elements import Elements, Resolution
from rvaft.engine.order import Order, bits
from rvaft.engine.plan import Plan
from rvaft.engine.progress import MORE, SURE, Progress
from rvaft.engine.search import Search
from rvaft.model import Gate

MEMORY = 20_000
"""How many answers are remembered; then the memory starts afresh."""


class Core:
    """The core of a plan; `limit` bounds the steps of one search."""

    def __init__(self, plan: Plan, progress: Progress, *, limit: int) -> None:
        self.plan = plan
        self.progress = progress
        self.elements = Elements(plan, progress)
        self.order = Order(plan)
        self._search = Search(plan, progress, self.elements, self.order, limit=limit)
        self._memory: dict[object, tuple[bool, bool]] = {}

    @property
    def members(self) -> frozenset[int]:
        """The nodes of the core."""
        return self.elements.members

    @cached_property
    def free(self) -> bool:
        """Whether the core leaves a choice."""
        return any(self.plan.gates[node] in (Gate.OR, Gate.VOT) for node in self.plan.core)

    def classify(self, configuration: Configuration) -> tuple[bool, bool]:
        """Whether what is taken is all of some feasible scenario, and, if not, whether it is a proper part of one."""
        key = self._key(configuration)
        found = self._memory.get(key)
        if found is None:
            if len(self._memory) >= MEMORY:
                self._memory.clear()
            complete = next(self.complete(configuration), None) is not None
            alive = not complete and any(self._unfinished(configuration))
            found = self._memory[key] = (complete, alive)
        return found

    def complete(self, configuration: Configuration) -> Iterator[Resolution]:
        """Resolutions whose occurrences are exactly those taken; some, if there are any."""
        return self._search.resolutions(configuration, complete=True)

    def possible(self, configuration: Configuration) -> bool:
        """Whether what is taken is all or a part of some feasible scenario, guards that are open left aside."""
        return next(self._search.resolutions(configuration, complete=False), None) is not None

    def _unfinished(self, configuration: Configuration) -> Iterator[int]:
        """What remains in resolutions that have what is taken as a part.

        Parts are looked at as finished as they can be: where that leaves nothing to come, there is a match already.
        """
        for kept in self._search.resolutions(configuration, complete=False):
            present, finished = self.elements.present(configuration, kept)
            yield present & ~finished

    def inverted(self, configuration: Configuration, node: int) -> frozenset[tuple[int, int]]:
        """The orders between elements that taking this node's event breaks."""
        element = self.plan.part_of[node]
        later = self.order.after[element] & self.elements.touched(configuration) & ~(1 << element)
        return frozenset((element, other) for other in bits(later))

    def settled(self, configuration: Configuration, node: int) -> bool:
        """Whether every scenario has, before this node's element, only what is taken (for a core without choices)."""
        before = self.order.before[self.plan.part_of[node]]
        return all(self._settled(configuration, element) for element in bits(before))

    def _settled(self, configuration: Configuration, element: int) -> bool:
        if element in self.members:
            return bool(configuration.taken >> element & 1)
        flags = self.progress.flags(configuration, element)
        return bool(flags & SURE) and not (flags & MORE and self.plan.chooses >> element & 1)

    def _key(self, configuration: Configuration) -> object:
        """What the answers depend on."""
        flags = tuple(self.progress.flags(configuration, part) for part in self.plan.parts)
        mask = self.elements.mask
        dead, closed = configuration.dead & mask, configuration.closed & mask
        return configuration.taken & mask, dead, closed, flags, configuration.inversions
