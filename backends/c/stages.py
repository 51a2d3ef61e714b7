"""The stages of a property: how far a partial match has come, as the rows of a C table.

A stage has what remains of a scenario after a downward-closed set of its events, and the values on
which the remainder depends: variables, and running extremes of times. Equal remainders of all
scenarios are one stage, so stages are built from the detection backwards. A *move* takes one more
event. A *break* ends a partial match by an event that must be absent, and a *wait* ends by a time,
from which on no event breaks the clause `for D after` of a part.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import chain
from typing import Final, NamedTuple

from rvaft.core.overlaps import compatible
from rvaft.core.precedence import Ready
from rvaft.core.property import Event, Part, Property, WithoutEvent
from rvaft.core.scenarios import Scenario, scenarios
from rvaft.core.times import Extreme, TimeDifference, differences
from rvaft.errors import NotExpressible, TooLarge, unwritten
from rvaft.model.guards import Guard, Operation, Operator, TimePoint, conjuncts, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Pattern, Variable, rigid_variables
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits

_LARGE: Final = 1 << 62


class Slot(NamedTuple):
    """A value of a partial match: a variable, or an extreme of the times of some events.

    `operator` is MAX or MIN, or None for a variable and for the time of a single event.
    """

    names: tuple[str, ...]
    operator: Operator | None = None
    timed: bool = False


class Load(NamedTuple):
    """The source of a slot after a move: a slot, the event's time, or a variable of the event.

    With both a slot and `now`, the value is the extreme of both. `past` is a slot of a remembered event.
    """

    slot: int | None = None
    now: bool = False
    variable: str = ""
    past: int | None = None


class Test(NamedTuple):
    """A guard that a move decides, with the source of each of its slots."""

    guard: Guard
    loads: tuple[tuple[Slot, Load], ...]


class Remembered(NamedTuple):
    """The events that may not come before a part.

    They are remembered by the values of `names`, of which the first `joined` must equal those of a match.
    `guard` is decided by the event. With a duration, the latest time is remembered.
    """

    pattern: Pattern
    names: tuple[str, ...]
    joined: int
    guard: Guard | None
    duration: int | None


class Recall(NamedTuple):
    """A move is made only if no remembered event has the values of `loads`, and fits the test."""

    remembered: Remembered
    loads: tuple[tuple[Slot, Load], ...]
    test: Test | None


@dataclass(frozen=True, slots=True)
class Transition:
    """One more event: its pattern, slots that its variables must equal, tests, and the next stage.

    The values of `defined` must be defined, and those of `recalls` must not have come.
    """

    pattern: Pattern
    joins: tuple[tuple[int, str], ...]
    tests: tuple[Test, ...]
    loads: tuple[tuple[Slot, Load], ...]
    target: int
    defined: tuple[tuple[Slot, Load], ...] = ()
    recalls: tuple[Recall, ...] = ()


class Break(NamedTuple):
    """An event that ends a partial match: its pattern, joins and test.

    With `end`, its time is at most that of this slot and the duration.
    """

    pattern: Pattern
    joins: tuple[tuple[int, str], ...]
    test: Test | None
    end: int | None = None
    duration: int = 0


class Wait(NamedTuple):
    """The next stage after a time that exceeds that of a slot by more than `most`."""

    slot: int
    most: int
    loads: tuple[tuple[Slot, Load], ...]
    target: int


class Expiry(NamedTuple):
    """A match cannot be completed in time if the watermark exceeds the slot by more than `most`."""

    slot: int
    most: int


@dataclass(frozen=True, slots=True)
class TableStage:
    """The slots and moves of a stage; `rank` is the greatest number of events to a detection.

    The slots from `exact` on are times. For each, `smaller` tells whether a smaller time allows
    more detections, or else a greater one.
    """

    slots: tuple[Slot, ...]
    exact: int
    smaller: tuple[bool, ...]
    expiries: tuple[Expiry, ...]
    moves: tuple[Transition, ...]
    rank: int
    breaks: tuple[Break, ...] = ()
    waits: tuple[Wait, ...] = ()


DETECTED: Final = TableStage((), 0, (), (), (), 0)


@dataclass(frozen=True, slots=True)
class StageTable:
    """All stages, each after those that its moves reach; the first is the detection."""

    stages: tuple[TableStage, ...]
    starts: tuple[int, ...]


def stages_of(prop: Property, semantics: Semantics, limit: int, by: str | None = None) -> StageTable:
    """Return the stages of a reduced property; raises `TooLarge` beyond `limit` sets of events.

    All partial matches keep the variable `by`, which every event binds.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> found = stages_of(build(rvaft.loads("top and a b;")), Semantics.SCATTERED, 100)
    >>> [(stage.rank, len(stage.moves)) for stage in found.stages], found.starts
    ([(0, 0), (1, 1), (1, 1), (2, 2)], (3,))
    """
    numbers: dict[TableStage, int] = {DETECTED: 0}
    known = [DETECTED]
    starts: dict[int, None] = {}
    left = limit
    late = 0 if prop.time is None else prop.time.late
    # one more event may mend what an absent event breaks
    minimal = semantics is Semantics.SCATTERED and not prop.absences
    for scenario in scenarios(prop, minimal=minimal, limit=limit):
        rows = _Rows(scenario, semantics, late, by)
        found: dict[tuple[int, int], int] = {}
        for done in _downward_closed(scenario, left, limit):
            for decided in rows.decided(done):
                left -= 1
                if left < 0:
                    raise TooLarge("sets of events of the scenarios", limit=limit)
                stage = rows.stage(done, decided, found, known)
                number = found[done, decided] = numbers.setdefault(stage, len(numbers))
                if number == len(known):
                    known.append(stage)
        starts[found[0, 0]] = None
    return StageTable(tuple(known), tuple(starts))


def _downward_closed(scenario: Scenario, left: int, limit: int) -> list[int]:
    """Return the downward-closed sets of events as bits, larger ones first."""
    levels, count = [{0}], 1
    ready = Ready(scenario.before)
    for _ in scenario.events:
        following = set[int]()
        for done in levels[-1]:
            following.update(done | 1 << event for event in ready.after(done))
            if count + len(following) > left:
                raise TooLarge("sets of events of the scenarios", limit=limit)
        count += len(following)
        levels.append(following)
    return [done for level in reversed(levels) for done in sorted(level)]


class _Decided(NamedTuple):
    """A guard with its slots; `bounds` if it only compares times."""

    guard: Guard
    slots: tuple[Slot, ...]
    bounds: tuple[TimeDifference, ...] | None


class _Clause(NamedTuple):
    """An absent event with the events of its part as bits; `end` is the end of the part."""

    part: WithoutEvent
    events: int
    end: Slot

    def is_settled(self, done: int, *, is_decided: bool) -> bool:
        """Whether no later event concerns it."""
        match self.part.side:
            case Side.DURING:
                return not self.events & ~done
            case Side.AFTER:
                return is_decided
            case Side.BEFORE:
                return bool(self.events & done)

    def is_open(self, done: int, *, is_decided: bool) -> bool:
        """Whether the next event may break it."""
        match self.part.side:
            case Side.DURING:
                return bool(self.events & done and self.events & ~done)
            case Side.AFTER:
                return not (self.events & ~done or is_decided)
            case Side.BEFORE:
                return False


class _Rows:
    """The stages of one scenario."""

    def __init__(self, scenario: Scenario, semantics: Semantics, late: int | None, by: str | None) -> None:
        self._scenario = scenario
        self._kept = () if by is None else (Slot((by,)),)
        self._ready = Ready(scenario.before)
        self._ordered = semantics is Semantics.SCATTERED
        self._lasting = semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
        guards = [condition.guard for condition in scenario.conditions]
        if self._lasting:  # without a false verdict, each conjunct is decided as early as possible
            guards = [part for guard in guards for part in conjuncts(guard)]
        self._guards = [_decided(guard) for guard in guards]
        self._binds: dict[str, int] = {}
        """For each variable and time point, its events as bits."""
        for number, event in enumerate(scenario.events):
            for name in (*rigid_variables(event.pattern), TimePoint.of("at", *event.source).name):
                self._binds[name] = self._binds.get(name, 0) | 1 << number
        names = dict.fromkeys(name for event in scenario.events for name in rigid_variables(event.pattern))
        self._shared = [(name, found) for name in names if (found := self._binds[name]).bit_count() > 1]
        self._late = late
        self._clauses = _clauses(scenario)
        for clause in self._clauses:
            _require_written(clause, late, lasting=self._lasting)

    def decided(self, done: int) -> list[int]:
        """Return the sets of clauses that may be decided after these events as bits, larger ones first."""
        whole = [
            1 << n for n, one in enumerate(self._clauses) if one.part.side is Side.AFTER and not one.events & ~done
        ]
        found = [0]
        for clause in whole:
            found += [one | clause for one in found]
        return sorted(found, key=int.bit_count, reverse=True)

    def _unsettled(self, done: int, decided: int) -> list[_Clause]:
        return [
            one for n, one in enumerate(self._clauses) if not one.is_settled(done, is_decided=bool(decided >> n & 1))
        ]

    def _known(self, slot: Slot, done: int) -> bool:
        return all(self._binds[name] & done for name in slot.names)

    def _some(self, slot: Slot, done: int) -> bool:
        return any(self._binds[name] & done for name in slot.names)

    def _pending(self, done: int) -> list[_Decided]:
        return [one for one in self._guards if not all(self._known(slot, done) for slot in one.slots)]

    def _live(self, done: int, decided: int) -> tuple[tuple[Slot, ...], int, tuple[bool, ...]]:
        """Return the slots, the number of exact ones, and the directions of the others."""
        pending, unsettled = self._pending(done), self._unsettled(done, decided)
        ends = {one.end for one in unsettled if one.part.side is Side.AFTER and self._some(one.end, done)}
        found = {slot: None for one in pending for slot in one.slots if self._some(slot, done)}
        found.update((Slot((name,)), None) for name, events in self._shared if events & done and events & ~done)
        shared = (name for one in unsettled for name in one.part.shared)
        found.update((Slot((name,)), None) for name in shared if self._binds[name] & done)
        found.update((slot, None) for slot in self._kept if done)
        found.update((slot, None) for slot in sorted(ends, key=str))
        smaller = {slot: wanted for slot in found if (wanted := self._direction(slot, pending, ends)) is not None}
        exact = sorted((slot for slot in found if slot not in smaller), key=str)
        others = sorted(smaller, key=str)
        return (*exact, *others), len(exact), tuple(smaller[slot] for slot in others)

    def _direction(self, slot: Slot, pending: Sequence[_Decided], ends: Set[Slot]) -> bool | None:
        """Return whether smaller values of a slot are better; None if neither is."""
        if not (self._ordered and slot.timed):
            return None
        found = {True} if slot in ends else set[bool]()  # of two, the earlier deadline is decided first
        for one in pending:
            if slot in one.slots:
                if one.bounds is None:
                    return None
                for bound in one.bounds:
                    found.update(
                        side for side, extreme in ((True, bound.plus), (False, bound.minus)) if _slot(extreme) == slot
                    )
        return found.pop() if len(found) == 1 else None

    def stage(
        self, done: int, decided: int, found: Mapping[tuple[int, int], int], known: Sequence[TableStage]
    ) -> TableStage:
        """Return the stage after these events; `found` has the stages of larger sets."""
        following = self._ready.after(done)
        every = sum(1 << n for n, one in enumerate(self._clauses) if one.part.side is Side.AFTER)
        if not following and decided == every:
            return DETECTED
        slots, exact, smaller = self._live(done, decided)
        place = {slot: number for number, slot in enumerate(slots)}
        expiries = tuple(
            Expiry(place[slot], bound.most)
            for one in self._pending(done)
            for bound in one.bounds or ()
            if 0 <= bound.most < _LARGE
            and place.get(slot := _slot(bound.minus), -1) >= exact
            and (slot.operator is not Operator.MAX or self._known(slot, done))
            and not self._known(_slot(bound.plus), done)
            and (bound.plus.operator is Operator.MAX or not self._some(_slot(bound.plus), done))
        )
        moves = dict.fromkeys(
            self._move(done, decided, number, place, found[done | 1 << number, decided]) for number in following
        )
        breaks, waits = list[Break](), list[Wait]()
        for n, clause in enumerate(self._clauses):
            if clause.is_open(done, is_decided=bool(decided >> n & 1)):
                breaks.append(_break(clause, place))
                if clause.part.side is Side.AFTER:
                    target = found[done, decided | 1 << n]
                    live = self._live(done, decided | 1 << n)[0] if target else ()
                    loads = tuple((slot, Load(place[slot])) for slot in live)
                    waits.append(Wait(place[clause.end], _duration(clause) + (self._late or 0), loads, target))
        targets = chain((move.target for move in moves), (wait.target for wait in waits))
        rank = 1 + max(known[target].rank for target in targets)
        return TableStage(
            slots, exact, smaller, expiries, tuple(moves), rank, tuple(dict.fromkeys(breaks)), tuple(waits)
        )

    def _move(self, done: int, decided: int, number: int, place: Mapping[Slot, int], target: int) -> Transition:
        event, after = self._scenario.events[number], done | 1 << number
        joins = tuple(
            (place[Slot((name,))], name) for name in rigid_variables(event.pattern) if self._binds[name] & done
        )
        pending = self._pending(after)
        tests = [one for one in self._pending(done) if one not in pending]
        if self._lasting:  # a window that is exceeded already
            here = TimePoint.of("at", *event.source).name
            tests += [one for one in pending if self._exceeded(one, after, here)]
        slots = self._live(after, decided)[0] if target else ()

        def load(slot: Slot) -> tuple[Slot, Load]:
            old = place[slot] if self._some(slot, done) else None
            if not slot.timed:
                return slot, Load(old) if old is not None else Load(variable=slot.names[0])
            return slot, Load(old, any(self._binds[name] == 1 << number for name in slot.names))

        made = tuple(Test(one.guard, tuple(map(load, one.slots))) for one in tests)
        own = [one for one in self._clauses if one.events >> number & 1]
        defined = dict.fromkeys(self._defined(own, after, load))
        recalls = tuple(
            self._recall(one, done, load) for one in own if one.part.side is Side.BEFORE and not one.events & done
        )
        return Transition(event.pattern, joins, made, tuple(map(load, slots)), target, tuple(defined), recalls)

    def _defined(
        self, own: Sequence[_Clause], after: int, load: Callable[[Slot], tuple[Slot, Load]]
    ) -> Iterator[tuple[Slot, Load]]:
        """Iterate over the times that clauses with a duration need; without a false verdict, at once."""
        for clause in own:
            if clause.part.duration is None:
                continue
            if self._lasting or clause.part.side is Side.BEFORE:
                yield clause.end._replace(operator=None), Load(now=True)
            elif not clause.events & ~after:
                yield load(clause.end)

    def _recall(self, clause: _Clause, done: int, load: Callable[[Slot], tuple[Slot, Load]]) -> Recall:
        part = clause.part
        for event in bits(done):
            if compatible(self._scenario.events[event].pattern, part.pattern):
                raise NotExpressible(
                    unwritten("`without … before` where an earlier event of a match may be the absent one"),
                    nodes=_node(part),
                )
        own = rigid_variables(part.pattern)
        joined = tuple(name for name in part.shared if name in own)
        alone = part.guard is None or set(variables(part.guard)) <= set(own)
        others = () if alone else tuple(name for name in own if name in variables(part.guard) and name not in joined)
        names = (*joined, *others)
        kept = Remembered(part.pattern, names, len(joined), part.guard if alone else None, part.duration)
        test = None
        if part.guard is not None and not alone:
            test = Test(
                part.guard,
                tuple(
                    (Slot((name,)), Load(past=names.index(name))) if name in names else load(Slot((name,)))
                    for name in variables(part.guard)
                ),
            )
        return Recall(kept, tuple(load(Slot((name,))) for name in joined), test)

    def _exceeded(self, one: _Decided, done: int, here: str) -> bool:
        """Whether a pending bound can fail already: a maximum only grows, and a minimum only falls."""
        if one.bounds is None or len(one.bounds) != 1 or not any(here in slot.names for slot in one.slots):
            return False
        plus, minus, _ = one.bounds[0]
        if plus.operator is not Operator.MAX or minus.operator is not Operator.MIN:
            return False
        return self._some(_slot(plus), done) and self._some(_slot(minus), done)


def _clauses(scenario: Scenario) -> list[_Clause]:
    """Return the absent events of a scenario."""
    place = {event: number for number, event in enumerate(scenario.events)}
    inside: dict[Part, int] = {}
    for part in reversed(list(scenario.kept)):
        if isinstance(part, Event):
            inside[part] = 1 << place[part]
        else:
            inside[part] = 0
            for inner in scenario.kept[part]:
                inside[part] |= inside[inner]
    made = []
    for part in scenario.kept:
        if isinstance(part, WithoutEvent):
            names = tuple(TimePoint.of("at", *scenario.events[event].source).name for event in bits(inside[part]))
            end = Slot(names, Operator.MAX if len(names) > 1 else None, timed=True)
            if part.side is not Side.DURING or len(names) > 1:
                made.append(_Clause(part, inside[part], end))
    return made


def _require_written(clause: _Clause, late: int | None, *, lasting: bool) -> None:
    part = clause.part
    if (part.duration or 0) >= _LARGE:
        raise NotExpressible(unwritten("a duration of more than 62 bits"), nodes=_node(part))
    if part.side is Side.BEFORE and part.duration is not None and len(clause.end.names) > 1:
        if late != 0:
            raise NotExpressible(
                unwritten("`without … for D before` at several events whose times may decrease; `late 0 s` forbids it"),
                nodes=_node(part),
            )
        if not lasting:
            raise NotExpressible(
                unwritten("`without … for D before` at several events needs `scattered` or `consecutive`"),
                nodes=_node(part),
            )


def _node(part: WithoutEvent) -> tuple[str, ...]:
    return () if part.source is None else (part.source.node,)


def _duration(clause: _Clause) -> int:
    return clause.part.duration or 0


def _break(clause: _Clause, place: Mapping[Slot, int]) -> Break:
    part = clause.part
    own = rigid_variables(part.pattern)
    joins = tuple((place[Slot((name,))], name) for name in part.shared if name in own)
    test = None
    if part.guard is not None:
        loads = (
            (slot := Slot((name,)), Load(variable=name) if name in own else Load(place[slot]))
            for name in variables(part.guard)
        )
        test = Test(part.guard, tuple(loads))
    if part.side is not Side.AFTER:
        return Break(part.pattern, joins, test)
    return Break(part.pattern, joins, test, place[clause.end], _duration(clause))


def _slot(extreme: Extreme) -> Slot:
    return Slot(extreme.names, extreme.operator if len(extreme.names) > 1 else None, timed=True)


def _decided(guard: Guard) -> _Decided:
    slots = dict.fromkeys(slot for slot in _slots(guard))
    bounds = differences(guard) if all(slot.timed for slot in slots) else None
    if bounds is not None and any(_slot(extreme) not in slots for bound in bounds for extreme in bound[:2]):
        bounds = None
    return _Decided(guard, tuple(slots), bounds)


def slot_of(guard: Guard) -> Slot | None:
    """Return the slot that a term of a guard is: a variable, a time, or an extreme of times."""
    match guard:
        case TimePoint(name=name):
            return Slot((name,), timed=True)
        case Variable(name):
            return Slot((name,))
        case Operation(Operator.MAX | Operator.MIN as operator, terms) if all(
            isinstance(term, TimePoint) for term in terms
        ):
            return Slot(variables(guard), operator, timed=True)
        case _:
            return None


def _slots(guard: Guard) -> list[Slot]:
    slot = slot_of(guard)
    if slot is not None:
        return [slot]
    return [found for operand in guard.operands for found in _slots(operand)] if isinstance(guard, Operation) else []
