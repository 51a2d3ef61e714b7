"""Properties to MFOTL formulas: a disjunction of scenarios, each a relation of event positions.

Under `projected` and `consecutive` each order of a scenario is a chain instead: each event of a
match is the last relevant one before the next.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain, count
from typing import Final

from backends.absences import without_vacuous
from backends.event_columns import FittingEvent, ValueColumn, time_variables
from backends.mfotl.absences import LackedEvent, PredicateText, clause_of, conjoined, exists, timed_absences, without
from backends.mfotl.conditions import Conditions, Ways, both
from backends.mfotl.predicates import Column, MfotlHeader
from backends.orders import Orders
from rvaft.backend import Metrics
from rvaft.core.conditions import Unsayable
from rvaft.core.overlaps import Overlaps, overlaps
from rvaft.core.precedence import direct
from rvaft.core.property import Event, Property
from rvaft.core.scenarios import Scenario
from rvaft.core.times import untimed
from rvaft.errors import NotExpressible, TooLarge, unwritten
from rvaft.model.guards import Guard, variables
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Literal, ObjectPattern, Variable, rigid_variables
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits

_ILLEGAL: Final = re.compile(r"[^a-z0-9_]+")
_TOKEN: Final = re.compile(r'"[^"]*"|\w+(?:\.\d+)?|[^\s\w]')
_WORD: Final = re.compile(r"\w+")
_RESERVED: Final = [
    "null",
    "true",
    "false",
    "r2s",
    "s2r",
    "f2i",
    "i2f",
    "i2s",
    "s2i",
    "f2s",
    "s2f",
    "rvaft",
    "time",
    "when",
]


class MfotlFormula:
    """One translation; raises `NotExpressible`, `TooLarge`, and `TreeError` without a feasible
    scenario.
    """

    def __init__(self, prop: Property, semantics: Semantics, limit: int) -> None:
        time = prop.tree.time
        self._lateness = 0 if time is None else time.late or 0
        self._in_order = Assumption.ORDER in prop.assumes and self._lateness == 0
        prop, self._deciding = timed_absences(without_vacuous(prop, semantics))
        self._semantics, self._limit, self._size = semantics, limit, 0
        minimal = semantics is Semantics.SCATTERED and not prop.absences  # an absent event may be one that is used
        self._orders = Orders(prop, limit=limit, grouped=False, minimal=minimal)
        self._header = MfotlHeader(time=prop.time)
        absent = {name for one in prop.absences if (name := untimed(one.pattern)[1]) is not None}
        self._times = time_variables(prop) | absent | {*self._deciding.values()}
        self._names: dict[Guard, str] = {}
        self._predicates: dict[tuple[FittingEvent, tuple[Column, ...]], str] = {}
        self._taken = {*_RESERVED}
        self._relevant, self._ignored = (
            self._some(word, [FittingEvent(one.pattern, (one.when,) if one.when else ()) for one in some])
            for word, some in (("relevant", prop.alphabet), ("ignored", prop.ignored))
        )

    def _some(self, word: str, events: Sequence[FittingEvent]) -> str:
        """Return the formula that the event is one of these, or "" if none could be."""
        if not events or not self._semantics.projects:
            return ""
        name = self._fresh(word)
        self._header.fitting[name] = [*dict.fromkeys(events)]
        return f"(EXISTS i. {name}(i))"

    def text(self) -> tuple[str, Metrics]:
        """Return the text and its metrics."""
        formulas = [formula for one in self._orders.scenarios() for formula in self._disjuncts(one)]
        if not formulas:  # a predicate that no event satisfies
            self._header.fitting = {"never": [FittingEvent(ObjectPattern(()), (Literal(value=False),))]}
            formulas = ["EXISTS i1. (ONCE never(i1))"]
        formula = formulas[0] if len(formulas) == 1 else "\nOR ".join(f"({one})" for one in formulas)
        return f"{self._header}{formula}\n", Metrics(symbols=len(_TOKEN.findall(formula)), subformulas=self._size)

    def _disjuncts(self, scenario: Scenario) -> Iterator[str]:
        later = Counter(one for before in scenario.before for one in bits(before))
        order = sorted(range(len(scenario.events)), key=lambda one: -later[one])
        events = [scenario.events[one] for one in order]
        bound = {event: frozenset(rigid_variables(event.pattern)) for event in events}
        absences = LackedEvent.all(scenario, self._deciding, self._lateness)
        others = [names for one in absences for names in (one.bound, one.deciding)]
        conditions = Conditions(self._times, [*bound.values(), *others], self._column, self._earlier(scenario))
        ways = list[Ways]()

        def several(node: str, guard: Guard) -> NotExpressible | None:
            try:
                ways.append(conditions.ways(guard))
            except Unsayable as error:
                reason = f"a guard over several events: {error}"
                return NotExpressible(unwritten(reason), nodes=[node])
            return None

        own = self._orders.assigned_guards(scenario, bound, several)
        if own is None:
            return
        ways += [conditions.known(name) for one in absences for name in one.times]
        tests = [one.tests(conditions) for one in absences]
        uses = Counter(chain(*bound.values(), *(one.tied for one in absences)))
        tied = {(Variable(name), "text") for name in uses if uses[name] > 1 and name not in self._times}
        places = {name: f"i{number}" for number, name in enumerate(events, 1)}
        arguments = sorted(tied | conditions.columns, key=self._column)

        def atom(node: str, event: FittingEvent, names: frozenset[str], place: str) -> PredicateText:
            columns = tuple(one for one in arguments if names.issuperset(variables(one[0])))
            return PredicateText(self._atom(node, event, columns, place), (*map(self._column, columns), place))

        matched = [
            atom(name.source.node, FittingEvent(name.pattern, tuple(own[name])), bound[name], places[name])
            for name in events
        ]
        atoms = [one.text for one in matched]
        of_match = {name for one in matched for name in one.names}
        bound_names = [name for name in [*map(self._column, arguments), *places.values()] if name in of_match]
        clauses = [
            clause_of(one, its, (f"q{n}", f"d{n}"), scenario=scenario, places=places, bound=of_match, atom=atom)
            for n, (one, its) in enumerate(zip(absences, tests, strict=True), 1)
        ]
        if self._semantics.projects:
            places_of = {name: number for number, name in enumerate(events)}
            letters = {name: (name, scenario.conditions, scenario.absences) for name in events}
            for word in self._orders.words(scenario, letters):
                numbers = [places_of[name] for name, *_ in word]
                for way in both(*ways):
                    self._spend(len(word) + len(way))
                    chained = self._chain([atoms[number] for number in numbers], way, bound_names)
                    if clauses:
                        yield from without(f"(ONCE {chained})", bound_names, clauses, self._spend)
                    else:
                        yield f"ONCE ({exists(bound_names, chained)})"
            return
        orders = self._orders_of(scenario, events, places)
        for way in both(*ways):
            self._spend(len(events) + sum(map(len, orders)) + len(way))
            once = [f"(ONCE {one})" for one in atoms]
            yield from without(_conjunction(once, orders, way, bound_names), bound_names, clauses, self._spend)

    def _earlier(self, scenario: Scenario) -> dict[str, set[str]]:
        """Return for each variable of a time those that are never later, in a log whose times do not decrease."""
        if not self._in_order:
            return {}
        times = [untimed(event.pattern)[1] for event in scenario.events]
        earlier = ({times[one] for one in bits(before)} for before in scenario.before)
        return {time: {one for one in some if one} for time, some in zip(times, earlier, strict=True) if time}

    def _orders_of(self, scenario: Scenario, events: Sequence[Event], places: Mapping[Event, str]) -> list[list[str]]:
        """Return the comparisons of each event's position with those of the events before it in `events`."""
        later = Counter(one for before in scenario.before for one in bits(before))
        order = [scenario.events.index(event) for event in events]
        rank = {one: number for number, one in enumerate(order)}
        orders: list[list[str]] = []
        alike = Overlaps([event.pattern for event in events])
        for number, (one, name) in enumerate(zip(order, events, strict=True)):
            last = sorted(rank[before] for before in direct(scenario.before, one))
            orders.append([f"{places[events[before]]} < {places[name]}" for before in last])
            if self._semantics is Semantics.STRICT and not later[one]:
                orders[-1].append(f"{places[name]} < {len(events)}")
            for other in bits(alike.compatible(number) & (1 << number) - 1):
                ordered = scenario.before[one] >> order[other] & 1
                if not ordered and overlaps(name.pattern, events[other].pattern):
                    orders[-1].append(f"NOT ({places[events[other]]} = {places[name]})")
        return orders

    def _spend(self, size: int) -> None:
        self._size += size
        if self._size > self._limit:
            raise TooLarge("atoms and comparisons of the formula", limit=self._limit)

    def _chain(self, atoms: Sequence[str], way: Sequence[str], bound: Sequence[str]) -> str:
        """Return the formula of consecutive relevant events, with an atom for each."""
        counts = f"({self._relevant} AND (NOT {self._ignored}))" if self._ignored else self._relevant
        own = [f"NOT {self._ignored}"] if self._ignored else []
        begins = [f"NOT (PREVIOUS (ONCE {counts}))"] if self._semantics is Semantics.PROJECTED else []
        orders = [[*own, *(begins if number == 0 else [])] for number in range(len(atoms))]

        def joined(before: str, atom: str) -> str:
            return f"({atom} AND (PREVIOUS ((NOT {counts}) SINCE {before})))"

        return _conjunction(atoms, orders, way, bound, joined)

    def _atom(self, node: str, event: FittingEvent, columns: tuple[Column, ...], place: str) -> str:
        known = event, columns
        if known not in self._predicates:
            self._predicates[known] = name = self._fresh(node)
            self._header.fitting[name] = [known[0]]
            self._header.values[name] = {self._column(one): ValueColumn(one[1], one[0]) for one in columns}
        return f"{self._predicates[known]}({', '.join([*map(self._column, columns), place])})"

    def _column(self, column: Column) -> str:
        term, aspect = column
        if term not in self._names:
            about = term.name if isinstance(term, Variable) else "value"
            plain = "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in about)
            self._names[term] = _free(plain, self._names.values())
        return f"{self._names[term]}_{aspect}"

    def _fresh(self, node: str) -> str:
        name = _ILLEGAL.sub("_", node.lower()).strip("_") or "event"
        name = f"e{name}" if name[0].isdigit() else name
        self._taken.add(found := _free(name, self._taken))
        return found


def _free(name: str, taken: Collection[str]) -> str:
    return next(one for one in chain([name], (f"{name}_{number}" for number in count(2))) if one not in taken)


def _conjunction(
    atoms: Sequence[str],
    orders: Sequence[list[str]],
    way: Sequence[str],
    bound: Sequence[str],
    joined: Callable[[str, str], str] = "({} AND {})".format,
) -> str:
    """Return the conjunction of atoms, with each comparison as soon as its arguments are bound."""
    formula, known, waiting, arguments = "", set[str](), list(way), frozenset(bound)
    for atom, order in zip(atoms, orders, strict=True):
        formula = joined(formula, atom) if formula else atom
        known |= set(_WORD.findall(atom))
        ready = [one for one in waiting if known.issuperset(arguments.intersection(_WORD.findall(one)))]
        waiting = [one for one in waiting if one not in ready]
        for condition in (*order, *ready):
            formula = conjoined(formula, [condition])
    return formula
