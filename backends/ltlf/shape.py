"""What the translation asks about the parts of a tree: events under a part, parts that share them, parts that one event may serve.

Sets of events are bits, so that a tree of thousands of nodes is no trouble.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.ltlf.overlap import overlaps
from backends.ltlf.parts import Op, Part, Parts
from rvaft.patterns import Pattern


@dataclass(frozen=True, slots=True)
class Shape:
    """Simplified parts, and for each part three answers.

    Its events (`events`); the other events that one event may serve together with one of them (`rivals`); and, where
    every scenario of the part observes exactly one event, the parts that are that event (`unit`).
    """

    rows: tuple[Part, ...]
    events: tuple[int, ...]
    rivals: tuple[int, ...]
    unit: tuple[tuple[int, ...] | None, ...]

    @property
    def root(self) -> int:
        """The number of the whole."""
        return len(self.rows) - 1


def shape_of(parts: Parts, patterns: Mapping[str, Pattern]) -> Shape:
    """The answers for simplified parts."""
    numbers = [number for number, part in enumerate(parts.rows) if part.op is Op.EVENT]
    bit = {number: 1 << index for index, number in enumerate(numbers)}
    rival = dict(zip(numbers, overlaps([patterns[parts.rows[n].node] for n in numbers]), strict=True))
    events: list[int] = []
    rivals: list[int] = []
    unit: list[tuple[int, ...] | None] = []
    for number, part in enumerate(parts.rows):
        events.append(_union(bit.get(number, 0), part, events))
        rivals.append(_union(rival.get(number, 0), part, rivals))
        unit.append(_unit(number, part, unit))
    return Shape(parts.rows, tuple(events), tuple(rivals), tuple(unit))


def _union(own: int, part: Part, sets: Sequence[int]) -> int:
    for inner in part.parts:
        own |= sets[inner]
    return own


def _unit(number: int, part: Part, unit: Sequence[tuple[int, ...] | None]) -> tuple[int, ...] | None:
    if part.op is Op.EVENT:
        return (number,)
    if part.op is not Op.ONE or not part.parts:
        return None
    found: list[int] = []
    for inner in part.parts:
        alternatives = unit[inner]
        if alternatives is None:
            return None
        found.extend(alternatives)
    return tuple(dict.fromkeys(found))


def rivals_apart(shape: Shape, part: int) -> bool:
    """Whether no event can serve occurrences in two different parts of this one, nor one occurrence be in both and rival there."""
    seen = 0
    for inner in shape.rows[part].parts:
        if shape.rivals[inner] & seen:
            return False
        seen |= shape.events[inner]
    return True


def entangled(shape: Shape, part: int) -> bool:
    """Whether two parts that one scenario may keep share an occurrence."""
    if shape.rows[part].op is Op.ONE:
        return False
    seen = 0
    for inner in shape.rows[part].parts:
        if shape.events[inner] & seen:
            return True
        seen |= shape.events[inner]
    return False


def tangled(shape: Shape) -> list[bool]:
    """For each part, whether it or some part below it is entangled."""
    found: list[bool] = []
    for number, part in enumerate(shape.rows):
        found.append(entangled(shape, number) or any(found[inner] for inner in part.parts))
    return found


def disjoint_events(shape: Shape, part: int) -> bool:
    """Whether all parts are single events and no event can serve two of them: the condition of the windows."""
    return (
        all(shape.unit[inner] is not None for inner in shape.rows[part].parts)
        and rivals_apart(shape, part)
        and not entangled(shape, part)
    )
