"""States of the general form for parts that share occurrences: the scenarios that are still possible, as partial orders.

A shared occurrence is observed once, wherever it is used, so that scenarios cannot be put together from those of the parts. Here they are
written out: each as its remaining occurrences with those that must come before. A state is the set of the scenarios that agree
with what was observed.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TypeAlias

from backends.ltlf.budget import Budget
from backends.ltlf.parts import Op, Part

Order: TypeAlias = frozenset[tuple[int, int]]
"""Occurrences (parts) with the set (bits) of those that must come before."""

State: TypeAlias = frozenset[Order]


class Orders:
    """The scenarios of parts, and the steps that lead through them."""

    def __init__(self, rows: Sequence[Part], *, monotone: bool, limit: int) -> None:
        self._rows = rows
        self._monotone = monotone
        self._budget = Budget("the scenarios of parts that share occurrences take more than the limit allows", limit)

    def of(self, root: int) -> State:
        """The feasible scenarios of a part."""
        found: set[Order] = set()
        for kept in _resolutions(self._rows, root, monotone=self._monotone):
            self._budget.spend(len(kept))
            order = _order(self._rows, kept)
            if _acyclic(order):
                found.add(order)
        return frozenset(found)

    def over(self, state: State) -> bool:
        """Whether some scenario has nothing left."""
        return frozenset() in state

    def steps(self, state: State) -> Iterator[tuple[int, State]]:
        """The occurrences that may come next, each with the scenarios that agree with it."""
        ways: dict[int, set[Order]] = {}
        for order in state:
            for occurrence, before in order:
                if not before:
                    self._budget.spend(len(order))
                    ways.setdefault(occurrence, set()).add(_without(order, occurrence))
        for occurrence in sorted(ways):
            yield occurrence, frozenset(ways[occurrence])


def _without(order: Order, gone: int) -> Order:
    bit = 1 << gone
    return frozenset((pair[0], pair[1] & ~bit) if pair[1] & bit else pair for pair in order if pair[0] != gone)


def _resolutions(rows: Sequence[Part], root: int, *, monotone: bool) -> Iterator[dict[int, tuple[int, ...]]]:
    """Every way to make the choices: the kept parts, each with its kept parts. A shared part is resolved once."""
    agenda: list[tuple[dict[int, tuple[int, ...]], frozenset[int]]] = [({}, frozenset([root]))]
    while agenda:
        kept, reached = agenda.pop()
        if not reached:
            yield kept
            continue
        number = max(reached)  # wholes before parts, so that none is reached again once it is resolved
        ways = list(_ways(rows[number], monotone=monotone))
        agenda.extend(({**kept, number: way}, reached - {number} | set(way)) for way in reversed(ways))


def _ways(part: Part, *, monotone: bool) -> Iterator[tuple[int, ...]]:
    if part.op is Op.ONE:
        yield from ((chosen,) for chosen in part.parts)
    elif part.op is Op.AT_LEAST:
        for size in range(part.need, part.need + 1 if monotone else len(part.parts) + 1):
            yield from combinations(part.parts, size)
    else:
        yield part.parts


def _order(rows: Sequence[Part], kept: dict[int, tuple[int, ...]]) -> Order:
    inside: dict[int, int] = {}
    before: dict[int, int] = {}
    for number in sorted(kept):
        if rows[number].op is Op.EVENT:
            inside[number] = 1 << number
            before[number] = 0
            continue
        members = 0
        for part in kept[number]:
            if rows[number].op is Op.SEQUENCE and members:
                for occurrence in before:
                    if inside[part] >> occurrence & 1:
                        before[occurrence] |= members
            members |= inside[part]
        inside[number] = members
    return frozenset(before.items())


def _acyclic(order: Order) -> bool:
    left = dict(order)
    while left:
        first = [occurrence for occurrence, before in left.items() if not before]
        if not first:
            return False
        gone = 0
        for occurrence in first:
            del left[occurrence]
            gone |= 1 << occurrence
        left = {occurrence: before & ~gone for occurrence, before in left.items()}
    return True
