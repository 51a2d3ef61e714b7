"""The risk under a semantics in which events break a match: a chain over the states of the monitor itself.

The monitor is tried with one event of each leaf; equal states have equal futures.
"""

from collections.abc import Hashable
from typing import Final, Self, TypeAlias

from rvaft.errors import TooLarge, installed
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor, twin
from rvaft.risk.model import PACKAGES, RiskError, RiskTree
from rvaft.risk.runtime import Next, Outlook
from rvaft.risk.simulation import Simulation
from rvaft.risk.transient import reached

DEFAULT_STATES: Final = 20_000

Place: TypeAlias = tuple[Hashable, frozenset[str]]
"""The state of a monitor, and the failures that have happened."""


class MonitorStates:
    """Follows the events of a log with a monitor, and tells the risk after each.

    Raises `RiskError` for trees with variables, windows, lateness or probabilities, and `TooLarge`
    beyond a number of states.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> tree = rvaft.loads("t sand x y; x lambda=.5 once=no; y lambda=.2 once=no;")
    >>> watching = MonitorStates(tree, of_tree(tree), 1.0, rvaft.monitor(tree, semantics="projected"))
    >>> round(watching.risk, 6), round(watching.step({"event": "x"}), 6)
    (0.031797, 0.143833)
    """

    def __init__(
        self, tree: RVAFT, form: RiskTree, horizon: float, monitor: Monitor, *, states: int = DEFAULT_STATES
    ) -> None:
        if form.timed:
            raise RiskError(
                f"windows and absent events ({form.timed[0]}) have no chain: `rvaft risk --simulate N` estimates"
            )
        if tree.variables:
            raise RiskError("with variables, the risk is computed under --semantics scattered only")
        if tree.time is not None and tree.time.late is not None:
            raise RiskError("with `late`, the risk is computed under --semantics scattered only")
        simulated = Simulation(tree, form)
        wrong = next((one.leaf for one in simulated.patterns if one.leaf.numbers.chance is not None), None)
        if wrong is not None:
            raise RiskError(f"{wrong.node} has a probability, not a rate: see --semantics scattered")
        self._patterns, self._samples = simulated.patterns, simulated.events
        self._horizon, self._limit = horizon, states
        self._start = monitor
        self._known: dict[Place, float] = {}
        self._begin()

    def _begin(self) -> None:
        self._monitor = self._start.fork()
        self._failed: frozenset[str] = frozenset()
        self.contradictions = 0
        """The number of events that the model excludes."""
        self.risk = self._risk(self._monitor, self._failed)

    def fresh(self) -> Self:
        """Return one that has read no event, and shares what is solved."""
        made = twin(self)
        made._begin()  # noqa: SLF001 (its own)
        return made

    def step(self, event: Json) -> float:
        """Read an event and return the risk after it; raises `TooLarge`."""
        shown = [one.leaf for one in self._patterns if any(True for _ in one.readings(event))]
        again = [leaf for leaf in shown if leaf.once and leaf.name in self._failed]
        self.contradictions += bool(again)
        self._failed |= {leaf.name for leaf in shown if leaf.once}
        self._monitor.step(event)
        self.risk = self._risk(self._monitor, self._failed)
        return self.risk

    def outlook(self, most: int = 5) -> Outlook:
        """Return the risk with what may come next, at most `most` leaves."""
        coming: list[Next] = []
        for one in self._patterns:
            if not (one.leaf.once and one.leaf.name in self._failed):
                copy = self._monitor.fork()
                copy.step(self._samples[one.leaf.name])
                failed = self._failed | {one.leaf.name} if one.leaf.once else self._failed
                coming.append(Next(one.leaf.name, self._risk(copy, failed)))
        coming = sorted((one for one in coming if one.risk > self.risk), key=lambda one: -one.risk)
        return Outlook(self.risk, {}, tuple(coming[:most]), self.contradictions)

    def _risk(self, monitor: Monitor, failed: frozenset[str]) -> float:
        if monitor.verdict.final:
            return 1.0 if monitor.verdict is Verdict.TRUE else 0.0
        place = monitor.state, failed
        if place not in self._known:
            self._solve(place, monitor)
        return self._known[place]

    def _solve(self, place: Place, monitor: Monitor) -> None:
        """Solve the chain of the states that can be reached from one, for all of them."""
        sparse = installed("scipy.sparse", "scipy", PACKAGES)
        numpy = installed("numpy", "NumPy", "pip install numpy")
        places, monitors = [place], [monitor.fork()]
        index = {place: 0}
        rows: list[tuple[int, int, float]] = []
        for number, (_, failed) in enumerate(places):  # which grows
            here = monitors[number]
            for one in () if here.verdict.final else self._patterns:
                rate = one.leaf.numbers.rate or 0.0
                if not rate or one.leaf.name in failed:
                    continue
                copy = here.fork()
                copy.step(self._samples[one.leaf.name])
                then: Place = copy.state, failed | {one.leaf.name} if one.leaf.once else failed
                if copy.verdict.final:
                    then = copy.verdict, frozenset()
                if then not in index:
                    if len(index) >= self._limit:
                        raise TooLarge("states of the monitor", limit=self._limit)
                    index[then] = len(places)
                    places.append(then)
                    monitors.append(copy)
                rows.append((number, index[then], rate))
        rates, moves = [rate for _, _, rate in rows], ([a for a, _, _ in rows], [b for _, b, _ in rows])
        matrix = sparse.csr_matrix((rates, moves), (len(places), len(places)))
        target = numpy.array([float(one.verdict is Verdict.TRUE) for one in monitors])
        values = reached(matrix, target, [self._horizon], len(self._patterns))[0]
        self._known.update(zip(places, map(float, values), strict=True))
