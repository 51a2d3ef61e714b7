"""The events that every language runs: random traces that are led towards a detection, the same for the same seed.

A random trace alone would soon be hopeless in most trees, and then no monitor has anything to do. So each event is one that the engine waits
for, with values under which hope remains if some are found; one in ten fits nothing, where that does no harm. One trace in four is led on
purpose, somewhere on its way, to where no hope is left, if the tree has such a place: a text has to say that, too.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from time import process_time
from typing import Final, NamedTuple

from rvaft.engine import Engine, engine
from rvaft.errors import RvaftError
from rvaft.patterns import Anything, Literal, substitute
from rvaft.random_traces import fitting, interesting_values
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

EVENTS: Final = 240
"""Events of all walks together; the last walk ends with them."""
LONGEST: Final = 60
"""Events after which a walk ends without a verdict."""
_NOISE: Final = 0.1
_DOOMED: Final = 4
"""One walk in so many is led to where no hope is left."""
_TRIES: Final = 16
"""How many events to try for one that leaves hope, or none."""
_FOREIGN: Final = "none of the tree's"
SCALARS: Final = (str, int, float, bool, type(None))


@dataclass(frozen=True, slots=True)
class Walk:
    """A trace, and the verdict after each of its events."""

    events: tuple[Json, ...]
    verdicts: tuple[Verdict, ...]


def walks(
    tree: RVAFT, semantics: Semantics, seed: int, *, events: int = EVENTS, seconds: float = math.inf
) -> tuple[Walk, ...]:
    """So many events in traces that each end with a final verdict or when they are long; fewer where the engine gives up or takes longer."""
    random = Random(f"{seed} {semantics}")  # noqa: S311 (no secret)
    values = [value for value in interesting_values(tree) if isinstance(value, SCALARS)]
    start = engine(tree, semantics)
    found: list[Walk] = []
    left, until = events, process_time() + seconds
    while left > 0 and process_time() < until:
        doomed = semantics is not Semantics.SCATTERED and len(found) % _DOOMED == _DOOMED - 1  # there hope never ends
        doom = random.randrange(len(found[-1].events)) if doomed else LONGEST
        walk = _walk(random, start.fork(), values, _Way(min(left, LONGEST), doom, until))
        if not walk.events:
            break
        found.append(walk)
        left -= len(walk.events)
    return tuple(found)


class _Way(NamedTuple):
    """How a walk goes: the most events, after how many of them whatever ends all hope is what happens, and until when."""

    longest: int
    doom: int
    until: float


def _walk(random: Random, monitor: Engine, values: Sequence[Json], way: _Way) -> Walk:
    taken: list[Json] = []
    verdicts: list[Verdict] = []
    noisy = monitor.semantics is not Semantics.STRICT
    try:
        while len(taken) < way.longest and not monitor.verdict.final and process_time() < way.until:
            event = _hopeless(random, monitor, values) if len(taken) >= way.doom else None
            if event is None:
                noise = noisy and random.random() < _NOISE
                event = {_FOREIGN: len(taken)} if noise else _hopeful(random, monitor, values)
            verdicts.append(monitor.step(event))
            taken.append(event)
    except RvaftError:
        pass  # more partial matches than the engine follows; what there is will do
    return Walk(tuple(taken), tuple(verdicts))


def _hopeless(random: Random, monitor: Engine, values: Sequence[Json]) -> Json | None:
    """An event that leaves no hope, if one is found: most often one of the tree's own."""
    tree = monitor.tree
    nodes = random.sample(tree.occurrences, min(len(tree.occurrences), _TRIES))
    tried: list[Json] = [fitting(random, tree.pattern(node) or Anything(), values) for node in nodes]
    tried.insert(random.randrange(len(tried) + 1), {_FOREIGN: 0})
    return next((event for event in tried if monitor.fork().step(event) is Verdict.FALSE), None)


def _hopeful(random: Random, monitor: Engine, values: Sequence[Json]) -> Json:
    """An event that is waited for, and, if one is found, leaves hope."""
    event: Json = {}
    for node, variables in _candidates(random, monitor):
        bound = {name: Literal(value) for name, value in variables.items() if isinstance(value, SCALARS)}
        event = fitting(random, substitute(monitor.tree.pattern(node) or Anything(), bound), values)
        if monitor.fork().step(event) is not Verdict.FALSE:
            break
    return event


def _candidates(random: Random, monitor: Engine) -> Iterator[tuple[str, Mapping[str, Json]]]:
    """Nodes whose events to try, with values that are bound; what is waited for is only asked where trying is no cheaper."""
    tree = monitor.tree
    if monitor.semantics is not Semantics.SCATTERED and not tree.variables:  # where a wrong guess shows at once
        yield from ((node, {}) for node in random.sample(tree.occurrences, min(len(tree.occurrences), _TRIES)))
    awaited = [(one.node, record.variables) for record in monitor.pending(limit=1) for one in record.awaited]
    yield from (random.choice(awaited) for _ in range(_TRIES if awaited else 0))
