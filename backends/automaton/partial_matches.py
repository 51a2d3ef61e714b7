"""The partial matches of a property with absent events, scenario by scenario.

They take the place of `rvaft.core.residual`, whose residuals stand for several scenarios at once: an
event can break a partial match of one scenario and not that of another one.
"""

from collections.abc import Callable, Mapping
from functools import cache

from backends.absences import OpenClauses, breaking_event, require_unbroken
from rvaft.core.overlaps import overlaps
from rvaft.core.precedence import Ready
from rvaft.core.property import Event, Property, WithoutEvent
from rvaft.core.residual import Move, Residual
from rvaft.core.scenarios import Scenario, scenarios
from rvaft.model.guards import Guard, variables
from rvaft.model.nodes import Side
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.support.bits import mask_of
from rvaft.support.budget import Work


class PartialMatches:
    """The partial matches; a residual is the number of a scenario and the events that are not there.

    `atoms` and `guards` map patterns and guards to their bits.
    """

    def __init__(self, prop: Property, atoms: Mapping[Pattern, int], guards: Mapping[Guard, int], work: Work) -> None:
        self._atoms, self._guards, self._work = atoms, guards, work
        self._of = [*scenarios(prop)]
        require_unbroken(self._of)
        self._clauses = [*map(OpenClauses.of, self._of)]
        self._ready = [Ready(scenario.before) for scenario in self._of]
        absent = [breaking_event(clause).pattern for clause in prop.absences]
        self._apart = not any(overlaps(event.pattern, pattern) for event in prop.events for pattern in absent)
        """No event of a match can be one that breaks it."""
        self.starts = tuple(Residual(number, _all(one)) for number, one in enumerate(self._of))
        self.width = max((len(one.events) for one in self._of), default=0)
        self.moves: Callable[[Residual], tuple[Move, ...]] = cache(self._moves)
        self.absent: Callable[[Residual], int] = cache(self._absent)

    def _moves(self, left: Residual) -> tuple[Move, ...]:
        scenario = self._of[left.start]
        found = []
        for number in self._ready[left.start].after(_all(scenario) & ~left.open):
            event = scenario.events[number]
            target = left._replace(open=left.open & ~(1 << number))
            found.append(Move(number, self._atoms[event.pattern], self._needed(scenario, event), 0, target))
            self._work.step(10)
        return tuple(found)

    def _needed(self, scenario: Scenario, event: Event) -> int:
        names = {*rigid_variables(event.pattern)}
        some = (one.guard for one in scenario.conditions if names.intersection(variables(one.guard)))
        return mask_of(self._guards[guard] for guard in some)

    def breaking(self, move: Move, holding: int) -> Residual:  # noqa: ARG002 -- every guard is needed
        """Return the target of a move."""
        return move.target

    def is_complete(self, left: Residual) -> bool:
        """Whether no further event is required."""
        return not left.open

    def _absent(self, left: Residual) -> int:
        """Return the atoms that break a partial match."""
        return mask_of(self._atoms[breaking_event(clause).pattern] for clause in self._open(left))

    def _open(self, left: Residual) -> list[WithoutEvent]:
        return self._clauses[left.start].after(_all(self._of[left.start]) & ~left.open)

    def dominates(self, one: Residual, other: Residual) -> bool:
        """Whether `one` completes on every word on which `other` does, if events may be skipped: it lacks
        no further event, and what breaks it, now or later, breaks the other.
        """
        if not self._apart or one.start != other.start or one.open & ~other.open:
            return False
        clauses = self._clauses[one.start].parts
        during = (mask for clause, mask in clauses if clause.side is Side.DURING)
        return all(not mask & one.open or mask & ~one.open == 0 or mask & ~other.open for mask in during)


def _all(scenario: Scenario) -> int:
    return (1 << len(scenario.events)) - 1
