"""The partial matches of one stage, indexed so that an event visits only those that it can extend.

The index uses the values that an event must repeat, then the order of a value that it bounds.
"""

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from heapq import heappop, heappush
from operator import ge
from typing import Final, NamedTuple, TypeAlias

from rvaft.core.times import TimeDifference
from rvaft.engine.configuration import Witness
from rvaft.engine.subsumption import Rank, Ranking, Term, scale
from rvaft.model.values import KEYS, Json, exact, is_number, key

UNRANKED: Final = Rank(None, (), ())
"""The rank of the only member of a group, which is compared with none."""


class Member(NamedTuple):
    """A partial match, numbered by arrival: the values that it remembers, and its last step."""

    number: int
    binding: dict[str, Json]
    last: Witness | None
    rank: Rank = UNRANKED


class Bound(NamedTuple):
    """A bound of an event on a remembered value: a lower bound (`rising`) or an upper bound."""

    rising: bool
    by: Callable[[Mapping[str, Json]], Callable[[Json], bool]]
    """From the event's values to a test of the remembered value."""


class LaneMember(NamedTuple):
    """A member with its ordering value."""

    value: Json
    number: int
    member: Member


SORTED: Final = 2
"""A front of members with so many values is sorted by each of them."""
NEAR: Final = 64
"""The distance from the end searched stepwise."""
LOOSE: Final = "loose"
"""The kind of numbers so large that sums need not keep their order."""
RankFunction: TypeAlias = Callable[[Mapping[str, Json], Witness | None], Rank]
"""From the values and steps of a partial match to its rank."""
_Place: TypeAlias = Hashable
_new: Final = tuple.__new__  # twice as fast as the constructors of the classes
_Lanes: TypeAlias = dict[tuple[Hashable, ...], list[LaneMember]]
"""By type and values of the ordering term."""


def place_of(values: Iterable[Json]) -> _Place:
    """Return a key that is equal for equal values; a non-finite value equals nothing."""
    return tuple([v if type(v) in KEYS and (type(v) is not float or v - v == 0) else key(v) for v in values])


