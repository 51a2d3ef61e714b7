"""What every scenario of a part contains; sets of parts are bits."""

from collections.abc import Sequence

from backends.ltlf.parts import Op, Part


def always_in(part: Part, inner: Sequence[int]) -> int:
    """What every scenario of a part contains, given what every scenario of each of its parts contains."""
    return _in_at_least(inner, _missable(part))


def _missable(part: Part) -> int:
    """In how many of its parts a thing has to be so that it is in every scenario."""
    match part.op:
        case Op.ONE:
            return len(part.parts)
        case Op.AT_LEAST:
            return len(part.parts) - part.need + 1
        case _:
            return 1


def _in_at_least(sets: Sequence[int], count: int) -> int:
    """What is in at least that many of the sets."""
    if not sets or count > len(sets):
        return 0
    reached = [0] * (count + 1)
    reached[0] = -1
    for members in sets:
        for size in range(count, 0, -1):
            reached[size] |= reached[size - 1] & members
    return reached[count]
