"""Random traces in which a tree is detected: an order of a random scenario, values that fit, and some noise where it does no harm."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Final

from cross_check.guided.events import built, ignored, noise, some_event
from cross_check.guided.orders import Cyclic, random_order
from cross_check.guided.scenarios import Kept, Scenarios
from cross_check.guided.values import Demand, Unmet, guard_demands, meeting
from rvaft.engine import engine
from rvaft.errors import RvaftError
from rvaft.patterns import Anything, Binding, rigid_variables
from rvaft.random_traces import interesting_values
from rvaft.rules.words import listing
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

ATTEMPTS: Final = 100
_NOISE: Final = 3
"""The most events of noise in one trace."""
_BUILDS: Final = 40
"""How many events to build for an occurrence so that one is not ignored; after the first quarter from all values."""


@dataclass(frozen=True, slots=True)
class Manner:
    """What the events look like, beside what the tree demands; probabilities between 0 and 1.

    Without `values` the free values are taken from those that make a difference to the tree, of all types. An
    `overlapping` event also has the fields of another runtime event of the tree.
    """

    values: tuple[Json, ...] = ()
    overlapping: float = 0.0
    noise: float = 0.4


WILD: Final = Manner(overlapping=0.1)
"""For tests: whatever might go wrong."""

PLAIN: Final = Manner(values=tuple(range(10)))
"""For people: small numbers where any value will do."""


class NoTraceFound(RvaftError, LookupError):
    """No detecting trace was found; `nodes` are those whose guards or events stood in the way. There may be one all the same."""

    def __init__(self, why: str, *, attempts: int, nodes: Sequence[str] = ()) -> None:
        self.why = why
        self.attempts = attempts
        self.nodes = tuple(nodes)
        super().__init__(f"no detecting trace found in {attempts} attempt{'s' if attempts > 1 else ''}: {why}")


def detecting(
    random: Random,
    tree: RVAFT,
    semantics: Semantics = Semantics.PROJECTED,
    *,
    manner: Manner = WILD,
    longest: int | None = None,
    attempts: int = ATTEMPTS,
) -> list[Json]:
    """A trace after which, and not before, the monitor says ⊤; with at most `longest` events.

    The tree keeps the rules of `rvaft check`. Raises `NoTraceFound`, and what the monitor raises (`TooLarge`).
    """
    trace = guided(random, tree, semantics, manner=manner, longest=longest, attempts=attempts)
    monitor = engine(tree, semantics)
    for position, event in enumerate(trace, 1):
        if monitor.step(event) is Verdict.TRUE:
            return trace[:position]
    # The trace is a match by its construction: passing it over would hide what a cross-check looks for.
    raise AssertionError(f"the monitor does not detect {tree.root} under {semantics} in {trace}")


def guided(
    random: Random,
    tree: RVAFT,
    semantics: Semantics = Semantics.PROJECTED,
    *,
    manner: Manner = WILD,
    longest: int | None = None,
    attempts: int = ATTEMPTS,
) -> list[Json]:
    """A trace that holds a match of a random scenario, by its construction alone: no monitor is asked.

    It may be detected before its end, where a part of it is a match too. Raises `NoTraceFound`.
    """
    making = _Making(random, tree, Semantics(semantics), manner)
    scenarios = Scenarios(tree)
    why, nodes, shortest = "", list[str](), None
    for attempt in range(attempts):
        kept = scenarios.draw(random, lean=longest is not None and attempt >= attempts // 2)
        if kept is None:
            why = "every scenario has a guard without variables that does not hold"
            break
        try:
            order = random_order(random, tree, kept)
            if longest is None or len(order) <= longest:
                return making.noisy(making.trace(kept, order), longest)
            shortest = len(order) if shortest is None else min(shortest, len(order))
        except Cyclic as cyclic:
            scenarios.ban(random, cyclic.edges)
            why = why or "every scenario met has an event that comes before itself"
        except Unmet as unmet:
            refusing = {demand.node for demand in unmet.refusing}
            nodes = [name for name in tree.order if name in refusing]
            scenarios.ban(random, nodes)
            why = _objection(nodes, unmet.refusing)
    if shortest is not None:
        why = f"the shortest scenario met has {shortest} events" + (f"; {why}" if why else "")
    raise NoTraceFound(why, attempts=attempts, nodes=nodes)


class _Making:
    """Events for the occurrences of one scenario after the other, for one tree under one semantics."""

    def __init__(self, random: Random, tree: RVAFT, semantics: Semantics, manner: Manner) -> None:
        self.random = random
        self.tree = tree
        self.semantics = semantics
        self.manner = manner
        self.others = interesting_values(tree)
        self.values = manner.values or tuple(random.choice(self.others) for _ in range(4))
        self.minds_ignored = semantics is Semantics.PROJECTED and bool(tree.ignores)

    def trace(self, kept: Kept, order: list[str]) -> list[Json]:
        """An event for each occurrence, in this order; raises `Unmet`."""
        events: dict[str, Json] = {}
        demands: list[Demand] = []
        for name in kept:
            guard = self.tree.nodes[name].when
            if guard is not None:
                demands += guard_demands(name, guard)
        patterns = {name: self.tree.pattern(name) or Anything() for name in order}
        if self.minds_ignored:
            demands += [
                Demand(name, rigid_variables(pattern), partial(self._passes, events, name))
                for name, pattern in patterns.items()
            ]
        names = dict.fromkeys(name for pattern in patterns.values() for name in rigid_variables(pattern))
        binding = meeting(self.random, demands, names, self.values, self.others)
        return [events[name] if name in events else self._event(name, binding, self.values) for name in order]

    def _passes(self, events: dict[str, Json], name: str, binding: Binding) -> bool:
        """Whether some event for an occurrence is not ignored; it is noted."""
        for build in range(_BUILDS):
            event = self._event(name, binding, self.values if build < _BUILDS // 4 else self.others)
            if not ignored(self.tree, event):
                events[name] = event
                return True
        return False

    def _event(self, name: str, binding: Binding, values: Sequence[Json]) -> Json:
        event = built(self.random, self.tree.pattern(name) or Anything(), binding, values)
        if self.random.random() < self.manner.overlapping:
            event = {**some_event(self.random, self.tree, values), **event}
        return event

    def noisy(self, trace: list[Json], longest: int | None) -> list[Json]:
        """The trace with events in between that take nothing from it; under `strict` there are none."""
        if self.semantics is Semantics.STRICT or self.random.random() >= self.manner.noise:
            return trace
        room = _NOISE if longest is None else min(_NOISE, longest - len(trace))
        result = list(trace)
        for _ in range(self.random.randint(0, max(room, 0))):
            if self.semantics is Semantics.SCATTERED and self.random.random() < 0.5:
                event = some_event(self.random, self.tree, self.values)
            else:
                event = noise(self.random, self.tree, self.values)
            if event is not None:
                result.insert(self.random.randint(0, len(result)), event)
        return result


def _objection(nodes: Sequence[str], refusing: Sequence[Demand]) -> str:
    """Why a scenario has no events: what the demands of these nodes were that refused."""
    of_guards = {demand.node for demand in refusing if demand.guard is not None}
    of_events = {demand.node for demand in refusing if demand.guard is None}
    guarded = [name for name in nodes if name in of_guards]
    dropped = [name for name in nodes if name in of_events]
    said = []
    if guarded:
        plural = len(guarded) > 1
        said.append(
            f"the guard{'s' if plural else ''} of {listing(guarded)} {'do' if plural else 'does'} not hold "
            "with any value that was tried"
        )
    if dropped:
        said.append(f"`ignore` takes the events of {listing(dropped)} with any value that was tried")
    return "; ".join(said)