class StageGroup:
    """The partial matches of one stage, indexed by the values that they remember."""

    __slots__ = ("_deadlines", "_ending", "_fronts", "_ordered", "_rank", "everyone", "members", "ranking", "watermark")

    def __init__(
        self, ranking: Ranking, rank: RankFunction, deadlines: Sequence[TimeDifference], watermark: int | None
    ) -> None:
        self.ranking = ranking
        self.members: dict[int, Member] = {}
        self.everyone = ((self.members.values(), None),)
        self.watermark = watermark
        self._rank = rank
        self._deadlines = deadlines
        self._ending: list[tuple[int, int]] | None = None
        """A heap: the watermark that rules out a member, its number; None before any watermark."""
        self._fronts: dict[_Place, list[Member]] = {}
        """The members by place, sorted by their first value; none while there is one, unranked."""
        self._ordered: dict[tuple[tuple[str, ...], Term | None], dict[_Place, _Lanes]] = {}

    def rank(self, binding: Mapping[str, Json], last: Witness | None) -> Rank:
        """Return the rank of a partial match, to compare with those of the members."""
        if not self._fronts:
            for number, one in self.members.items():
                only = self.members[number] = one._replace(rank=self._rank(one.binding, one.last))
                self._fronts[only.rank.place] = [only]
        return self._rank(binding, last)

    def excels(self, rank: Rank) -> bool:
        """Whether some members are at least as good."""
        front = self._fronts.get(rank.place)
        if front is None:
            return False
        if not rank.values and not rank.excluded:
            return True
        start, end = self._better(front, rank)
        if rank.excluded:
            return self.ranking.covers([front[at].rank for at in range(start, end)], rank)
        if len(rank.values) <= SORTED:
            return start < end and all(map(ge, front[start].rank.values, rank.values))
        return any(all(map(ge, front[at].rank.values, rank.values)) for at in range(start, end))

    def add(self, number: int, binding: dict[str, Json], last: Witness | None, rank: Rank = UNRANKED) -> None:
        """Add a member and remove those that it subsumes.

        A member that the watermark rules out is not added.
        """
        end = None
        if self._deadlines and (self._ending is not None or self.watermark is not None):
            end = self._end(binding)
            if end is not None and self.watermark is not None and end < self.watermark:
                return
        if self.members and rank is UNRANKED:
            rank = self.rank(binding, last)
        member = _new(Member, (number, binding, last, rank))
        if rank is not UNRANKED:
            front = self._fronts.setdefault(rank.place, [])
            for one in self._surpassed(front, rank) if front else ():
                self.remove(one.number)
            front = self._fronts.setdefault(rank.place, front)  # perhaps it was removed with its last member
            front.insert(bisect_left(front, rank.values[0], key=_first) if rank.values else len(front), member)
        self.members[number] = member
        for (names, term), ordered in self._ordered.items():
            self._put_ordered(names, term, ordered, member)
        if self._ending is not None and end is not None:
            heappush(self._ending, (end, number))

    def _end(self, binding: Mapping[str, Json]) -> int | None:
        """Return the greatest watermark with which a partial match can still hold, or None."""
        ends = [one.deadline(binding) for one in self._deadlines]
        return min((end for end in ends if end is not None), default=None)

    def _surpassed(self, front: Sequence[Member], rank: Rank) -> Sequence[Member]:
        """Return the members of a front that a new one with this rank subsumes."""
        surpassed: Sequence[Member] = []
        start, end = self._worse(front, rank)
        if rank.excluded:
            for one in front[start:end] if rank.values else ():
                better = slice(*self._better(front, one.rank))
                rivals = [other.rank for other in front[better] if other is not one and other not in surpassed]
                if self.ranking.covers([*rivals, rank], one.rank):
                    surpassed = [*surpassed, one]
        elif len(rank.values) == SORTED:  # the better the first value, the worse the second
            if self.ranking.above_watermark and self.watermark is not None:
                count = 1
                while count < len(front) and front[count].rank.values[1] >= -self.watermark:
                    count += 1
                surpassed = front[: count - 1]
            start = end
            while start > len(surpassed) and front[start - 1].rank.values[1] <= rank.values[1]:
                start -= 1
            surpassed = [*surpassed, *front[start:end]]
        else:
            surpassed = [one for one in front[start:end] if all(map(ge, rank.values, one.rank.values))]
        return surpassed

    def _better(self, front: Sequence[Member], rank: Rank) -> tuple[int, int]:
        """Return the slice of a front with all members that may be at least as good."""
        values, extent = rank.values, self.ranking.extent
        if not values:
            return 0, len(front)
        end = len(front) if extent is None else bisect_right(front, -values[extent.end], key=_first)
        return bisect_left(front, values[0], key=_first), end

    def _worse(self, front: Sequence[Member], rank: Rank) -> tuple[int, int]:
        """Return the slice of a front with the members that are compared with a better one.

        A member that begins more than a window earlier is not compared.
        """
        values, extent = rank.values, self.ranking.extent
        if not values:
            return 0, len(front)
        start = 0 if extent is None else bisect_left(front, -values[extent.end] - extent.most, key=_first)
        return start, bisect_right(front, values[0], key=_first)

    def remove(self, number: int) -> None:
        """Remove a member, if present."""
        member = self.members.pop(number, None)
        if member is None:
            return
        if member.rank is not UNRANKED:
            rank = member.rank
            front = self._fronts[rank.place]
            at = bisect_left(front, rank.values[0], key=_first) if rank.values else 0
            while front[at] is not member:
                at += 1
            del front[at]
            if not front:
                del self._fronts[rank.place]
        for (names, term), ordered in self._ordered.items():
            place, kind, value = _lane(names, term, member) or (None, (), None)
            if place in ordered:  # a value that equals nothing is not indexed
                lane = ordered[place][kind]
                del lane[bisect_left(lane, (value, member.number))]
                if not lane:
                    del ordered[place][kind]
                    if not ordered[place]:
                        del ordered[place]

    def forget(self, watermark: int) -> None:
        """Set the watermark and remove the members that it rules out."""
        self.watermark = watermark
        ending = self._ending
        if ending is None:
            ending = self._ending = []
            for member in self.members.values() if self._deadlines else ():
                end = self._end(member.binding)
                if end is not None:
                    heappush(ending, (end, member.number))
        while ending and ending[0][0] < watermark:
            self.remove(heappop(ending)[1])

    def between(
        self,
        names: tuple[str, ...],
        values: Sequence[Json],
        term: Term | None,
        bounds: Sequence[Bound],
        event: Mapping[str, Json],
    ) -> list[tuple[list[LaneMember], int, int]]:
        """Return the members with these values and bounds, as slices of sorted lists."""
        ordered = self._ordered.get((names, term))
        if ordered is None:
            ordered = self._ordered[names, term] = {}
            for member in self.members.values():
                self._put_ordered(names, term, ordered, member)
        found = []
        tests = [(bound.rising, bound.by(event)) for bound in bounds]
        for kind, lane in ordered.get(place_of(values), {}).items():
            start, end = 0, len(lane)
            for rising, holds in tests if kind[:1] != (LOOSE,) else ():
                if rising:
                    start = max(start, _turn(lane, holds, wanted=True))
                else:
                    end = min(end, _turn(lane, holds, wanted=False))
            if start < end:
                found.append((lane, start, end))
        return found

    def _put_ordered(
        self, names: tuple[str, ...], term: Term | None, ordered: dict[_Place, _Lanes], member: Member
    ) -> None:
        found = _lane(names, term, member)
        if found is not None:
            place, kind, value = found
            insort(ordered.setdefault(place, {}).setdefault(kind, []), LaneMember(value, member.number, member))


def _first(member: Member) -> Json:
    return member.rank.values[0]


def _lane(
    names: tuple[str, ...], term: Term | None, member: Member
) -> tuple[_Place, tuple[Hashable, ...], Json] | None:
    binding = member.binding
    values = [binding[name] for name in names]
    place = place_of(values) if values else ()
    if term is None:
        return place, (), 0
    value = term.value(binding)
    kind = scale(value) or (LOOSE if is_number(value) and value - value == 0 else None)
    return None if kind is None else (place, (kind, *map(exact, values)), value)


def _turn(lane: Sequence[LaneMember], holds: Callable[[Json], bool], *, wanted: bool) -> int:
    """Return the first index from which `holds` is `wanted`, searching from the recent end."""
    if holds(lane[0].value) is wanted:
        return 0
    step, end = 1, len(lane)
    start = end - 1
    while start > 0 and holds(lane[start].value) is wanted:
        end = start
        start -= step
        step = 2 * step if step < NEAR else end
    start = max(start, 0)
    while start + 1 < end:
        middle = (start + end) // 2
        if holds(lane[middle].value) is wanted:
            end = middle
        else:
            start = middle
    return end


def in_order(entries: Sequence[LaneMember], start: int, end: int, *, last_first: bool) -> Iterator[Member]:
    """Iterate over the members of a slice."""
    places = range(end - 1, start - 1, -1) if last_first else range(start, end)
    return (entries[place].member for place in places)
