"""The parts of a property as numbers, inner parts first, so that a set of parts is a bit mask.

Passes must first remove windows, counted events and ends in order.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, TypeVar, assert_never

from rvaft.core.property import (
    IMPOSSIBLE,
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    PartKind,
    Property,
    Sequence,
    Times,
    Within,
    WithoutEvent,
    fewest,
    kept_ways,
)
from rvaft.model.guards import Guard
from rvaft.support.bits import union

Seen = TypeVar("Seen")


@dataclass(frozen=True, slots=True)
class NumberedPart:
    """One part with its subparts' numbers; `of` is the part of the property, if any.

    `need` is the minimum number of subparts that a scenario keeps.
    """

    op: PartKind
    parts: tuple[int, ...] = ()
    need: int = 0
    of: Part | None = None

    @property
    def chooses(self) -> bool:
        """Whether scenarios differ in which subparts they keep."""
        return (self.op is PartKind.ONE or self.op is PartKind.AT_LEAST) and self.need < len(self.parts)

    @property
    def event(self) -> Event:
        """The event of an event part."""
        assert isinstance(self.of, Event)
        return self.of


EMPTY: Final = NumberedPart(PartKind.ALL)
"""The part without events or conditions."""


@dataclass(frozen=True)
class NumberedParts:
    """The parts, each after its subparts; the root is the last."""

    parts: tuple[NumberedPart, ...]

    @property
    def root(self) -> int:
        """The number of the root."""
        return len(self.parts) - 1

    @property
    def feasible(self) -> bool:
        """Whether constant guards leave any scenario."""
        return self.parts[-1].of is not IMPOSSIBLE

    @property
    def guards(self) -> tuple[tuple[int, Guard], ...]:
        """The conditions with their guards, outer parts first."""
        found = ((number, self.parts[number].of) for number in range(self.root, -1, -1))
        return tuple((number, part.guard) for number, part in found if isinstance(part, Condition))

    def kept(self) -> list[int]:
        """Return the parts that the root reaches, inner parts first."""
        seen = bytearray(len(self.parts))
        seen[self.root] = 1
        for number in range(self.root, -1, -1):
            if seen[number]:
                for part in self.parts[number].parts:
                    seen[part] = 1
        return [number for number in range(len(self.parts)) if seen[number]]

    def below(self) -> dict[int, int]:
        """Return, for each reachable part, the part and all parts below it as bits."""
        found: dict[int, int] = {}
        for number in self.kept():
            found[number] = 1 << number | union(found[inner] for inner in self.parts[number].parts)
        return found

    def around(self, events: Mapping[int, int], *, backwards: bool = False) -> dict[int, int]:
        """Return, for each reachable part, the events that sequences order before (or after) it.

        `events` maps each part to its events, as bits.
        """
        found = dict.fromkeys(reversed(self.kept()), 0)
        for number in found:
            part, outside = self.parts[number], found[number]
            for child in reversed(part.parts) if backwards else part.parts:
                found[child] |= outside
                if part.op is PartKind.SEQUENCE:
                    outside |= events[child]
        return found

    def resolve(self, number: int, chosen: Iterable[int]) -> "NumberedParts":
        """Return the parts with one choice resolved to the chosen subparts."""
        kept = tuple(chosen)
        made = replace(self.parts[number], op=PartKind.ALL, parts=kept, need=len(kept))
        return NumberedParts((*self.parts[:number], made, *self.parts[number + 1 :]))


def op_of(part: Part) -> PartKind:
    """Return the kind of a part."""
    match part:
        case Event():
            return PartKind.EVENT
        case Condition():
            return PartKind.CONDITION
        case All():
            return PartKind.ALL
        case Sequence():
            return PartKind.SEQUENCE
        case One():
            return PartKind.ONE
        case AtLeast():
            return PartKind.AT_LEAST
        case Times() | EndInOrder() | Within() | WithoutEvent():
            raise AssertionError("passes remove these before")
        case _:
            assert_never(part)


def numbered(prop: Property) -> NumberedParts:
    """Return the numbered parts of a property.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> for part in numbered(build(rvaft.loads("top sand_rl a b;"))).parts: print(part.op.name, part.parts)
    EVENT ()
    EVENT ()
    SEQUENCE (1, 0)
    """
    number = {part: place for place, part in enumerate(prop.parts)}
    found = []
    for part in prop.parts:
        inner = tuple(number[child] for child in part.parts)
        found.append(NumberedPart(op_of(part), inner, fewest(part), part))
    return NumberedParts(tuple(found))


def divided(
    form: NumberedParts, look: Callable[[NumberedParts], Seen | int], *, at_least: bool
) -> Iterator[tuple[NumberedParts, Seen]]:
    """Split the scenarios until `look` returns no further choice; yield each form with its result.

    `at_least` keeps the ways to choose more than K.
    """
    waiting = [iter([form])]
    while waiting:
        candidate = next(waiting[-1], None)
        if candidate is None:
            waiting.pop()
            continue
        found = look(candidate)
        if isinstance(found, int):
            part = candidate.parts[found]
            most = len(part.parts) if at_least and part.op is PartKind.AT_LEAST else part.need
            waiting.append(map(partial(candidate.resolve, found), kept_ways(part.parts, part.need, most)))
        else:
            yield candidate, found
