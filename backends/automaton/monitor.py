"""Runs a table on events: one run for each partial assignment of the variables that matching has produced.

A *slice* is an assignment and the state it has led to. At an event a slice goes on as it is, its atoms with unbound variables being
false, and for each atom that would bind variables a slice with those values branches off. The verdict is ⊤ when some slice
has detected, ⊥ when none is left that could. A slice that has bound more than another one in the same state adds
nothing to it and is dropped.
"""

from collections.abc import Hashable, Iterator, Mapping
from functools import lru_cache
from itertools import combinations
from typing import Final, TypeAlias

from backends.automaton.hoa_reader import Fit, Meaning, Table, error_at, meaning, table
from backends.automaton.hoa_writer import ALIVE
from backends.automaton.letters import apart
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, Operation, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import (
    Binding,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    match,
    rigid,
    rigid_variables,
    variables,
)
from rvaft.model.values import Json, key
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

# What a HOA text asks of events: the patterns of its propositions, and the lines that say what is relevant.


def questions(said: Meaning, events: Mapping[int, Pattern]) -> tuple[Observed, ...]:
    """The questions of a text that says this, its propositions standing for these events."""
    return tuple(dict.fromkeys(_questions(said, events)))


def _questions(said: Meaning, events: Mapping[int, Pattern]) -> Iterator[Observed]:
    for pattern in events.values():
        yield Observed(pattern)
        shared = set(rigid_variables(pattern))
        for guard in said.guards.values():  # a proposition of its own, about values that an event gives variables
            if shared & set(guard_variables(guard)):
                yield Observed(pattern, guard)
    if said.relevant:
        yield from map(_apart, (*said.alphabet, *said.ignored))


def _apart(fit: Fit) -> Observed:
    """With variables of its own: some values will do."""
    own = {name for name in variables(fit.pattern) if not name.startswith("_")}
    return Observed(apart(fit.pattern), None if fit.guard is None else _renamed(fit.guard, own))


def _renamed(guard: Guard, own: set[str]) -> Guard:
    match guard:
        case Variable(name):
            return Variable(f"_{name}") if name in own else guard
        case Operation(operator, operands):
            return Operation(operator, tuple(_renamed(operand, own) for operand in operands))
        case _:
            return guard


SLICES: Final = 100_000
"""The most slices that a monitor keeps before it gives up with `TooLarge`."""

FEW: Final = 6
"""Up to this many variables all smaller assignments are looked for."""

Assignment: TypeAlias = frozenset[tuple[str, Hashable]]
Slice: TypeAlias = tuple[Assignment, int]


def monitor(text: str, atoms: Mapping[str, Pattern]) -> Monitor:
    """A monitor that runs a HOA text; `atoms` gives the events of propositions that the text does not define."""
    return AutomatonMonitor(*_meant(text, atoms))


def observed(text: str, atoms: Mapping[str, Pattern]) -> tuple[Observed, ...]:
    """All that such a monitor asks of events."""
    _, said, events = _meant(text, atoms)
    return questions(said, events)


def _meant(text: str, atoms: Mapping[str, Pattern]) -> tuple[Table, Meaning, Mapping[int, Pattern]]:
    """The table, what the text says, and the event of each proposition that stands for one."""
    said, run = _read(text)
    numbers = range(len(run.names))
    for number in (*said.events, *said.guards, *said.relevant):
        if number not in numbers:
            raise error_at(text, 0, f"the text has no proposition {number}, but says what it means")
    events = dict(said.events)
    for number in numbers:
        name = run.names[number]
        if number not in (*events, *said.guards, *said.relevant) and name != ALIVE:
            events[number] = atoms.get(name, ObjectPattern((("event", Literal(name)),)))
    return run, said, events


@lru_cache(maxsize=8)
def _read(text: str) -> tuple[Meaning, Table]:
    """What a text says; kept for monitors of the same text, which only read it."""
    return meaning(text), table(text)


class AutomatonMonitor(Monitor):
    """Runs one table; shares it with nobody that writes to it."""

    def __init__(self, run: Table, said: Meaning, events: Mapping[int, Pattern], *, limit: int = SLICES) -> None:
        super().__init__()
        self._run = run
        self._said = said
        self._events = events
        self._limit = limit
        self._slices: dict[Slice, Binding] = {(frozenset(), run.start): {}}

    @property
    def state(self) -> Hashable:
        """The slices; after a final verdict only that."""
        return self._verdict if self._verdict.final else frozenset(self._slices)

    def _advance(self, event: Json) -> Verdict:
        relevant = bool(self._said.relevant) and self._said.is_relevant(event)
        after: dict[Slice, Binding] = {}
        for (_, state), bound in self._slices.items():
            for binding in self._bindings(state, event, bound):
                letter = tuple(self._holds(number, event, binding, relevant) for number in self._run.seen(state))
                to = self._run.next(state, letter)
                match self._run.verdicts[to]:
                    case Verdict.TRUE:
                        return Verdict.TRUE
                    case Verdict.UNKNOWN:
                        kept = self._remembered(binding, to)
                        after[_assignment(kept), to] = kept
                    case Verdict.FALSE:
                        pass
        self._slices = {one: binding for one, binding in after.items() if not _redundant(one, after)}
        if len(self._slices) > self._limit:
            names = sorted({name for binding in self._slices.values() for name in binding})
            raise TooLarge(f"slices, one for each assignment of {', '.join(names)}", limit=self._limit)
        return Verdict.UNKNOWN if self._slices else Verdict.FALSE

    def _bindings(self, state: int, event: Json, bound: Binding) -> Iterator[Binding]:
        """The assignment of a slice, and those that the event extends it to."""
        yield bound
        seen: set[Assignment] = set()
        for number in self._run.seen(state):
            if number in self._events:
                more = _matched(self._events[number], event, bound)
                if more is not None and len(more) > len(bound) and (name := _assignment(more)) not in seen:
                    seen.add(name)
                    yield more

    def _remembered(self, binding: Binding, state: int) -> Binding:
        """The values that may still be asked for."""
        asked: set[str] = set()
        for number in self._run.ahead[state] if binding else ():
            asked |= set(rigid_variables(self._events[number]) if number in self._events else ())
            asked |= set(guard_variables(self._said.guards[number]) if number in self._said.guards else ())
        return {name: value for name, value in binding.items() if name in asked}

    def _holds(self, number: int, event: Json, bound: Binding, relevant: bool) -> bool:
        if number in self._events:
            more = _matched(self._events[number], event, bound)
            return more is not None and len(more) == len(bound)
        if number in self._said.guards:
            guard = self._said.guards[number]
            return not all(name in bound for name in guard_variables(guard)) or holds(guard, bound)
        return relevant


def _matched(pattern: Pattern, event: Json, bound: Binding) -> dict[str, Json] | None:
    found = match(pattern, event, bound)
    return None if found is None else rigid(found)


def _assignment(bound: Binding) -> Assignment:
    return frozenset((name, key(value)) for name, value in bound.items())


def _redundant(one: Slice, slices: Mapping[Slice, Binding]) -> bool:
    """Whether a smaller assignment is in the same state."""
    assignment, state = one
    sizes = range(len(assignment)) if len(assignment) <= FEW else {0, len(assignment) - 1}
    return any((frozenset(part), state) in slices for size in sizes for part in combinations(assignment, size))
