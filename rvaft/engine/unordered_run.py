"""The steps of one unit on the state of an instance, if times may decrease.

Of two matches of a node, one that lies within the other can do all that the other can. So a node
keeps a *front*: matches of which none lies within another, sorted by their starts. In a log in order
only the last of a front can be the best partner of an event; otherwise those that end after it, too.

A match inside a later child of a sequence also needs its first position, and one of the children
before such a child its last: of these, only matches that are as good in this respect are dropped.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Hashable, Iterable, Sequence
from heapq import nlargest
from itertools import pairwise
from typing import Any, Final, TypeAlias

from rvaft.core.units import Op, PositionUse, Unit, UnitLeaf
from rvaft.engine.unit_run import EVENTS, HEAD, TIME, WATERMARK, CountedEvent, FrontRun, Match, Remembered, State, Take
from rvaft.support.budget import StepWork

Front: TypeAlias = list[Match]
_NONE: Final[Sequence[Match]] = ()


class UnorderedRun(FrontRun):
    """A match has its first position, least time, steps, greatest time and last position."""

    def __init__(self, unit: Unit, effort: StepWork) -> None:
        super().__init__(unit)
        self._effort = effort
        self._inside, self._followed = PositionUse.of(unit)
        self.takes = {leaf.node: self._taking(leaf) for leaf in unit.leaves}

    def _taking(self, leaf: UnitLeaf) -> Take:
        return lambda state, position, time, values: self._take(state, leaf, position, time, values)

    def _take(self, state: State, leaf: UnitLeaf, position: int, time: Any, values: Any) -> Match | None:
        """Take an event if it may be in a match, and return a match of the unit that it completes."""
        node, after = leaf.node, leaf.after
        if after >= 0 and not state[HEAD + after]:
            return None
        if time is not None and (state[TIME] is None or state[TIME] < time):
            state[TIME] = time
        if self.remembers:
            self._remember(state, (position, time, node, values))
        if self.unit.settled[node] and self.is_over(state, node):
            return None
        if leaf.number > 1:
            matches = self._count(state, leaf, (position, time, 0, values))
        else:
            matches = [(position, time, (node, position, values), time, position)]
        return self._rise(state, node, matches)

    def _remember(self, state: State, event: Remembered) -> None:
        events = state[EVENTS]
        if events is None:
            events = state[EVENTS] = []
        events.append(event)
        window = self.unit.window
        if window is not None and state[WATERMARK] is not None and events[0][1] < state[WATERMARK] - window:
            least = state[WATERMARK] - window
            events[:] = [one for one in events if one[1] >= least]

    def concerning(self, state: State) -> Iterable[Remembered]:
        """Return the remembered events that a window around the last event has."""
        events, window = state[EVENTS] or [], self.unit.window
        if window is None or not events:
            return events
        time = events[-1][1]
        return [one for one in events if time - window <= one[1] <= time + window]

    def _count(self, state: State, leaf: UnitLeaf, event: CountedEvent) -> list[Match]:
        """Add an event to those of a counted leaf, by time; return the matches with it.

        The third value of an event is the number of events to the last one that came in turn.
        """
        count, (container, name) = leaf.number, self.place_of(state, leaf, event[3])
        events: list[CountedEvent] = (container.get(name) if leaf.own else container[name]) or []
        limit, time = self.unit.limits[leaf.node], event[1]
        if limit is None:
            events = [*events[1 - count :], event]
            container[name] = events
            if len(events) < count:
                return []
            return [(events[0][0], None, (leaf.node, events, count), None, event[0])]
        place = len(events)
        if state[WATERMARK] is not None and events and events[place // 2][1] < state[WATERMARK] - limit:
            events = events[place // 2 + 1 :]
            place = len(events)
        if events and time < events[-1][1]:
            place = bisect_right(events, time, key=_time)
            last = (*events[-1][:2], 0, events[-1][3])
            events = [*events[:place], event, *events[place:-1], last]  # matches keep the list that they refer to
        else:
            in_turn = events[-1][2] + 1 if events else 1
            events.append((event[0], time, in_turn, event[3]))
            if in_turn >= count and len(events) >= count:
                first = events[-count]
                container[name] = events
                match = (first[0], first[1], (leaf.node, events, len(events)), time, event[0])
                return [match] if time - first[1] <= limit else []
        container[name] = events
        if not self._inside[leaf.node]:
            return self._windows(leaf, events, place, event[0])
        found, left = list[Match](), events
        while place >= 0:  # the later the first position has to be, the fewer events there are
            firsts = [
                (match, min(one[0] for one in _events(match, count)))
                for match in self._windows(leaf, left, place, event[0])
            ]
            if not firsts:
                break
            found += [(first, *match[1:]) for match, first in firsts]
            least = min(first for _, first in firsts)
            left = [one for one in left if one[0] > least]
            place = next((at for at, one in enumerate(left) if one[0] == event[0]), -1)
        return _best(found, first=True)

    def _windows(self, leaf: UnitLeaf, events: list[CountedEvent], place: int, position: int) -> list[Match]:
        count, limit = leaf.number, self.unit.limits[leaf.node]
        assert limit is not None, "the leaf is in a window"
        found = []
        for start in range(max(0, place - count + 1), min(place, len(events) - count) + 1):
            least, most = events[start][1], events[start + count - 1][1]
            if most - least <= limit:
                found.append((events[start][0], least, (leaf.node, events, start + count), most, position))
        return found if len(found) < 2 else _best(found, first=False)

    def _completed(self, node: int, matches: list[Match]) -> list[Match]:
        window = self.unit.windows[node]
        return matches if window is None else [one for one in matches if one[3] - one[1] <= window]

    def _in_turn(self, state: State, node: int, matches: list[Match]) -> list[Match]:
        gate, op, before, *_ = self.unit.places[node]
        if before < 0:
            return _alone(matches)
        front = state[HEAD + before] or _NONE
        later = op is Op.SEQUENCE and not self.unit.direct[node]
        return self._joined(
            [(one, other) for one in matches for other in self._partners(front, one, gate, later=later)], gate
        )

    def _chosen(self, matches: list[Match], fronts: Sequence[Front], need: int, node: int) -> list[Match]:
        gate = self.unit.places[node].gate
        limit, matches = self.unit.limits[gate], _alone(matches)
        if limit is None:
            fronts = fronts[:need]
        if len(fronts) == need:
            for front in fronts:
                pairs = [(other, one) for one in matches for other in self._partners(front, one, gate)]
                matches = self._joined(pairs, gate, before=False)
            return matches
        if len(matches) == 1 and not self._inside[gate] and all(front[-1][3] <= matches[0][3] for front in fronts):
            (match,) = matches
            partners = nlargest(need, [front[-1] for front in fronts], key=_time)
            least = min([match[1], *[one[1] for one in partners]])
            if match[3] - least > limit:
                return []
            first = min([match[0], *[one[0] for one in partners]])
            return [(first, least, (*match[2], *[one[2] for one in partners]), match[3], match[4])]
        chosen: list[list[Match]] = [matches, *([] for _ in range(need))]
        for front in fronts:
            for number in range(need, 0, -1):
                pairs = [(other, one) for one in chosen[number - 1] for other in self._partners(front, one, gate)]
                chosen[number] = self._best_of([*chosen[number], *self._joined(pairs, gate, before=False)], gate)
        return chosen[need]

    def _joined(self, pairs: Sequence[tuple[Match, Match]], gate: int, *, before: bool = True) -> list[Match]:
        """Return the joint matches of pairs within the limit: of the children before, and of one more."""
        limit, found = self.unit.limits[gate], list[Match]()
        self._effort.spend(len(pairs), "ways to join matches")
        for pair in pairs:
            other, one = pair if before else pair[::-1]
            if limit is None:
                least, most = None, None
            else:
                least, most = min(one[1], other[1]), max(one[3], other[3])
                if most - least > limit:
                    continue
            steps = (*one[2], other[2]) if before else (*other[2], one[2])
            found.append((min(one[0], other[0]), least, steps, most, max(one[4], other[4])))
        return self._best_of(found, gate)

    def _best_of(self, found: list[Match], gate: int) -> list[Match]:
        if len(found) < 2:
            return found
        return found[:1] if self.unit.limits[gate] is None else _best(found, first=self._inside[gate])

    def _partners(self, front: Sequence[Match], match: Match, gate: int, *, later: bool = False) -> Sequence[Match]:
        """Return the matches of a front with which a match may be joined best.

        With `later`, they have to end before it begins.
        """
        limit = self.unit.limits[gate]
        if not front or limit is None:
            return front[:1]  # events were taken only after it
        if self._inside[gate] or later:
            return self._partners_of_positions(front, match, limit, first=self._inside[gate], later=later)
        if front[-1][3] <= match[3]:
            return front[-1:]
        end = bisect_right(front, match[3], key=_end) - 1
        start = bisect_left(front, match[1], key=_time)
        return front[end : end + 1] if 0 <= start <= end else front[max(end, 0) : start + 1]

    def _partners_of_positions(
        self, front: Sequence[Match], match: Match, limit: int, *, first: bool, later: bool
    ) -> Sequence[Match]:
        found = []
        for place in range(len(front) - 1, -1, -1):
            one = front[place]
            if one[1] < match[3] - limit:
                break
            if one[3] <= match[1] + limit and (not later or one[4] < match[0]):
                found.append(one)
                if not first and one[3] <= match[3]:
                    break  # the others start earlier
        return found

    def _add(self, state: State, node: int, match: Match) -> bool:
        """Add a match to the front of a node unless another lies within it."""
        slot = HEAD + node
        front = state[slot]
        if front is None:
            state[slot] = [match]
            return True
        gate = self.unit.places[node].gate
        limit = self.unit.limits[gate]
        if limit is None:
            return False
        place = len(front) if not front or front[-1][1] < match[1] else bisect_left(front, match[1], key=_time)
        first, last = self._inside[gate], self._followed[node]
        for other in range(place, len(front)):
            one = front[other]
            if one[3] <= match[3] and (not first or one[0] >= match[0]):
                return False
            if not first and not last:
                break  # the others end later
            if one[1] > match[3]:
                break
        end = place
        if not last:
            while end < len(front) and front[end][1] == match[1] and front[end][3] >= match[3] and not first:
                end += 1
            while place and front[place - 1][3] >= match[3] and (not first or front[place - 1][0] <= match[0]):
                place -= 1
        front[place:end] = [match]
        if state[WATERMARK] is not None:
            self._forget(front, state[WATERMARK], limit, ends=not first and not last)
        return True

    def _forget(self, front: Front, watermark: int, limit: int, *, ends: bool) -> None:
        """Remove the matches that start too early; of those that end below the watermark, the last is the best."""
        count = 0
        for one, other in pairwise(front):
            if one[1] >= watermark - limit and not (ends and other[3] <= watermark):
                break
            count += 1
        if count:
            del front[:count]

    def alive(self, found: Front, least: int) -> bool:
        """Whether a match starts at this time or later."""
        return any(match[1] >= least for match in found)

    def future(self, state: State) -> Hashable:
        """Return the times of matches and counted events, and the order of positions where it matters."""
        found: list[list[Sequence[Any]]] = []
        for node, (gate, *_) in enumerate(self.unit.places):
            first, last = gate >= 0 and self._inside[gate], self._followed[node]
            found.append(
                [(one[1], one[3], one[0] if first else -1, one[4] if last else -1) for one in state[HEAD + node] or ()]
            )
        counted = []
        for leaf in self.unit.leaves:
            if leaf.number > 1:
                inside, least = self._inside[leaf.node], 1 - leaf.number if self.unit.limits[leaf.node] is None else 0
                for name, events in self.events_of(state, leaf).items():
                    counted.append((leaf.node, name))
                    found.append([(one[1], one[0] if inside else -1) for one in events[least:]])
        positions = {position for some in found for one in some for position in one[len(one) // 2 :]}
        rank = {position: number for number, position in enumerate(sorted(positions))}
        times = tuple(
            tuple([(*one[: len(one) // 2], *map(rank.__getitem__, one[len(one) // 2 :])) for one in some])
            for some in found
        )
        size = len(self.unit.places)
        return times[:size], frozenset(zip(counted, times[size:], strict=True)), -1 in positions

    def kept(self, state: State) -> int:
        """Return the number of matches and counted events of a state."""
        remembered = len(state[EVENTS] or ())
        fronts = remembered + sum(len(one) for one in state[HEAD : HEAD + len(self.unit.places)] if one is not None)
        counted = (self.events_of(state, leaf).values() for leaf in self.unit.leaves if leaf.number > 1)
        return fronts + sum(len(events) for some in counted for events in some)


def _time(match: Sequence[Any]) -> Any:
    return match[1]


def _end(match: Match) -> Any:
    return match[3]


def _alone(matches: Sequence[Match]) -> list[Match]:
    """Return matches of a child as matches of its gate."""
    return [(one[0], one[1], (one[2],), one[3], one[4]) for one in matches]


def _events(match: Match, count: int) -> list[CountedEvent]:
    _, events, end = match[2]
    return list(events[end - count : end])


def _best(matches: Sequence[Match], *, first: bool) -> list[Match]:
    """Return the matches within which no other lies, or none that begins later if `first`."""
    found = list[Match]()
    for match in sorted(matches, key=lambda one: (-one[1], one[3], -one[0])):
        if not any(other[3] <= match[3] and (not first or other[0] >= match[0]) for other in reversed(found)):
            found.append(match)
    return found
