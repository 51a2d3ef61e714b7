"""Rates of leaves, estimated from logs by maximum likelihood, with exact 95 % intervals (Garwood, 1936)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from rvaft.errors import installed
from rvaft.model.quantities import NANOSECONDS
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.risk.model import PACKAGES, RiskError, RiskTree, later_leaves
from rvaft.risk.runtime import LeafPattern, leaf_patterns

CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True)
class Rate:
    """The rate of a leaf per second: `events` in `seconds` of observation, over all instances.

    `low` and `high` bound the rate with a confidence of 95 %. `left_out` is why there is none.
    """

    leaf: str
    events: int
    seconds: float
    rate: float
    low: float
    high: float
    left_out: str | None = None


@dataclass(slots=True)
class _Seen:
    events: int = 0
    seconds: float = 0.0


class RateEstimate:
    """Counts the events of the leaves of a tree in logs with times, each log observed from its first to its last event.

    The event that begins an observation is not counted, since what began with it was not waited for.
    The rate of an event that recurs is that of one instance: each binding of the leaf's variables is
    observed from its first event on. A failure is observed until it happens, and not in a log that
    begins with it. Late events do not count.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> tree = rvaft.loads("event e(k) = {k: k}; time t as s; top and a b; a on e(1); b on e(2);")
    >>> estimate = RateEstimate(tree, of_tree(tree))
    >>> estimate.add([{"k": 9, "t": 0}, {"k": 1, "t": 3}, {"k": 1, "t": 5}, {"k": 9, "t": 10}])
    >>> [(one.leaf, one.events, one.rate) for one in estimate.rates()]
    [('a', 2, 0.2), ('b', 0, 0.0)]

    Raises `RiskError` for a tree without `time`.
    """

    def __init__(self, tree: RVAFT, form: RiskTree) -> None:
        if tree.time is None:
            raise RiskError(
                "rates need the time of events: add its field and format to the tree, as in `time t as iso8601;`"
            )
        self._time = tree.time
        self._late: dict[str, str] = {}
        leaves = [form.leaves[name] for name in form.order() if name in form.leaves]
        self._patterns: dict[str, LeafPattern] = {one.leaf.name: one for one in leaf_patterns(tree, leaves)}
        for leaf in leaves:
            if leaf.name not in self._patterns:
                self._late[leaf.name] = "no event shows it"
            elif leaf.once and self._patterns[leaf.name].variables:
                self._late[leaf.name] = "it is a failure of instances, and no event shows those that have not failed"
            elif leaf.once and leaf.name in later_leaves(form):
                self._late[leaf.name] = "it is a failure whose clock starts with a later part of a sequence"
            elif not set(self._patterns[leaf.name].names) <= set(self._patterns[leaf.name].variables):
                self._late[leaf.name] = "its guard compares values of other events"
        self._leaves = leaves
        self._seen = {leaf.name: _Seen() for leaf in leaves}

    def add(self, events: Iterable[Json]) -> None:
        """Add one log."""
        first: int | None = None
        last: int | None = None
        latest: int | None = None
        found: dict[str, dict[object, list[int]]] = {name: {} for name in self._patterns}
        opened: set[str] = set()
        for event in events:
            late, latest = self._time.is_late(event, latest)
            time = self._time.read(event)
            if time is None or late:
                continue
            opens = first is None
            first = time if first is None else min(first, time)
            last = time if last is None else max(last, time)
            for name, one in self._patterns.items():
                for _, binding, values in one.readings(event):
                    if not one.holds(values):
                        continue
                    if opens and not binding:
                        opened.add(name)
                    else:
                        found[name].setdefault(binding, []).append(time)
        if first is None or last is None:
            return
        for leaf in self._leaves:
            if leaf.once and leaf.name in opened:  # it had failed when the observation began
                continue
            seen = self._seen[leaf.name]
            times = found.get(leaf.name, {})
            for own in times.values() or ([] if self._bound(leaf.name) else [[]]):
                begin, counted = (min(own), len(own) - 1) if self._bound(leaf.name) else (first, len(own))
                if leaf.once:
                    seen.events += bool(counted)
                    seen.seconds += (min(own, default=last) - begin) / NANOSECONDS
                else:
                    seen.events += counted
                    seen.seconds += (last - begin) / NANOSECONDS

    def _bound(self, name: str) -> bool:
        return name in self._patterns and bool(self._patterns[name].variables)

    def rates(self) -> Iterator[Rate]:
        """Yield the rate of each leaf, in the order of the tree."""
        stats = installed("scipy.stats", "scipy", PACKAGES)
        rest = (1 - CONFIDENCE) / 2
        for leaf in self._leaves:
            seen = self._seen[leaf.name]
            why = self._late.get(leaf.name) or (None if seen.seconds else "no time was observed")
            if why is not None:
                yield Rate(leaf.node, seen.events, seen.seconds, 0.0, 0.0, float("inf"), why)
                continue
            low = float(stats.chi2.ppf(rest, 2 * seen.events)) / 2 if seen.events else 0.0
            high = float(stats.chi2.ppf(1 - rest, 2 * seen.events + 2)) / 2
            yield Rate(
                leaf.node,
                seen.events,
                seen.seconds,
                seen.events / seen.seconds,
                low / seen.seconds,
                high / seen.seconds,
            )
