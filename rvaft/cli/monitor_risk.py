"""`rvaft monitor --risk TIME`: the probability of a detection within a time, after each event."""

from typing import Final

from rvaft.cli import warn
from rvaft.cli.horizon import Horizon
from rvaft.cli.risk_tree import risk_tree, warn_of_bounds
from rvaft.engine.monitor import Engine
from rvaft.errors import OptionError
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.risk.model import RiskTree, of_tree
from rvaft.risk.monitor_states import MonitorStates
from rvaft.risk.runtime import Outlook, RiskMonitor
from rvaft.stream.detection_commands import Hooks
from rvaft.stream.listeners import Listener
from rvaft.stream.plan import MonitoringPlan
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange

_SAME: Final = 1e-12
"""Relative changes of a risk that are none."""


class RiskListener(Listener):
    """Follows the risk of each trace and key, and of each column of monitors.

    `above` is a probability at which `hooks` run, each time that the risk of the tree rises above it.
    """

    every = whole = each_key = True

    def __init__(
        self, plan: MonitoringPlan, form: RiskTree, horizon: Horizon, above: float | None, hooks: Hooks
    ) -> None:
        columns = plan.monitors.columns
        if len(columns) > 1 and form.tree is None:
            raise OptionError("dynamic gates of Galileo have no branches or kinds: omit --per")
        forms = [form, *(of_tree(one.part) for one in columns[1:])]
        parts = [one.part for one in columns]
        self._fresh = [
            _of(part, one, horizon.value, plan.monitors.semantics) for part, one in zip(parts, forms, strict=True)
        ]
        self._assumed = form.assumed
        self.horizon, self._above, self._hooks = horizon, above, hooks
        self._following: dict[MonitoredTrace, list[RiskMonitor | MonitorStates]] = {}
        self._risks: dict[MonitoredTrace, tuple[float, ...]] = {}
        self._changed: dict[MonitoredTrace, bool] = {}
        self.first = self._fresh[0].risk
        """The risk before any event."""
        self.failures: list[str] = []
        """What went wrong with commands since the last time that this was read."""

    def begin(self, watch: MonitoredTrace) -> None:
        """Begin to follow a trace or key."""
        self._following[watch] = [one.fresh() for one in self._fresh]
        self._risks[watch] = tuple([one.risk for one in self._fresh])

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """Follow an event that changed no verdict."""
        self._step(watch, number, event)

    def change(self, change: VerdictChange) -> None:
        """Follow an event that changed a verdict; a detection is certain, and with `--repeat` all begins afresh."""
        if not change.passed:
            self._step(change.watch, change.number, change.event)
        for column in change.columns:
            if change.watch.monitors.repeat and column in change.detected:
                self._following[change.watch][column] = self._fresh[column].fresh()

    def _step(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        before = self._risks[watch]
        now = tuple([
            _final(verdict) if verdict.final else one.step(event)
            for one, verdict in zip(self._following[watch], watch.monitors.verdicts, strict=True)
        ])  # fmt: skip
        self._risks[watch] = now
        self._changed[watch] = any(abs(a - b) > _SAME * max(a, b) for a, b in zip(before, now, strict=True))
        if self._above is not None and before[0] <= self._above < now[0]:
            told = {"trace": watch.trace, "event": number, "risk": now[0], "kinds": [], **self.coming(watch)}
            self.failures += self._hooks.run(told)

    @property
    def within(self) -> str:
        """The horizon, as the user wrote it."""
        return self.horizon.text

    @property
    def bound(self) -> bool:
        """Whether guards are taken to hold, so that the risk is an upper bound."""
        return bool(self._assumed)

    def of(self, watch: MonitoredTrace) -> tuple[float, ...]:
        """Return the risk of each column."""
        return self._risks[watch]

    def changed(self, watch: MonitoredTrace) -> bool:
        """Whether the last event changed a risk."""
        return self._changed.get(watch, False)

    def outlook(self, watch: MonitoredTrace) -> Outlook:
        """Return what may come next for the tree."""
        return self._following[watch][0].outlook(1)

    def coming(self, watch: MonitoredTrace) -> dict[str, Json]:
        """Return the awaited event that raises the risk most, and the values of the most advanced match, for JSON."""
        if watch.monitors.verdicts[0].final:
            return {}
        outlook = self.outlook(watch)
        found: dict[str, Json] = {"values": dict(outlook.values)} if outlook.values else {}
        if outlook.next:
            found["next"] = {"node": outlook.next[0].leaf, "risk": outlook.next[0].risk}
        if outlook.contradictions:
            found["contradictions"] = outlook.contradictions
        return found


def _final(verdict: Verdict) -> float:
    return 1.0 if verdict is Verdict.TRUE else 0.0


def _of(part: RVAFT, form: RiskTree, horizon: float, semantics: Semantics) -> RiskMonitor | MonitorStates:
    if semantics is Semantics.SCATTERED:
        return RiskMonitor(part, form, horizon)
    return MonitorStates(part, form, horizon, Engine(part, semantics))


def risk_listener(file: str, plan: MonitoringPlan, horizon: Horizon, above: float | None, hooks: Hooks) -> RiskListener:
    """Return the listener for a tree of a file, or the part of it that is monitored."""
    part = plan.monitors.columns[0].part
    form = risk_tree(file) if part.translated and not part.restricted else of_tree(part)
    horizon.require(form.unit, file)
    warn_of_bounds(form)
    listener = RiskListener(plan, form, horizon, above, hooks)
    if above is not None and listener.first > above:
        warn(
            f"the risk before any event is {listener.first:.6g}, above --risk-above {above:g}: the command runs "
            "for the risk only when it rises again from below"
        )
    return listener
