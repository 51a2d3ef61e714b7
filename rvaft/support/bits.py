"""Sets of small integers as bit masks."""

from collections.abc import Iterable, Iterator
from functools import reduce
from operator import or_


def bits(mask: int) -> Iterator[int]:
    """Iterate over the members of a set in increasing order.

    >>> list(bits(0b1011))
    [0, 1, 3]
    """
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


def mask_of(numbers: Iterable[int]) -> int:
    """Return the set of these numbers.

    >>> bin(mask_of([0, 3]))
    '0b1001'
    """
    return union(1 << number for number in numbers)


def union(sets: Iterable[int]) -> int:
    """Return the union of the sets.

    >>> bin(union([0b1001, 0b0011]))
    '0b1011'
    """
    return reduce(or_, sets, 0)


def meet(pairs: Iterable[tuple[int, int]]) -> bool:
    """Whether the second set of some pair intersects the first set of an earlier pair.

    >>> meet([(0b001, 0b110), (0b010, 0b100)]), meet([(0b001, 0b110), (0b010, 0b101)])
    (False, True)
    """
    seen = 0
    for own, others in pairs:
        if others & seen:
            return True
        seen |= own
    return False


def in_at_least(count: int, sets: Iterable[int]) -> int:
    """Return the members of at least `count` sets (`count` >= 1), by bit-sliced binary counters.

    >>> bin(in_at_least(2, [0b1001, 0b0011, 0b0010]))
    '0b11'
    """
    planes = [0] * count.bit_length()
    everything = 0
    for members in sets:
        everything |= members
        carry = members
        for index, plane in enumerate(planes):
            planes[index], carry = plane ^ carry, plane & carry
        if carry:
            planes.append(carry)
    greater, same = 0, everything
    for index in reversed(range(len(planes))):
        if count >> index & 1:
            same &= planes[index]
        else:
            greater |= same & planes[index]
            same &= ~planes[index]
    return greater | same


class DisjointSets:
    """Disjoint sets of the integers below a size, at first of one each.

    >>> sets = DisjointSets(4)
    >>> sets.unite([1, 3])
    >>> [bin(mask) for mask in sets.masks()], sets.first(1) == sets.first(3)
    (['0b1', '0b1010', '0b100'], True)
    """

    def __init__(self, size: int) -> None:
        self._above = list(range(size))

    def first(self, number: int) -> int:
        """Return the integer that stands for the set of a number."""
        while self._above[number] != number:
            self._above[number] = number = self._above[self._above[number]]
        return number

    def unite(self, numbers: Iterable[int]) -> None:
        """Unite the sets of these numbers."""
        firsts = [self.first(number) for number in numbers]
        for one in firsts[1:]:
            self._above[self.first(one)] = self.first(firsts[0])

    def masks(self) -> list[int]:
        """Return the sets, in the order of their least members."""
        found: dict[int, int] = {}
        for number in range(len(self._above)):
            place = self.first(number)
            found[place] = found.get(place, 0) | 1 << number
        return list(found.values())
