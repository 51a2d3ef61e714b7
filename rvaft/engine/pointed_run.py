"""The steps of one unit on the state of an instance, if guards bound its time points.

A match of a node has its first position, its least time, its steps, its greatest time, the values of
the time points that a bound above needs, and the matches of the sequence before it as they were when
its first event came. A node keeps a *front*: the matches that no other match replaces. A match
replaces another one if it is at least as good in each respect that matters at its node:

- its first position, in a later child of a sequence: the later, the better;
- its least and its greatest time, for windows and for time points of nodes above;
- each value of a time point: the smaller, the better, if only `plus - minus <= most` bounds it as
  `plus`; the greater, if only as `minus`; else only equal values are comparable.

A bound is decided when its lowest common node is complete. In a log in order, the greatest time of a
match above is that of a later event. Under a time point, a gate with a threshold may keep further
children, because these may move the point.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from heapq import nlargest
from operator import ge
from typing import Any, Final, TypeAlias

from rvaft.core.units import Op, Unit, UnitLeaf
from rvaft.engine.unit_run import EVENTS, HEAD, TIME, WATERMARK, FrontRun, Match, Remembered, State, Take
from rvaft.errors import TooLarge
from rvaft.support.budget import StepWork

Front: TypeAlias = tuple[Match, ...]
Merits: TypeAlias = Callable[[Match], tuple[Any, ...]]
"""The values of a match of which the greater are better."""
REMEMBERED: Final = 2_000
"""The maximum number of events of an instance that are remembered for its branches."""
FORGOTTEN: Final = -1
"""The position, and the node, of an entry in place of events that are remembered no more."""


class PointedRun(FrontRun):
    """The steps where times never decrease (`ordered`), or may decrease."""

    def __init__(self, unit: Unit, effort: StepWork, *, ordered: bool, remedy: str) -> None:
        super().__init__(unit)
        self._effort, self._ordered, self._remedy = effort, ordered, remedy
        size = len(unit.places)
        self._own: list[list[int]] = [[] for _ in range(size)]
        """The time points of each node."""
        self._bounds: list[list[tuple[int, int, int]]] = [[] for _ in range(size)]
        """The bounds that the matches of each node decide."""
        signs: list[set[int]] = [set() for _ in unit.points]
        for place, point in enumerate(unit.points):
            self._own[point.node].append(place)
        for top, plus, minus, most in unit.bounds:
            self._bounds[top].append((plus, minus, most))
            signs[plus].add(-1)
            signs[minus].add(1)
        self._signs = [tuple(sorted(found)) for found in signs]
        self._live = self._live_points()
        self._above = [self._points_above(node, signs) for node in range(size)]
        """For each node, the signs of the least and of the greatest time for time points above it."""
        self._moving = [any(self._own[above] for above in self._path(node)) for node in range(size)]
        """Whether each node is one with a time point, or below one."""
        self._timed = [unit.limits[node] is not None or self._moving[node] for node in range(size)]
        inside = [False] * size
        for node in range(1, size):
            gate, op, before, *_ = unit.places[node]
            inside[node] = inside[gate] or (op is Op.SEQUENCE and before >= 0 and not unit.direct[node])
        self._merits = [self._merits_of(node, first=inside[node]) for node in range(size)]
        gates = [max(place.gate, 0) for place in unit.places]
        self._stored = [self._merits_of(node, first=inside[gates[node]]) for node in range(size)]
        self._deadlines = [self._deadlines_of(node) for node in range(size)]
        self.takes = {leaf.node: self._taking(leaf) for leaf in unit.leaves}

    def _path(self, node: int) -> list[int]:
        """Return a node and the nodes above it, in this order."""
        found = [node]
        while self.unit.places[found[-1]].gate >= 0:
            found.append(self.unit.places[found[-1]].gate)
        return found

    def _live_points(self) -> list[frozenset[int]]:
        """Return for each node the time points at and below it that a bound above it needs."""
        found = [set[int]() for _ in self.unit.places]
        for top, plus, minus, _ in self.unit.bounds:
            for place in (plus, minus):
                path = self._path(self.unit.points[place].node)
                for node in path[: path.index(top)]:
                    found[node].add(place)
        return [frozenset(some) for some in found]

    def _points_above(self, node: int, signs: Sequence[Iterable[int]]) -> tuple[frozenset[int], frozenset[int]]:
        least, greatest = set[int](), set[int]()
        for above in self._path(node)[1:]:
            for place in self._own[above]:
                (least if self.unit.points[place].start else greatest).update(signs[place])
        return frozenset(least), frozenset(greatest)

    def _merits_of(self, node: int, *, first: bool) -> Merits:
        """Return the function to the values in which a match of a node, or of its elder siblings too, is better."""
        gate = max(self.unit.places[node].gate, 0)
        least, greatest = ({*signs} for signs in self._above[node])
        if self.unit.limits[gate] is not None:
            least.add(1)
            greatest.add(-1)
        if self._ordered:
            greatest.clear()
        least_signs, greatest_signs, signs = tuple(least), tuple(greatest), self._signs

        def merits(match: Match) -> tuple[Any, ...]:
            found = [match[0]] if first else []
            found += [sign * match[1] for sign in least_signs]
            found += [sign * match[3] for sign in greatest_signs]
            found += [sign * value for place, value in match[4] for sign in signs[place]]
            return tuple(found)

        return merits

    def _deadlines_of(self, node: int) -> tuple[tuple[int, int], ...]:
        """Return the time points in the matches up to a child of a sequence that a later point must follow in time.

        Each has the greatest duration between the two. The later point is one of a later child, of which
        all events have yet to come.
        """
        gate, op, _, _, siblings, _ = self.unit.places[node]
        if gate < 0 or op not in (Op.SEQUENCE, Op.ENDS):
            return ()
        found, slot = list[tuple[int, int]](), siblings.index(node)
        for _, plus, minus, most in self.unit.bounds:
            paths = [self._path(self.unit.points[place].node) for place in (plus, minus)]
            places = [next((siblings.index(one) for one in path if one in siblings), -1) for path in paths]
            last = op is Op.SEQUENCE or not self.unit.points[plus].start
            if 0 <= places[1] <= slot < places[0] and last:
                found.append((minus, most))
        return tuple(found)

    def _taking(self, leaf: UnitLeaf) -> Take:
        remember = self._remembering(leaf) if self.remembers else None

        def take(state: State, position: int, time: Any, values: Any) -> Match | None:
            before: Front = ()
            if leaf.after >= 0:
                before = state[HEAD + leaf.after] or ()
                if not before:
                    return None
            if time is not None and (state[TIME] is None or state[TIME] < time):
                state[TIME] = time
            if remember is not None:
                remember(state, (position, time, leaf.node, values))
            match = (position, time, (leaf.node, position, values), time, (), before)
            return self._rise(state, leaf.node, [match])

        return take

    def _remembering(self, leaf: UnitLeaf) -> Callable[[State, Remembered], None]:
        """Return the function that remembers an event with which some branch may have a match.

        Where a later event is at least as good, it serves instead of an earlier one, unless another came
        that must follow; where an earlier one is, the later one is not needed, unless another came that
        must precede it.
        """
        unit, node = self.unit, leaf.node
        signs = set[int]()
        for above in self._path(node):
            signs.update(sign for place in self._own[above] for sign in self._signs[place])
        limit, timed = unit.limits[node], self._timed[node]
        later = signs <= {1} and (limit is None or limit == unit.window)
        earlier = signs == {-1} and limit is None
        replaces = later or earlier
        if timed and not self._ordered:
            replaces = False
        others = unit.younger[node] if later else unit.elders[node]

        def remember(state: State, event: Remembered) -> None:
            events = state[EVENTS]
            if events is None:
                events = state[EVENTS] = []
            window = unit.window
            if window is not None and state[WATERMARK] is not None and events and events[0][1] is not None:
                least = state[WATERMARK] - window
                if events[0][1] < least:
                    events[:] = [one for one in events if one[1] is None or one[1] >= least]
            for place in range(len(events) - 1, -1, -1) if replaces else ():
                one = events[place][2]
                if one == node:
                    if not later:
                        return
                    del events[place]
                    break
                if one >= 0 and others >> one & 1:
                    break
            events.append(event)
            if len(events) > REMEMBERED:
                events[: REMEMBERED // 2] = [(FORGOTTEN, None, FORGOTTEN, None)]

        return remember

    def concerning(self, state: State) -> Iterable[Remembered]:
        """Return the remembered events; raises `TooLarge` if some are forgotten."""
        events: list[Remembered] = state[EVENTS] or []
        if events and events[0][2] == FORGOTTEN:
            raise TooLarge("events that a branch may need", limit=REMEMBERED, remedy=self._remedy)
        return events

    def _in_turn(self, state: State, node: int, matches: list[Match]) -> list[Match]:
        gate, op, before, *_ = self.unit.places[node]
        if before < 0:
            return matches
        present = op is Op.ENDS or self.unit.direct[node]
        fronts = ((one, (state[HEAD + before] or ()) if present else one[5]) for one in matches)
        pairs = [(other, one) for one, front in fronts for other in front]
        return self._best(self._joined(pairs, gate), self._stored[node])

    def _completed(self, node: int, matches: list[Match]) -> list[Match]:
        """Return the matches of a node that satisfy its window and bounds, with the values that are needed above."""
        window, own, bounds, live = self.unit.windows[node], self._own[node], self._bounds[node], self._live[node]
        if window is not None:
            matches = [one for one in matches if one[3] - one[1] <= window]
        if own or bounds:
            found = list[Match]()
            for one in matches:
                values = dict(one[4])
                values.update((place, one[1] if self.unit.points[place].start else one[3]) for place in own)
                if all(values[plus] - values[minus] <= most for plus, minus, most in bounds):
                    kept = tuple(sorted((place, value) for place, value in values.items() if place in live))
                    found.append((*one[:4], kept, one[5]))
            matches = found
        return self._best(matches, self._merits[node])

    def _chosen(self, matches: list[Match], fronts: Sequence[Front], need: int, node: int) -> list[Match]:
        """Join matches of a node with matches of `need` siblings, below a time point perhaps of more."""
        gate = self.unit.places[node].gate
        merits, more = self._stored[node], self._moving[gate]
        if len(fronts) > need and len(merits(matches[0])) < 2:  # each front has its best match
            best = nlargest(max(need, more), [front[0] for front in fronts], key=merits)
            found = [whole for one in matches if (whole := self._whole(one, best[:need], gate)) is not None]
            if need < len(best):
                found += [whole for one in matches if (whole := self._whole(one, best, gate)) is not None]
            return self._best(found, merits)
        if len(fronts) == need:
            single = [front[0] for front in fronts if len(front) == 1]
            matches = [whole for one in matches if (whole := self._whole(one, single, gate)) is not None]
            for front in fronts:
                if len(front) > 1:
                    pairs = [(other, one) for one in matches for other in front]
                    matches = self._best(self._joined(pairs, gate), merits)
            return matches
        chosen: list[list[Match]] = [matches, *([] for _ in range(need))]
        for front in fronts:
            for number in range(need, -1 if more else 0, -1):
                from_ = chosen[number - 1] if number else []
                if more and number == need:
                    from_ = [*from_, *chosen[need]]
                pairs = [(other, one) for one in from_ for other in front]
                chosen[number] = self._best([*chosen[number], *self._joined(pairs, gate)], merits)
        return chosen[need]

    def _whole(self, match: Match, others: Sequence[Match], gate: int) -> Match | None:
        """Return the joint match of one and others, or None if they do not fit into the windows above."""
        if not others:
            return match
        limit, all_ = self.unit.limits[gate], (match, *others)
        least = most = None
        if self._timed[gate]:
            least, most = min([one[1] for one in all_]), max([one[3] for one in all_])
            if limit is not None and most - least > limit:
                return None
        first = min(all_, key=_first)
        values = tuple(sorted([pair for one in all_ for pair in one[4]]))
        return first[0], least, tuple([one[2] for one in all_]), most, values, first[5]

    def _joined(self, pairs: Sequence[tuple[Match, Match]], gate: int) -> list[Match]:
        """Return the joint matches of pairs within the windows above."""
        self._effort.spend(len(pairs), "ways to join matches")
        limit, timed, found = self.unit.limits[gate], self._timed[gate], list[Match]()
        for one, other in pairs:
            least = most = None
            if timed:
                least, most = min(one[1], other[1]), max(one[3], other[3])
                if limit is not None and most - least > limit:
                    continue
            first = one if one[0] < other[0] else other
            values = tuple(sorted((*one[4], *other[4]))) if one[4] and other[4] else one[4] or other[4]
            found.append((first[0], least, (one[2], other[2]), most, values, first[5]))
        return found

    def _best(self, matches: list[Match], merits: Merits) -> list[Match]:
        """Return the matches that no other one replaces."""
        if len(matches) < 2:
            return matches
        found = list[tuple[tuple[Any, ...], Match]]()
        for own, match in sorted(((merits(one), one) for one in matches), key=_merits, reverse=True):
            if not any(all(map(ge, other, own)) for other, _ in found):
                found.append((own, match))
        return [match for _, match in found]

    def _add(self, state: State, node: int, match: Match) -> bool:
        """Add a match to the front of a node unless another one replaces it."""
        front: Front = state[HEAD + node] or ()
        merits = self._stored[node]
        own = merits(match)
        kept = list[Match]()
        watermark = state[WATERMARK]
        for one in front:
            others = merits(one)
            if all(map(ge, others, own)):
                return False
            if not all(map(ge, own, others)) and (watermark is None or self._lives(one, node, watermark)):
                kept.append(one)
        state[HEAD + node] = (*kept, match)
        return True

    def _lives(self, match: Match, node: int, watermark: int) -> bool:
        """Whether later events can complete a match of a node."""
        limit = self.unit.limits[max(self.unit.places[node].gate, 0)]
        if limit is not None and match[1] < watermark - limit:
            return False
        deadlines = self._deadlines[node]
        return not deadlines or all(dict(match[4])[place] + most >= watermark for place, most in deadlines)

    def expires(self, state: State, watermark: int) -> bool:
        """Drop the matches that later events cannot complete; return whether none is left."""
        left = False
        for node in range(len(self.unit.places)):
            front: Front | None = state[HEAD + node]
            if front:
                kept = tuple([one for one in front if self._lives(one, node, watermark)])
                state[HEAD + node] = kept
                left = left or bool(kept)
        return not left

    def alive(self, found: Front, least: int) -> bool:
        """Whether a match starts at this time or later."""
        return any(match[1] is None or match[1] >= least for match in found)

    def kept(self, state: State) -> int:
        """Return the number of matches of a state."""
        return sum(len(one) for one in state[HEAD : HEAD + len(self.unit.places)] if one is not None)

    def future(self, state: State) -> Hashable:
        """Return the times of the matches, and the order of their first positions."""
        fronts: list[Front | None] = state[HEAD : HEAD + len(self.unit.places)]
        found, agenda = dict[int, Front](), [front for front in fronts if front]
        while agenda:
            front = agenda.pop()
            if id(front) not in found:
                found[id(front)] = front
                agenda += [one[5] for one in front if one[5]]
        positions = sorted({one[0] for front in found.values() for one in front})
        rank = {position: number for number, position in enumerate(positions)}
        known: dict[int, Hashable] = {}

        def of(front: Front | None) -> Hashable:
            if not front:
                return ()
            if id(front) not in known:
                known[id(front)] = tuple((rank[one[0]], one[1], one[3], one[4], of(one[5])) for one in front)
            return known[id(front)]

        return tuple(map(of, fronts))


def _first(match: Match) -> Any:
    return match[0]


def _merits(one: tuple[tuple[Any, ...], Match]) -> tuple[Any, ...]:
    return one[0]
