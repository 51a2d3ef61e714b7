"""Near misses: why nothing was detected.

Each condition of the tree is left out in turn, and the engine monitors what remains (`relaxation`). So
each near miss is true by the meaning of trees: but for this condition the log has a detection.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, combinations, pairwise
from random import Random
from typing import Final, assert_never, cast

from rvaft.core.restriction import property_of
from rvaft.diagnosis.relaxation import Lack, Relaxation, can_leave_out, relaxations, with_count, without_events
from rvaft.engine.monitor import Engine
from rvaft.engine.selection import strategy_of
from rvaft.errors import TooLarge, TreeError
from rvaft.model.event_time import UNITS, duration_text
from rvaft.model.expressions import event_text, guard_text, without_text
from rvaft.model.guards import COMPARISONS, Guard, Operation, conjuncts, time_points, value
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Gate
from rvaft.model.patterns import Anything, match
from rvaft.model.tree import RVAFT, reachable, resolve_semantics
from rvaft.model.values import Json, fingerprint, is_number
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DEFAULT_LIMIT, Explanation, Repetition
from rvaft.rules.validity import valid_part
from rvaft.stream.detection import places
from rvaft.support.plugins import display
from rvaft.support.terminal import readable_json
from rvaft.support.wording import listing

EVENTS: Final = 10_000
"""The number of the last events that are looked at."""
WORK: Final = 500_000
"""The maximum number of events that all relaxed trees together read, with what their nodes cost."""
_NODE: Final = 50
"""The number of events whose reading takes as long as to make a monitor of a node."""
SHOWN: Final = 5
"""The number of near misses that are shown."""
_CLOSE: Final = 0.4
"""Where nothing is closer, what lacks two conditions is looked for."""
LISTED: Final = 5
"""The number of events whose numbers are all shown."""
_FAR: Final = 0.8
"""Matches at a greater distance are left out where there is a closer one."""
_DETECTIONS: Final = 2_000
"""The maximum number of detections of a relaxed tree that are compared."""
_LEVELS: Final = 4
"""How many counts below the greatest are looked at, for other values of the variables."""
_UNMEASURED: Final = 0.5
"""The distance of what has no measure: an order, a text in a guard, an event that had to be absent."""


@dataclass(frozen=True, slots=True)
class NearMiss:
    """A match of the tree but for one condition.

    `text` says what lacks, and `explanation` has the events that came, by their numbers in the log. `distance`
    is a measure between 0 and 1, for which smaller is closer. `tree` is the relaxed tree, of which the
    explanation is a match. `log` is the place of the log among several.
    """

    text: str
    lack: Lack
    node: str
    explanation: Explanation
    distance: float
    tree: RVAFT = field(repr=False)
    log: int = 0

    def line(self, tree: RVAFT, at: Mapping[int, Json]) -> str:
        """Return the near miss in a line, with the values of variables; `at` has the events by number."""
        parts = [f"{name} = {readable_json(value)}" for name, value in self.explanation.bound(tree).items()]
        first, last = self.events[0], self.events[-1]
        shown = [places(at[one], tree).get("time") for one in (first, last) if tree.time and one in at]
        times = [_time(one) for one in shown] if None not in shown else []
        if first == last:
            parts.append(f"event {first}{''.join(f' at {time}' for time in times[:1])}")
        else:
            listed = ", ".join(map(str, self.events)) if len(self.events) <= LISTED else f"{first} to {last}"
            parts.append(f"events {listed}{f' ({times[0]} to {times[1]})' if times[1:] else ''}")
        return f"{self.text}: {', '.join(parts)}"

    @property
    def matched(self) -> frozenset[tuple[str, int]]:
        """The events that came, each with its node."""
        return frozenset((one.node, one.event) for one in self.explanation.matched)

    @property
    def events(self) -> list[int]:
        """The numbers of the events that came, in order."""
        return sorted({one.event for one in self.explanation.matched})


@dataclass(frozen=True, slots=True)
class NearMisses:
    """The near misses, closest first, and the nodes for which not all were looked for, which would take too long."""

    found: tuple[NearMiss, ...]
    skipped: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        return cast("str", display("near_misses")(self))


def near_misses(
    tree: RVAFT,
    events: Iterable[Json] | Iterable[tuple[int, Json]],
    *,
    semantics: Semantics | str | None = None,
    branch: int | None = None,
    limit: int = 10,
    numbered: bool = False,
) -> NearMisses:
    """Return what comes closest to a detection among the last events.

    Events are `numbered` if each comes after its number. Raises the errors of `monitor`.

    >>> import rvaft
    >>> tree = rvaft.loads("time t as s; top sand a b within 5 s;")
    >>> log = [{"event": "a", "t": 1}, {"event": "b", "t": 8}]
    >>> [miss.text for miss in near_misses(tree, log, semantics="scattered").found]
    ['top took 2 s longer than 5 s']
    """
    part, meaning = valid_part(tree, branch), resolve_semantics(tree, semantics)
    pairs: Iterable[tuple[int, Json]] = events if numbered else enumerate(events, 1)
    return NearMissSearch(part, meaning, [list(pairs)[-EVENTS:]]).result(limit)


class NearMissSearch:
    """The search for near misses among the numbered events of some logs, each monitored on its own."""

    def __init__(self, tree: RVAFT, semantics: Semantics, logs: Sequence[Sequence[tuple[int, Json]]]) -> None:
        self.tree, self.semantics, self.logs = tree, semantics, logs
        self.at = [dict(log) for log in logs]
        self.size = sum(map(len, logs))
        self.left = WORK
        self.skipped: list[str] = []

    def result(self, limit: int) -> NearMisses:
        """Return the closest near misses."""
        never = self._never()
        tree = without_events(self.tree, never) if never else self.tree
        if tree is None or not self.size:
            return NearMisses(())
        found = list(self._found(tree, never))
        if not never and min((miss.distance for miss in found), default=1.0) > _CLOSE:
            found += self._pairs(found)
        found.sort(key=lambda miss: (miss.distance, -miss.events[-1]))
        kept: list[NearMiss] = []
        for miss in found if not found or found[0].distance > _FAR else (one for one in found if one.distance <= _FAR):
            if not any(miss.log == better.log and miss.matched <= better.matched for better in kept):
                kept.append(miss)
            if len(kept) == limit:
                break
        said = (replace(one, text=one.text + self._afterwards(one)) if one.lack is Lack.COUNT else one for one in kept)
        return NearMisses(tuple(said), tuple(dict.fromkeys(self.skipped)))

    def _found(self, tree: RVAFT, never: Sequence[str]) -> Iterator[NearMiss]:
        """Iterate over the near misses that lack these events, or else one condition more."""
        alone = list(self._misses(Relaxation(Lack.EVENT, never[0], tree, tuple(never)))) if never else []
        yield from alone
        if not alone:
            for node in tree.top_down():
                if node.times > 1:
                    yield from self._fewer(tree, node.name, never)
            for one in relaxations(tree):
                yield from self._misses(one, never)

    def _never(self) -> list[str]:
        """Return the nodes for which no event came and that gates ask for: the highest ones."""
        alive = set[str]()
        for node in self.tree.bottom_up():
            came = not node.has_event or self._came(node.name)
            if came and (not node.children or not alive.isdisjoint(node.children)):
                alive.add(node.name)
        found: list[str] = []
        for node in self.tree.top_down():
            lacking = [child for child in node.children if child not in alive]
            if node.threshold is not None:
                lacking = lacking[: max(node.threshold - len(node.children) + len(lacking), 0)]
            if node.name in alive and node.gate is not Gate.OR:
                found += lacking
        return list(dict.fromkeys(found))

    def _came(self, name: str) -> bool:
        pattern = self.tree.pattern(name) or Anything()
        return any(match(pattern, event, {}) is not None for log in self.logs for _, event in log)

    def _pairs(self, found: Iterable[NearMiss]) -> Iterator[NearMiss]:
        """Iterate over the near misses without two nodes, or without a node and with fewer events of another.

        A node without which each log has one of the near misses that are `found` is in no pair.
        """
        alone = {(miss.node, miss.log) for miss in found if miss.lack is Lack.EVENT}
        logs = range(len(self.logs))
        nodes = (node.name for node in self.tree.top_down() if node.name != self.tree.root)
        names = [name for name in nodes if not all((name, log) in alone for log in logs)]
        for name in names:
            rest = without_events(self.tree, [name])
            for leaf in () if rest is None else [node.name for node in rest.top_down() if node.times > 1]:
                yield from self._fewer(rest or self.tree, leaf, [name])
        for pair in self._possible_pairs(names):
            if (rest := without_events(self.tree, pair)) is not None:
                yield from self._misses(Relaxation(Lack.EVENT, pair[0], rest, missing=pair))

    def _possible_pairs(self, names: Sequence[str]) -> Iterator[tuple[str, str]]:
        """Iterate over pairs of nodes that can be left out, except those without which there is no detection.

        If the tree is not detected without a whole group of nodes, it is not without any two of them. So groups are
        tried, in random orders; they are twice as large after each that excludes its pairs, half after another one.
        """
        able = {pair for pair in combinations(names, 2) if can_leave_out(self.tree, pair)}
        able |= {(other, one) for one, other in able}
        pairs = dict.fromkeys(pair for pair in combinations(names, 2) if pair in able)
        order, random, size = list(names), Random(0), len(names) if self._is_monotone else 2  # noqa: S311 (no secret)
        while pairs:
            first = next(iter(pairs))
            group = list(first)
            random.shuffle(order)
            order.sort(key=set(chain.from_iterable(pairs)).__contains__, reverse=True)
            for name in order if size > len(first) else ():
                if len(group) < size and all((one, name) in able for one in group):
                    group.append(name)
            rest = without_events(self.tree, group) if len(group) > len(first) else None
            if rest is not None and self._is_never_detected(rest):
                size = min(2 * size, len(names))
                pairs = dict.fromkeys(pair for pair in pairs if not set(pair) <= set(group))
            elif len(group) > len(first):
                size = max(len(group) // 2, len(first))
            else:
                size = min(2 * size, len(names)) if self._is_monotone else size
                del pairs[first]
                yield first

    @cached_property
    def _is_monotone(self) -> bool:
        """Whether a tree without more nodes is detected wherever one without fewer is."""
        return self.semantics is Semantics.SCATTERED and not any(
            node.without or node.gate is Gate.PAND or next(iter(time_points(node.when)), None) is not None
            for node in self.tree.top_down()
        )

    def _is_never_detected(self, tree: RVAFT) -> bool:
        """Whether a relaxed tree is not detected in any log; False where that is not known."""
        try:
            return next(self._run(tree), None) is None
        except (TreeError, TooLarge):
            return False

    def _fewer(self, tree: RVAFT, leaf: str, never: Sequence[str]) -> Iterator[NearMiss]:
        """Iterate over the matches with the most events of a leaf, for each values of the variables."""
        low, high = 0, tree.nodes[leaf].times
        while high - low > 1:
            middle = (low + high) // 2
            if next(self._detections(with_count(tree, leaf, middle), leaf), None) is None:
                high = middle
            else:
                low = middle
        known = set[Hashable]()
        for count in range(low, max(low - _LEVELS, 0), -1):
            for miss in self._misses(Relaxation(Lack.COUNT, leaf, with_count(tree, leaf, count)), never):
                place = miss.log, fingerprint(miss.explanation.variables)
                if place not in known:
                    known.add(place)
                    yield miss

    def _misses(self, one: Relaxation, never: Sequence[str] = ()) -> Iterator[NearMiss]:
        """Iterate over the closest match of a relaxation for each values of the variables."""
        best: dict[Hashable, NearMiss] = {}
        for log, explanation in self._detections(one.tree, one.node):
            if one.lack is Lack.COUNT and one.node not in explanation.events:
                continue  # another branch, which does not count these events
            text, distance = self._lacking(one, explanation, log)
            if never:
                without, share = self._without(never, explanation)
                text, distance = f"{without}; {text}", share + distance * (1 - share)
            place = log, fingerprint({} if one.lack is Lack.VALUE else explanation.variables)
            if place not in best or distance < best[place].distance:
                best[place] = NearMiss(text, one.lack, one.node, explanation, distance, one.tree, log)
        yield from best.values()

    def _detections(self, tree: RVAFT, node: str) -> Iterator[tuple[int, Explanation]]:
        """Iterate over the detections of a relaxed tree, each after the place of its log, while work is left."""
        try:
            yield from self._run(tree)
        except TreeError:  # without the condition it means nothing, such as a variable that is not bound
            return
        except TooLarge:
            self.skipped.append(node)

    def _run(self, tree: RVAFT) -> Iterator[tuple[int, Explanation]]:
        """As `_detections`; raises `TreeError`, or `TooLarge` also where no work is left."""
        work = self.size + _NODE * len(tree.nodes)
        if self.left < work:
            raise TooLarge("events that relaxed trees read", limit=WORK)
        self.left -= work
        valid_part(tree)
        again = self.semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
        prop, by = replace(property_of(tree), alphabet=self.tree.alphabet), None  # what is relevant stays
        if self.semantics is Semantics.SCATTERED:
            by = next((name for name in tree.variables if not any(prop.lacking(name))), None)
        strategy, count = strategy_of(prop, self.semantics, limit=DEFAULT_LIMIT, repeat_by=by), 0
        fresh = Engine(tree, self.semantics, strategy=strategy, repeat_by=by)
        for place, log in enumerate(self.logs):
            monitor = Repetition(fresh) if again else fresh.fork()
            for _, event in log:
                if monitor.step(event) is Verdict.TRUE:
                    count += 1
                    if (explanation := monitor.explanation) is not None and explanation.matched:
                        yield place, self._numbered(explanation, log)
                if count == _DETECTIONS:
                    return
                if monitor.verdict.final and not again:
                    break

    def _numbered(self, explanation: Explanation, log: Sequence[tuple[int, Json]]) -> Explanation:
        """Return an explanation with the numbers of events in the log."""

        def number(place: int | None) -> int | None:
            return None if place is None else log[place - 1][0]

        matched = tuple(one._replace(event=log[one.event - 1][0]) for one in explanation.matched)
        absences = (one._replace(after=number(one.after), before=number(one.before)) for one in explanation.absences)
        return replace(explanation, matched=matched, absences=tuple(absences))

    def _lacking(self, one: Relaxation, explanation: Explanation, log: int) -> tuple[str, float]:
        """Return what a match lacks, and its distance."""
        node, events = self.tree.nodes[one.node], explanation.events
        match one.lack:
            case Lack.COUNT:
                came = len(events[node.name])
                return f"{came} of {node.times} {event_text(node)}", (node.times - came) / (
                    len(explanation.matched) + node.times - came
                )
            case Lack.EVENT:
                return self._without(one.missing, explanation)
            case Lack.WINDOW:
                assert node.within is not None, "its window was left out"
                numbers = [at for name in self._below(one.tree, node.name) for at in events.get(name, ())]
                known = {at: self._time(at, log) for at in sorted(numbers)}
                untimed = [at for at, time in known.items() if time is None]
                if untimed:
                    return f"event {untimed[0]} of {node.name} has no time that can be read", _UNMEASURED
                times = [time for time in known.values() if time is not None]
                longer = max(max(times, default=0) - min(times, default=0) - node.within, 0)
                text = f"{node.name} took {_rough(longer)} longer than {duration_text(node.within)}"
                return text, longer / (longer + node.within) if longer else 0.0
            case Lack.GUARD:
                return self._guarded(node.when, explanation, log)
            case Lack.ORDER:
                return self._unordered(one, events), _UNMEASURED
            case Lack.VALUE:
                here, there = explanation.variables.get(one.other), explanation.variables.get(one.value)
                return f"{one.value} of {one.node} is {readable_json(here)}, not {readable_json(there)}", 1.0
            case Lack.ABSENCE:
                clauses = " ".join(without_text(clause) for clause in node.without)
                return f"{node.name} is not `{clauses}`: such an event came", _UNMEASURED
            case _:
                assert_never(one.lack)

    def _without(self, missing: Sequence[str], explanation: Explanation) -> tuple[str, float]:
        """Return that a match is without some nodes, and the share of their events."""
        parts = {below for name in missing for below in reachable(name, lambda one: self._needed[one])}
        nodes = [self.tree.nodes[name] for name in parts]
        events = sum(node.times for node in nodes if node.has_event or not node.children)
        return f"all but {listing(missing)}", events / (len(explanation.matched) + events)

    @cached_property
    def _needed(self) -> dict[str, tuple[str, ...]]:
        """For each node, as many children as its gate needs: those with the fewest events below them."""
        needed: dict[str, tuple[str, ...]] = {}
        events: dict[str, int] = {}  # at most `WORK`: a shared node counts for each path to it
        for node in self.tree.bottom_up():
            number = 1 if node.gate is Gate.OR else node.threshold or len(node.children)
            needed[node.name] = tuple(sorted(node.children, key=events.__getitem__)[:number])
            own = node.times if node.has_event or not node.children else 0
            events[node.name] = min(own + sum(events[child] for child in needed[node.name]), WORK)
        return needed

    def _below(self, tree: RVAFT, name: str) -> set[str]:
        return set(reachable(name, lambda one: tree.nodes[one].children))

    def _time(self, number: int, log: int) -> int | None:
        return None if self.tree.time is None else self.tree.time.read(self.at[log][number])

    def _afterwards(self, miss: NearMiss) -> str:
        """Return when the next event of a counted leaf came, for a window that it missed."""
        leaf, explanation, log = miss.node, miss.explanation, miss.log
        pattern, last = self.tree.pattern(leaf) or Anything(), explanation.events[leaf][-1]
        at = self.at[log]
        later = (number for number in at if number > last)
        further = next((one for one in later if match(pattern, at[one], explanation.variables) is not None), None)
        if further is None:
            return "; no more came"
        windows = [
            (node.within, min(times))
            for node in self.tree.top_down()
            if node.within is not None and leaf in (below := self._below(self.tree, node.name))
            if (
                times := [
                    t
                    for one in explanation.matched
                    if one.node in below and (t := self._time(one.event, log)) is not None
                ]
            )
        ]
        came = self._time(further, log)
        late = max((came - begun - window for window, begun in windows), default=0) if came is not None else 0
        return (
            f"; the next, event {further}, came {_rough(late)} too late"
            if late > 0
            else f"; the next is event {further}"
        )

    def _guarded(self, guard: Guard | None, explanation: Explanation, log: int) -> tuple[str, float]:
        """Return which conditions of a guard do not hold, and by what share."""
        values = {**explanation.variables, **self._points(explanation, log)}

        def of(term: Guard) -> Json:
            return value(term, values) if values.keys() >= {*guard_variables(term)} else None

        wrong = [one for one in conjuncts(guard) if of(one) is not True]
        text = f"`{' and '.join(map(guard_text, wrong))}` does not hold"
        distance = _UNMEASURED
        if len(wrong) == 1 and isinstance(one := wrong[0], Operation) and one.operator in COMPARISONS:
            left, right = map(of, one.operands)
            if is_number(left) and is_number(right):
                distance = abs(left - right) / (abs(left) + abs(right) or 1)
        return text, distance

    def _points(self, explanation: Explanation, log: int) -> dict[str, Json]:
        """Return the values of the time points of a match."""
        found: dict[str, Json] = {}
        for node in self.tree.top_down():
            for point in time_points(node.when):
                below = {point.node} if point.point == "at" else self._below(self.tree, point.node)
                times = [
                    time
                    for one in explanation.matched
                    if one.node in below and (time := self._time(one.event, log)) is not None
                ]
                if times:
                    found[point.name] = max(times) if point.point == "end" else min(times)
        return found

    def _unordered(self, one: Relaxation, events: dict[str, list[int]]) -> str:
        """Return which child of a gate came too early."""
        gate = self.tree.nodes[one.node]
        came = [
            (child, [at for name in self._below(one.tree, child) for at in events.get(name, ())])
            for child in gate.children
            if child in one.tree.nodes
        ]
        came = [(child, numbers) for child, numbers in came if numbers]
        for (first, before), (second, after) in pairwise(came):
            if min(after) <= max(before):
                return f"{second} (event {min(after)}) came before the end of {first} (event {max(before)})"
        return f"the children of {one.node} came in another order"


def _rough(nanoseconds: int) -> str:
    """Return a duration with three digits."""
    unit, size = next(((unit, size) for unit, size in UNITS.items() if nanoseconds >= size), ("ns", 1))
    return f"{nanoseconds / size:.3g} {unit}"


def _time(written: Json) -> str:
    return written if isinstance(written, str) else readable_json(written)
