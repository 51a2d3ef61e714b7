"""Precedence among the elements of a core: its events, and its parts as wholes (semantics, section 2)."""

from collections.abc import Iterator, Mapping
from functools import cached_property

from rvaft.engine.configuration import Configuration
from rvaft.engine.plan import Plan


def bits(mask: int) -> Iterator[int]:
    """The members of a set, ascending."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


class Order:
    """The precedence of each resolution of one core."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    @cached_property
    def before(self) -> dict[int, int]:
        """What may precede each element, in whichever scenario."""
        kept = {node: self.plan.children[node] for node in self.plan.core}
        events = sum(1 << node for node in self.plan.core if self.plan.own[node])
        return self._before(kept, events | sum(1 << part for part in self.plan.parts))

    @cached_property
    def after(self) -> dict[int, int]:
        """What each element may precede."""
        found = dict.fromkeys(self.before, 0)
        for element, earlier in self.before.items():
            for other in bits(earlier):
                found[other] |= 1 << element
        return found

    def allows(
        self, configuration: Configuration, kept: Mapping[int, tuple[int, ...]], elements: tuple[int, int], touched: int
    ) -> bool:
        """Whether a resolution is feasible and the configuration is downward closed in it, with an order it allows.

        `elements` are those that have events in the scenario and those of them that are finished.
        """
        present, finished = elements
        before = self._before(kept, present)
        if any(before[element] & ~finished for element in bits(present & touched)):
            return False
        if any(before.get(late, 0) >> early & 1 for early, late in configuration.inversions):
            return False
        if any(before[element] >> element & 1 for element in bits(present)):
            return False
        return _acyclic(before, present & ~finished)

    def _before(self, kept: Mapping[int, tuple[int, ...]], present: int) -> dict[int, int]:
        """What directly precedes each present element; the rest of the precedence follows by transitivity."""
        plan = self.plan
        within: dict[int, int] = {}
        before = dict.fromkeys(bits(present), 0)
        for node in reversed(list(kept)):
            below = 0
            for child in kept[node]:
                below |= within[child] if child in kept else 1 << child & present
            gate = plan.gates[node]
            if gate is not None and gate.ordered:
                earlier = 0
                for child in kept[node]:
                    part = within[child] if child in kept else 1 << child & present
                    for element in bits(part) if earlier else ():
                        before[element] |= earlier
                    earlier |= part
            own = 1 << node & present
            if own and plan.top_down:
                for element in bits(below):
                    before[element] |= own
            elif own:
                before[node] |= below
            within[node] = below | own
        return before


def _acyclic(before: Mapping[int, int], elements: int) -> bool:
    """Whether the elements can be put in an order."""
    while elements:
        free = [element for element in bits(elements) if not before[element] & elements]
        if not free:
            return False
        for element in free:
            elements ^= 1 << element
    return True
