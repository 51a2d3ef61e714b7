"""Probabilities by simulation, for what no chain describes: windows, absent events, other semantics.

Logs are drawn at random and read by the monitor itself, so what is counted are detections. An
estimate has its seed, and Wilson's interval of 95 %.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from random import Random
from typing import Any, Final

from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.guards import time_points, variables
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    rigid_variables,
    walk,
)
from rvaft.model.quantities import NANOSECONDS
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.risk.model import Leaf, Op, RiskError, RiskTree, below, later_leaves
from rvaft.risk.runtime import leaf_patterns

DEFAULT_SAMPLES: Final = 10_000
_Z: Final = 1.959963984540054
_MOST_EVENTS: Final = 100_000
"""The greatest number of events that one log is expected to have."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """The share of the samples in which the tree was detected, with an interval of 95 % confidence."""

    probability: float
    low: float
    high: float
    samples: int
    seed: int


def wilson(hits: int, samples: int) -> tuple[float, float]:
    """Return Wilson's interval of a share, with 95 % confidence.

    >>> [round(one, 4) for one in wilson(50, 100)]
    [0.4038, 0.5962]
    """
    share, square = hits / samples, _Z * _Z / samples
    middle = (share + square / 2) / (1 + square)
    half = _Z * math.sqrt(share * (1 - share) / samples + square / (4 * samples)) / (1 + square)
    return max(0.0, middle - half), min(1.0, middle + half)


class Simulation:
    """Draws logs of the events of a tree, with the rates of its leaves.

    Raises `RiskError` for a leaf that no event shows, a leaf whose clock starts later, or a guard that a
    drawn event would not satisfy.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> tree = rvaft.loads("t sand x y; x lambda=.5; y lambda=.2 once=no;")
    >>> found = Simulation(tree, of_tree(tree)).estimate(rvaft.monitor(tree, semantics="scattered"), 1.0, samples=2000)
    >>> found.low < 0.0398 < found.high
    True
    """

    def __init__(self, tree: RVAFT, form: RiskTree) -> None:
        form.require_numbers()
        self._timed = form.unit == "s"
        self._time = tree.time
        leaves = [form.leaves[name] for name in form.order() if name in form.leaves]
        self.patterns = list(leaf_patterns(tree, leaves))
        shown = {one.leaf.name for one in self.patterns}
        for leaf in leaves:
            if leaf.name not in shown and not leaf.guard:
                raise RiskError(f"no event shows {leaf.node}, so a simulated log cannot have it")
            _check_guard(tree, leaf)
        later = later_leaves(form)
        for one in self.patterns:
            if one.leaf.once and one.leaf.name in later:
                raise RiskError(
                    f"{one.leaf.node} is a failure whose clock starts with a later part of a sequence, which a log "
                    "does not tell: write once=no for an event that recurs"
                )
            if one.leaf.numbers.chance and one.leaf.name in later:
                raise RiskError(
                    f"{one.leaf.node} has a probability and happens when a later part of a sequence begins, which a "
                    "log does not tell: write a rate"
                )
        tied = _tied(form)
        if len(tied) > 1:
            raise RiskError(f"{tied[0]} and {tied[1]} happen at time 0, and their order would decide: write rates")
        self.events = self._drawn_events()
        self._leaves = [one.leaf for one in self.patterns]

    def _drawn_events(self) -> dict[str, dict[str, Json]]:
        """Return an event of each leaf, all of one instance: every variable has one value, which no pattern names."""
        avoided = {str(value) for one in self.patterns for value in _literals(one.pattern)}
        wrong = ""
        fresh = next(number for number in count(1_000_003) if str(number) not in avoided)
        for value in (fresh, *(one for one in (0, 1, -1) if str(one) not in avoided)):
            found: dict[str, dict[str, Json]] = {}
            for one in self.patterns:
                values: dict[str, Json] = {}
                event = _sample(one.pattern, values, value)
                if not isinstance(event, dict):
                    raise RiskError(f"the event of {one.leaf.node} is no object")
                if not one.holds(values):
                    wrong = wrong or one.leaf.node
                    break
                found[one.leaf.name] = event
            else:
                return found
        raise RiskError(f"the guard of {wrong} depends on values, which a simulation does not draw")

    def estimate(
        self,
        monitor: Monitor,
        horizon: float,
        *,
        samples: int = DEFAULT_SAMPLES,
        seed: int = 1,
        now: int = 0,
        seen: frozenset[str] = frozenset(),
    ) -> Estimate:
        """Return how often the monitor detects within the horizon, from its present state.

        The monitor is not changed. `now` is the present time in nanoseconds, `seen` has the failures that
        have happened.
        """
        random = Random(seed)  # noqa: S311 (a seed makes it repeatable)
        expected = horizon * sum(leaf.numbers.rate or 0.0 for leaf in self._leaves if not leaf.once)
        if expected > _MOST_EVENTS:
            raise RiskError(f"a log of this length would have {expected:.3g} events: ask for a shorter time")
        hits = 0
        for _ in range(samples):
            copy = monitor.fork()
            for at, leaf in self._drawn(random, horizon, seen):
                if copy.step(self._stamped(self.events[leaf.name], now, at)).final:
                    break
            if not copy.verdict.final and self._time is not None:
                copy.decide(now + round(horizon * NANOSECONDS))
            hits += copy.verdict is Verdict.TRUE
        low, high = wilson(hits, samples)
        return Estimate(hits / samples, low, high, samples, seed)

    def _drawn(self, random: Random, horizon: float, seen: frozenset[str]) -> list[tuple[float, Leaf]]:
        found: list[tuple[float, Leaf]] = []
        for leaf in self._leaves:
            if leaf.once and leaf.name in seen:
                continue
            if leaf.numbers.chance is not None:
                if random.random() < leaf.numbers.chance:
                    found.extend([(0.0, leaf)] * leaf.times)
                continue
            found.extend((at, leaf) for at in _times(random, leaf, horizon))
        random.shuffle(found)  # leaves with a probability happen at time 0, in any order
        return sorted(found, key=lambda one: one[0])

    def _stamped(self, event: dict[str, Json], now: int, at: float) -> dict[str, Json]:
        if self._time is None:
            return event
        return stamped(event, self._time, now + round(at * NANOSECONDS))


def _times(random: Random, leaf: Leaf, horizon: float) -> Iterator[float]:
    rate, shape = leaf.numbers.rate or 0.0, leaf.numbers.shape
    at, left = 0.0, leaf.times if leaf.once else None
    while rate and left != 0:
        at += random.expovariate(1.0) ** (1 / shape) / rate
        if at > horizon:
            return
        yield at
        left = None if left is None else left - 1


def stamped(event: Mapping[str, Json], time: EventTime, nanoseconds: int) -> dict[str, Json]:
    """Return an event with a time; raises `RiskError` for a format that is not written here."""
    value = _written(time, nanoseconds)
    *above, last = time.field
    found = inner = dict(event)
    for name in above:
        old = inner.get(name)
        fresh: dict[str, Any] = dict(old) if isinstance(old, Mapping) else {}
        inner[name] = fresh
        inner = fresh
    inner[last] = value
    return found


def _written(time: EventTime, nanoseconds: int) -> Json:
    match time.format:
        case TimeFormat.NANOSECONDS:
            return nanoseconds
        case TimeFormat.MICROSECONDS:
            return _decimal(nanoseconds, 1000)
        case TimeFormat.MILLISECONDS:
            return _decimal(nanoseconds, 1_000_000)
        case TimeFormat.SECONDS:
            return _decimal(nanoseconds, NANOSECONDS)
        case TimeFormat.ROS:
            return {"sec": nanoseconds // NANOSECONDS, "nanosec": nanoseconds % NANOSECONDS}
        case TimeFormat.FILETIME:
            return nanoseconds // 100 + 116_444_736_000_000_000
        case TimeFormat.ISO8601:
            from datetime import UTC, datetime, timedelta  # noqa: PLC0415 -- imported on use

            whole = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=nanoseconds // NANOSECONDS)
            return f"{whole:%Y-%m-%dT%H:%M:%S}.{nanoseconds % NANOSECONDS:09d}Z"
        case _:
            raise RiskError(
                f"a simulation writes no times as {time.format}: use s, ms, us, ns, ros, iso8601 or filetime"
            )


def _decimal(nanoseconds: int, size: int) -> str:
    whole, part = divmod(nanoseconds, size)
    return f"{whole}.{part:0{len(str(size)) - 1}d}"


def _check_guard(tree: RVAFT, leaf: Leaf) -> None:
    """Raise `RiskError` for a guard over the values of several events: what is drawn has no distribution of values."""
    guard = tree.guard(leaf.node)
    pattern = None if leaf.guard else tree.pattern(leaf.node)
    own = () if pattern is None else rigid_variables(pattern)
    points = {point.name for point in time_points(guard)}
    if any(name not in own and name not in points for name in variables(guard)):
        raise RiskError(f"the guard of {leaf.node} compares values of several events, which a simulation does not draw")


def _tied(form: RiskTree) -> list[str]:
    """Return the leaves with a probability below gates in which the order of failures decides."""
    gates = [name for name, gate in form.gates.items() if gate.op in (Op.PRIORITY, Op.FIRST)]
    leaves = [leaf for name in below(form, gates) if (leaf := form.leaves.get(name)) is not None]
    return [leaf.node for leaf in leaves if leaf.numbers.chance and not leaf.guard]


def _literals(pattern: Pattern) -> Iterator[Json]:
    return (part.value for part in walk(pattern) if isinstance(part, Literal))


def _sample(pattern: Pattern, values: dict[str, Json], fresh: int) -> Json:
    """Return an event of a pattern, in which all variables have the value `fresh`: that of one instance."""
    match pattern:
        case Literal(value=value):
            return value
        case Variable(name=name):
            return values.setdefault(name, fresh)
        case Anything():
            return fresh
        case ObjectPattern(fields=fields):
            return {name: _sample(inner, values, fresh) for name, inner in fields}
        case ListPattern():
            return [_sample(inner, values, fresh) for inner in pattern.items]
        case SomeItem():
            return [_sample(pattern.item, values, fresh)]
