"""Absent events (`without`) in MFOTL: no event in a gap, and a time that decides `for D after`.

The events of a match stand again in each negated part, since MonPoly compares bound variables only.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from operator import or_
from typing import NamedTuple, Self, assert_never

from backends.event_columns import FittingEvent
from backends.mfotl.conditions import Conditions, Ways, both
from rvaft.core.conditions import Unsayable
from rvaft.core.overlaps import compatible
from rvaft.core.property import Event, Part, Property, Source, WithoutEvent, parts_below, with_parts
from rvaft.core.scenarios import Scenario
from rvaft.core.time_order import time_names
from rvaft.core.times import timed, untimed
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.guards import Guard, Operation, Operator, conjuncts, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Literal, ObjectPattern, Variable, rigid_variables


class PredicateText(NamedTuple):
    """A predicate with its arguments."""

    text: str
    names: tuple[str, ...]


class ClauseText(NamedTuple):
    """What a `without` adds to a formula: ways in which it is decided, with the variables `names`, and ways in
    which an event breaks it, with those of `own`.
    """

    deciding: tuple[tuple[str, ...], ...]
    names: tuple[str, ...]
    breaking: tuple[tuple[str, ...], ...]
    own: tuple[str, ...]


class LackedEvent(NamedTuple):
    """A `without` of a scenario, the events of its part, and the variable of the time that decides it, which may be
    so late.
    """

    clause: WithoutEvent
    part: tuple[Event, ...]
    now: str
    lateness: int

    @property
    def bound(self) -> frozenset[str]:
        """The variables that a breaking event binds."""
        return frozenset(rigid_variables(self.clause.pattern))

    @property
    def deciding(self) -> frozenset[str]:
        """The variable that the deciding event binds, if there is one."""
        return frozenset({self.now} if self.now else ())

    @property
    def tied(self) -> frozenset[str]:
        """The variables of a breaking event that the match binds, too."""
        return self.bound - self.clause.own

    @property
    def guards(self) -> tuple[Guard, ...]:
        """The parts of the guard over the breaking event alone."""
        return tuple(one for one in conjuncts(self.clause.guard) if self.bound.issuperset(variables(one)))

    @property
    def times(self) -> tuple[str, ...]:
        """The variables of the times that a duration is measured from."""
        found = (untimed(event.pattern)[1] for event in self.part)
        return () if self.clause.duration is None else tuple(name for name in found if name is not None)

    @classmethod
    def all(cls, scenario: Scenario, deciding: Mapping[tuple[Source, int], str], lateness: int) -> tuple[Self, ...]:
        """Return the clauses of a scenario, with the variables of deciding times."""
        return tuple(
            cls(clause, part, deciding.get((clause.source, clause.number), ""), lateness)
            for clause, part in scenario.absences
        )

    def tests(self, conditions: Conditions) -> tuple[Ways, Ways]:
        """Return when the time of an event decides the clause, and when an event in its place breaks it.

        Raises `NotExpressible`.
        """
        try:
            return self._decided(conditions), self._broken(conditions)
        except Unsayable as error:
            why = f"the guard or duration of an absent event: {error}"
            raise NotExpressible(unwritten(why), nodes=[self.clause.source.node]) from None

    def _decided(self, conditions: Conditions) -> Ways:
        if self.clause.side is not Side.AFTER or self.clause.duration is None:
            return ((),)
        length = self.clause.duration + self.lateness
        return conditions.ways(_less(self._extreme(Operator.MAX), Variable(self.now), -length, Operator.LT))

    def _broken(self, conditions: Conditions) -> Ways:
        clause, others = self.clause, [one for one in conjuncts(self.clause.guard) if one not in self.guards]
        found = [conditions.ways(one) for one in others]
        time = untimed(clause.pattern)[1]
        if clause.duration is not None and time is not None:
            match clause.side:
                case Side.BEFORE:
                    near = _less(self._extreme(Operator.MIN), Variable(time), clause.duration)
                case Side.AFTER:
                    near = _less(Variable(time), self._extreme(Operator.MAX), clause.duration)
                case Side.DURING:
                    raise AssertionError("only other clauses have a duration")
                case _:
                    assert_never(clause.side)
            found.append(conditions.ways(near))
        return both(*found)

    def _extreme(self, operator: Operator) -> Guard:
        times = tuple(map(Variable, self.times))
        return times[0] if len(times) == 1 else Operation(operator, times)


def _less(one: Guard, other: Guard, most: int, operator: Operator = Operator.LE) -> Guard:
    """Return the guard that a time is at most so many nanoseconds after another."""
    return Operation(operator, (Operation(Operator.SUB, (one, other)), Literal(most)))


def timed_absences(prop: Property) -> tuple[Property, dict[tuple[Source, int], str]]:
    """Return the property in which each event that a duration needs has a variable for its time, and the
    variable of the deciding time for each `for D after`.
    """
    needed = {
        part
        for one in prop.absences
        if one.duration is not None
        for part in parts_below(one)
        if isinstance(part, Event)
    }
    if not needed:
        return prop, {}
    free = time_names(prop)
    deciding: dict[tuple[Source, int], str] = {}

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        match part:
            case Event(source, pattern) if part in needed and untimed(pattern)[1] is None:
                return Event(source, timed(pattern, next(free)))
            case WithoutEvent(duration=int()):
                if part.side is Side.AFTER:
                    deciding[part.source, part.number] = next(free)
                own = next(free)
                made = with_parts(part, parts)
                assert isinstance(made, WithoutEvent)
                return replace(made, pattern=timed(part.pattern, own), own=part.own | {own})
            case _:
                return with_parts(part, parts)

    return prop.rewritten(change), deciding


def without(
    formula: str, bound: Sequence[str], clauses: Sequence[ClauseText], spend: Callable[[int], None]
) -> Iterator[str]:
    """Yield the formula of a match whose clauses hold, for each way in which they are decided."""
    for deciding in product(*(one.deciding for one in clauses)):
        decided, names = formula, [*bound, *(name for one in clauses for name in one.names)]
        for conditions in deciding:
            decided = conjoined(decided, conditions)
        found = decided
        for clause in clauses:
            for conditions in clause.breaking:
                spend(len(conditions) + len(bound))
                found = f"({found} AND (NOT ({exists(clause.own, conjoined(decided, conditions))})))"
        yield exists(names, found)


def clause_of(
    absence: LackedEvent,
    tests: tuple[Ways, Ways],
    names: tuple[str, str],
    *,
    scenario: Scenario,
    places: Mapping[Event, str],
    bound: Container[str],
    atom: Callable[[str, FittingEvent, frozenset[str], str], PredicateText],
) -> ClauseText:
    """Return what a clause asks of the events of a match at their places.

    `tests` say when it is decided and when it is broken; `names` are the positions of the events that do so.
    """
    (row, last), clause = names, absence.clause
    before = dict(zip(scenario.events, scenario.before, strict=True))
    inside = sum(1 << scenario.events.index(one) for one in absence.part)
    begins = [places[one] for one in absence.part if not before[one] & inside]
    follow = reduce(or_, (before[one] for one in absence.part))
    ends = [places[one] for one in absence.part if not follow >> scenario.events.index(one) & 1]
    match clause.side:
        case Side.DURING:
            gaps = [[f"{one} < {row}", f"{row} < {other}"] for one, other in product(begins, ends) if one != other]
        case Side.BEFORE:
            gaps = [[f"{row} < {one}" for one in begins]]
        case Side.AFTER:
            gaps = [[*(f"{one} < {row}" for one in ends), f"{row} < {last}"]]
        case _:
            assert_never(clause.side)
    broken = atom(clause.source.node, FittingEvent(clause.pattern, absence.guards), absence.bound, row)
    used = [f"NOT ({row} = {place})" for one, place in places.items() if compatible(clause.pattern, one.pattern)]
    decided, breaking = tests
    breaks = [(f"ONCE {broken.text}", *gap, *used, *way) for gap, way in product(gaps, breaking)]
    own = tuple(name for name in broken.names if name not in bound)
    if clause.side is not Side.AFTER:
        return ClauseText(((),), (), tuple(breaks), own)
    event = FittingEvent(timed(ObjectPattern(()), absence.now))
    decider = atom("time", event, absence.deciding, last)
    deciding = [(f"ONCE {decider.text}", *(f"{one} < {last}" for one in ends), *way) for way in decided]
    return ClauseText(tuple(deciding), decider.names, tuple(breaks), own)


def conjoined(formula: str, conditions: Iterable[str]) -> str:
    """Return the formula and the conditions, of which negations stand without parentheses."""
    for condition in conditions:
        formula = f"({formula} AND {condition if condition.startswith('NOT') else f'({condition})'})"
    return formula


def exists(names: Sequence[str], formula: str) -> str:
    """Return the formula with these variables bound."""
    return f"EXISTS {', '.join(names)}. {formula}"
