"""The stages of a property: how far a partial match has come, as the rows of a C table.

A stage has what remains of a scenario after a downward-closed set of its events, and the values on
which the remainder depends: variables, and running extremes of times. Equal remainders of all
scenarios are one stage, so stages are built from the detection backwards. A *move* takes one more
event.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from rvaft.core.property import Property
from rvaft.core.scenarios import Ready, Scenario, scenarios
from rvaft.core.times import Extreme, TimeDifference, differences
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, Operation, Operator, TimePoint, conjuncts, variables
from rvaft.model.patterns import Pattern, Variable, rigid_variables
from rvaft.model.verdict import Semantics

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

    With both a slot and `now`, the value is the extreme of both.
    """

    slot: int | None = None
    now: bool = False
    variable: str = ""


class Test(NamedTuple):
    """A guard that a move decides, with the source of each of its slots."""

    guard: Guard
    loads: tuple[tuple[Slot, Load], ...]


@dataclass(frozen=True, slots=True)
class Transition:
    """One more event: its pattern, slots that its variables must equal, tests, and the next stage."""

    pattern: Pattern
    joins: tuple[tuple[int, str], ...]
    tests: tuple[Test, ...]
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


DETECTED: Final = TableStage((), 0, (), (), (), 0)


@dataclass(frozen=True, slots=True)
class StageTable:
    """All stages, each after those that its moves reach; the first is the detection."""

    stages: tuple[TableStage, ...]
    starts: tuple[int, ...]


def stages_of(prop: Property, semantics: Semantics, limit: int) -> StageTable:
    """Return the stages of a reduced property; raises `TooLarge` beyond `limit` sets of events.

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
    for scenario in scenarios(prop, minimal=semantics is Semantics.SCATTERED, limit=limit):
        rows = _Rows(scenario, semantics)
        found: dict[int, int] = {}
        for done in _downward_closed(scenario, left, limit):
            left -= 1
            stage = rows.stage(done, found, known)
            number = found[done] = numbers.setdefault(stage, len(numbers))
            if number == len(known):
                known.append(stage)
        starts[found[0]] = None
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


class _Rows:
    """The stages of one scenario."""

    def __init__(self, scenario: Scenario, semantics: Semantics) -> None:
        self._scenario = scenario
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

    def _known(self, slot: Slot, done: int) -> bool:
        return all(self._binds[name] & done for name in slot.names)

    def _some(self, slot: Slot, done: int) -> bool:
        return any(self._binds[name] & done for name in slot.names)

    def _pending(self, done: int) -> list[_Decided]:
        return [one for one in self._guards if not all(self._known(slot, done) for slot in one.slots)]

    def _live(self, done: int) -> tuple[tuple[Slot, ...], int, tuple[bool, ...]]:
        """Return the slots, the number of exact ones, and the directions of the others."""
        pending = self._pending(done)
        found = {slot: None for one in pending for slot in one.slots if self._some(slot, done)}
        found.update((Slot((name,)), None) for name, events in self._shared if events & done and events & ~done)
        smaller = {slot: wanted for slot in found if (wanted := self._direction(slot, pending)) is not None}
        exact = sorted((slot for slot in found if slot not in smaller), key=str)
        others = sorted(smaller, key=str)
        return (*exact, *others), len(exact), tuple(smaller[slot] for slot in others)

    def _direction(self, slot: Slot, pending: Sequence[_Decided]) -> bool | None:
        """Return whether smaller values of a slot are better; None if neither is."""
        if not (self._ordered and slot.timed):
            return None
        found = set[bool]()
        for one in pending:
            if slot in one.slots:
                if one.bounds is None:
                    return None
                for bound in one.bounds:
                    found.update(
                        side for side, extreme in ((True, bound.plus), (False, bound.minus)) if _slot(extreme) == slot
                    )
        return found.pop() if len(found) == 1 else None

    def stage(self, done: int, found: dict[int, int], known: Sequence[TableStage]) -> TableStage:
        """Return the stage after these events; `found` has the stages of larger sets."""
        following = self._ready.after(done)
        if not following:
            return DETECTED
        slots, exact, smaller = self._live(done)
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
        moves = dict.fromkeys(self._move(done, number, place, found[done | 1 << number]) for number in following)
        return TableStage(
            slots, exact, smaller, expiries, tuple(moves), 1 + max(known[move.target].rank for move in moves)
        )

    def _move(self, done: int, number: int, place: dict[Slot, int], target: int) -> Transition:
        event, after = self._scenario.events[number], done | 1 << number
        joins = tuple(
            (place[Slot((name,))], name) for name in rigid_variables(event.pattern) if self._binds[name] & done
        )
        pending = self._pending(after)
        tests = [one for one in self._pending(done) if one not in pending]
        if self._lasting:  # a window that is exceeded already
            here = TimePoint.of("at", *event.source).name
            tests += [one for one in pending if self._exceeded(one, after, here)]
        slots = self._live(after)[0] if target else ()

        def load(slot: Slot) -> tuple[Slot, Load]:
            old = place[slot] if self._some(slot, done) else None
            if not slot.timed:
                return slot, Load(old) if old is not None else Load(variable=slot.names[0])
            return slot, Load(old, any(self._binds[name] == 1 << number for name in slot.names))

        made = tuple(Test(one.guard, tuple(map(load, one.slots))) for one in tests)
        return Transition(event.pattern, joins, made, tuple(map(load, slots)), target)

    def _exceeded(self, one: _Decided, done: int, here: str) -> bool:
        """Whether a pending bound can fail already: a maximum only grows, and a minimum only falls."""
        if one.bounds is None or len(one.bounds) != 1 or not any(here in slot.names for slot in one.slots):
            return False
        plus, minus, _ = one.bounds[0]
        if plus.operator is not Operator.MAX or minus.operator is not Operator.MIN:
            return False
        return self._some(_slot(plus), done) and self._some(_slot(minus), done)


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
