"""Which guards every event is under.

A guard counts in every scenario that contains its node, and is conjoined to every event of that scenario that binds one of its
variables. Where some scenarios with such an event contain the guard and others do not, the choices that decide it are made
one by one, until for each event it is settled which guards it is under.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from backends.ltlf.budget import Budget
from backends.ltlf.inevitable import always_in
from backends.ltlf.parts import Op, Part, Parts
from rvaft.guards import Guard
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Pattern, rigid_variables


@dataclass(frozen=True, slots=True)
class Settled:
    """Some of the scenarios of a tree, and for each of their events (by node) the guards it is under in all of them."""

    parts: Parts
    guards: Mapping[str, tuple[Guard, ...]]


def settle(parts: Parts, patterns: Mapping[str, Pattern], *, monotone: bool, limit: int) -> Iterator[Settled]:
    """All scenarios, divided so that the guards are settled; `patterns` holds the event of each node."""
    if not parts.guards:
        yield Settled(parts, {})
        return
    waiting = [parts]
    budget = Budget("the choices that guards depend on take more than the limit allows", limit)
    while waiting:
        candidate = waiting.pop()
        budget.spend(len(candidate.kept()))
        found = _placed(candidate, patterns)
        if isinstance(found, Settled):
            yield found
        else:
            ways = [candidate.resolve(found, way) for way in _ways(candidate.rows[found], monotone=monotone)]
            waiting.extend(reversed(ways))


def _ways(part: Part, *, monotone: bool) -> Iterator[tuple[int, ...]]:
    if part.op is Op.ONE:
        yield from ((chosen,) for chosen in part.parts)
        return
    for size in range(part.need, part.need + 1 if monotone else len(part.parts) + 1):
        yield from combinations(part.parts, size)


def _placed(parts: Parts, patterns: Mapping[str, Pattern]) -> Settled | int:
    """The guards of each event, or a part whose choice decides about one."""
    kept = parts.kept()
    graph = _Graph(parts.rows, kept)
    placed: dict[str, list[Guard]] = {}
    guards = [(number, guard) for number, guard in parts.guards if number in graph.below]
    for number, guard in guards:
        names = set(guard_variables(guard))
        for event in kept:
            node = parts.rows[event].node
            if parts.rows[event].op is not Op.EVENT or names.isdisjoint(rigid_variables(patterns[node])):
                continue
            if graph.implies(event, number):
                placed.setdefault(node, []).append(guard)
            elif graph.together(event, number):
                return graph.deciding(event, number)
    return Settled(parts, {node: tuple(dict.fromkeys(found)) for node, found in placed.items()})


class _Graph:
    """Who is in which scenarios with whom; sets of parts are bits."""

    def __init__(self, rows: Sequence[Part], kept: Sequence[int]) -> None:
        self.rows = rows
        self.kept = kept
        self.below: dict[int, int] = {}
        """Of each part itself and all it reaches."""
        self.always: dict[int, int] = {}
        """Of each part itself and what is in every scenario that contains it, looking downwards only."""
        for number in kept:
            part = rows[number]
            self.below[number] = 1 << number
            for inner in part.parts:
                self.below[number] |= self.below[inner]
            self.always[number] = 1 << number | always_in(part, [self.always[inner] for inner in part.parts])
        self.above = self._dominators()

    def _dominators(self) -> dict[int, int]:
        """Of each part itself and the parts on every way to it."""
        above: dict[int, int] = {self.kept[-1]: 0}
        for number in reversed(self.kept):
            above[number] |= 1 << number
            for part in self.rows[number].parts:
                above[part] = above[part] & above[number] if part in above else above[number]
        return above

    def implies(self, event: int, number: int) -> bool:
        """Whether every scenario with the event contains the part; conservative."""
        return any(self.always[part] >> number & 1 for part in _bits(self.above[event]))

    def together(self, event: int, number: int) -> bool:
        """Whether some scenario may contain both: there is a gate that keeps a way to each, or one is on the way to the other."""
        if self.below[number] >> event & 1 or self.below[event] >> number & 1:
            return True
        for part in self.kept:
            if self.rows[part].op is not Op.ONE:
                to_event = {p for p in self.rows[part].parts if self.below[p] >> event & 1}
                to_number = {p for p in self.rows[part].parts if self.below[p] >> number & 1}
                if to_event and to_number and len(to_event | to_number) > 1:
                    return True
        return False

    def deciding(self, event: int, number: int) -> int:
        """The topmost choice between the part and the nearest part on every way to it and to the event."""
        common = self.above[event] & self.above[number]
        nearest = (common & -common).bit_length() - 1
        return max(
            part for part in _bits(self.below[nearest]) if self.rows[part].chooses and self.below[part] >> number & 1
        )


def _bits(members: int) -> Iterator[int]:
    while members:
        lowest = members & -members
        yield lowest.bit_length() - 1
        members ^= lowest
