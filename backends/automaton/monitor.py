"""Runs a HOA text on events, in slices (`backends.slices`), and says what the text asks of events."""

from collections.abc import Hashable, Iterator, Mapping
from functools import cache, lru_cache
from typing import NamedTuple

from backends import slices
from backends.automaton.hoa_reader import Fit, HoaTable, Meaning, error_at, meaning, table
from backends.automaton.hoa_writer import ALIVE
from backends.automaton.letters import apart
from rvaft.backend import Observed
from rvaft.model.guards import renamed
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Binding, Literal, ObjectPattern, Pattern, match, rigid, rigid_variables, variables
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor


class EventProposition(NamedTuple):
    """A proposition that stands for events: their pattern, and the variables that it shares with others."""

    pattern: Pattern
    shared: frozenset[str]


class HoaProgram:
    """A text made ready to run; monitors share it."""

    def __init__(self, text: str, atoms: Mapping[str, Pattern]) -> None:
        self.said, self.table = _read(text)
        explained = {*self.said.events, *self.said.guards, *self.said.relevant}
        names = dict(enumerate(self.table.names))
        for number in (*self.said.events, *self.said.guards, *self.said.relevant):
            if number not in names:
                raise error_at(text, 0, f"the text has no proposition {number}, but says what it means")
        patterns = dict(self.said.events)
        for number, name in names.items():
            if number not in explained and name != ALIVE:
                patterns[number] = atoms.get(name, ObjectPattern((("event", Literal(name)),)))
        self.events = {
            number: EventProposition(pattern, frozenset(rigid_variables(pattern)))
            for number, pattern in patterns.items()
        }

    @cache  # noqa: B019 -- as many as states, for as long as the program is used
    def matter(self, state: int) -> frozenset[str]:
        """The variables that the text may still ask for from a state on."""
        asked = self.table.ahead[state]
        shared = [event.shared for number, event in self.events.items() if number in asked]
        return frozenset().union(*shared, *(guard_variables(g) for n, g in self.said.guards.items() if n in asked))

    def questions(self) -> Iterator[Observed]:
        """What the text asks of events: that they match its propositions, and what says whether they are relevant."""
        for pattern, shared in self.events.values():
            yield Observed(pattern)
            for (
                guard
            ) in self.said.guards.values():  # a proposition of its own, about values that an event gives variables
                if not shared.isdisjoint(guard_variables(guard)):
                    yield Observed(pattern, guard)
        if self.said.relevant:
            for fit in (*self.said.alphabet, *self.said.ignored):
                yield _apart(fit)


@lru_cache(maxsize=8)
def _read(text: str) -> tuple[Meaning, HoaTable]:
    """What a text says; kept for monitors of the same text, which only read it."""
    return meaning(text), table(text)


def _apart(fit: Fit) -> Observed:
    """With variables of its own: some values will do."""
    own = {name: f"_{name}" for name in variables(fit.pattern) if not name.startswith("_")}
    return Observed(apart(fit.pattern), None if fit.guard is None else renamed(fit.guard, own))


def monitor(text: str, atoms: Mapping[str, Pattern]) -> Monitor:
    """A monitor that runs a HOA text; `atoms` gives the events of propositions that the text does not define."""
    return HoaMonitor(HoaProgram(text, atoms))


def observed(text: str, atoms: Mapping[str, Pattern]) -> tuple[Observed, ...]:
    """All that such a monitor asks of events."""
    return tuple(dict.fromkeys(HoaProgram(text, atoms).questions()))


class HoaMonitor(Monitor):
    """Runs one program in slices; `TooLarge` beyond `limit` of them."""

    def __init__(self, program: HoaProgram, *, limit: int = slices.LIMIT) -> None:
        super().__init__()
        self._program = program
        self._limit = limit
        self._slices = slices.start(0)

    @property
    def state(self) -> Hashable:
        """The slices; after a final verdict only that."""
        return self._verdict if self._verdict.final else frozenset(self._slices)

    def _advance(self, event: Json) -> Verdict:
        run, events, said = self._program.table, self._program.events, self._program.said
        relevant = bool(said.relevant) and said.is_relevant(event)

        def extensions(state: int, bound: Binding) -> Iterator[Binding]:
            for number in run.seen(state):
                if number in events and not events[number].shared <= bound.keys():
                    found = match(events[number].pattern, event, bound)
                    if found is not None:
                        yield rigid(found)

        def is_true(number: int, bound: Binding) -> bool:
            if number in events:
                pattern, shared = events[number]
                return shared <= bound.keys() and match(pattern, event, bound) is not None
            return slices.passes(said.guards[number], bound) if number in said.guards else relevant

        def step(state: int, bound: Binding) -> tuple[Verdict, int]:
            to = run.next(state, tuple([is_true(number, bound) for number in run.seen(state)]))
            return run.verdicts[to], to

        after = slices.advance(self._slices, extensions, step, matter=self._program.matter, limit=self._limit)
        if after is None:
            return Verdict.TRUE
        self._slices = after
        return Verdict.UNKNOWN if after else Verdict.FALSE
