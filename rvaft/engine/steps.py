"""From one configuration to the next: an occurrence takes an event."""

from collections.abc import Iterable, Iterator, Mapping

from rvaft.engine.compiled_tree import Plan
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.progress import MORE, SURE, Progress
from rvaft.engine.shared_nodes import Core
from rvaft.model.guards import predicate
from rvaft.model.values import Json, equal


class Matching:
    """The partial matches of a tree, whatever the semantics; `limit` bounds one search through a core."""

    def __init__(self, plan: Plan, *, limit: int) -> None:
        self.plan = plan
        self.progress = Progress(plan)
        self.core = Core(plan, self.progress, limit=limit)
        self.predicates = tuple(None if guard is None else predicate(guard) for guard in plan.guards)
        """What each node's guard says of a binding of its variables."""

    def start(self) -> Configuration:
        """The configuration before any event."""
        return self.progress.start()

    def standing(self, configuration: Configuration) -> tuple[bool, bool]:
        """Whether it is a match, and, if not, whether it is a partial match."""
        if self.plan.core:
            return self.core.classify(configuration)
        flags = self.progress.flags(configuration, self.plan.root)
        return bool(flags & SURE), bool(flags & MORE)

    def extended(
        self,
        configuration: Configuration,
        node: int,
        values: Mapping[str, Json],
        position: int,
        *,
        reuse: bool = False,
        judged: Mapping[int, bool] | None = None,
    ) -> Configuration | None:
        """The configuration after a node's event, or None where it is then neither a match nor a partial match.

        `values` are those that the event gives to the variables of its pattern. With `reuse` the configuration itself changes. Where
        the guards are `judged` already, that is believed of those that can now be decided.
        """
        bound, names = configuration.binding, self.plan.exported[node]
        if configuration.taken >> node & 1 or any(n in bound and not equal(bound[n], values[n]) for n in names):
            return None
        new = configuration if reuse else configuration.copy()
        if self.plan.core:
            new.inversions |= self.core.inverted(configuration, node)
        if not self._take(new, node):
            return None
        for name in names:
            new.binding.setdefault(name, values[name])
        if not self._close(new, names, judged):
            return None
        self._forget(new)
        new.witness = Witness(configuration.witness, node, position, dict(values))
        return new if any(self.standing(new)) else None

    def replayed(self, steps: Iterable[tuple[int, Mapping[str, Json], int]]) -> Configuration | None:
        """The configuration after these nodes took their events, each with values and position, or None where none is left."""
        configuration: Configuration | None = self.start()
        for node, values, position in steps:
            if configuration is not None:
                configuration = self.extended(configuration, node, values, position, reuse=True)
        return configuration if configuration is not None and any(self.standing(configuration)) else None

    def admits(self, configuration: Configuration, node: int) -> bool:
        """Whether a node's event could come next, whatever its values."""
        if configuration.taken >> node & 1 or (
            node not in self.core.members and self.progress.over(configuration, node)
        ):
            return False
        new = configuration.copy()
        if self.plan.core:
            new.inversions |= self.core.inverted(configuration, node)
        return self._take(new, node) and (not self.plan.core or self.core.possible(new))

    def _take(self, configuration: Configuration, node: int) -> bool:
        if node in self.core.members:
            configuration.taken |= 1 << node
            return True
        return self.progress.take(configuration, node)

    def closing(self, configuration: Configuration, names: Iterable[str]) -> Iterator[int]:
        """The nodes whose guard has waited for these variables alone, which are bound now."""
        for node in dict.fromkeys(node for name in names for node in self.plan.guarded_by.get(name, ())):
            if not configuration.closed >> node & 1 and all(n in configuration.binding for n in self.plan.needs[node]):
                yield node

    def _close(self, configuration: Configuration, names: tuple[str, ...], judged: Mapping[int, bool] | None) -> bool:
        """Decide the guards that waited for these variables alone; False where one that is needed does not hold."""
        for node in self.closing(configuration, names):
            configuration.closed |= 1 << node
            holds = self.predicates[node]
            if holds is not None and not (holds(configuration.binding) if judged is None else judged[node]):
                configuration.dead |= 1 << node
            if node not in self.core.members and not self.progress.refresh(configuration, node):
                return False
        return True

    def _forget(self, configuration: Configuration) -> None:
        """Drop the variables that nothing to come mentions."""
        for name in list(configuration.binding):
            waiting = any(not configuration.closed >> node & 1 for node in self.plan.guarded_by.get(name, ()))
            if not waiting and not self.plan.mentions[name] & ~configuration.taken:
                del configuration.binding[name]
