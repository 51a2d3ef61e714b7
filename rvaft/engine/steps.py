"""From one configuration to the next: an occurrence takes an event."""

from collections.abc import Iterable, Iterator, Mapping

from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import Configuration, Witness
from rvaft.engine.progress import MORE, SURE, PartProgress
from rvaft.engine.shared_nodes import SharedNodes
from rvaft.model.values import Json, equal


class Matching:
    """The partial matches of a tree, whatever the semantics; `limit` bounds one search through shared nodes."""

    def __init__(self, compiled: CompiledTree, *, limit: int) -> None:
        self.compiled = compiled
        self.progress = PartProgress(compiled)
        self.shared = SharedNodes(compiled, self.progress, limit=limit)

    def start(self) -> Configuration:
        """The configuration before any event."""
        return Configuration(self.compiled.dead, self.compiled.closed)

    def standing(self, configuration: Configuration) -> tuple[bool, bool]:
        """Whether it is a match, and, if not, whether it is a partial match."""
        if self.compiled.core:
            return self.shared.classify(configuration)
        flags = self.progress.flags(configuration, self.compiled.root)
        return flags & SURE > 0, flags & MORE > 0

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
        compiled, bound = self.compiled, configuration.binding
        names = compiled.exported[node]
        if configuration.taken >> node & 1:
            return None
        for name in names:
            if name in bound and not equal(bound[name], values[name]):
                return None
        new = self._taken(configuration, node, reuse=reuse)
        if new is None:
            return None
        if names:
            for name in names:
                new.binding.setdefault(name, values[name])
            settled = set(names)
            for waiting in self.closing(new, names):
                new.closed |= 1 << waiting
                settled.update(compiled.needs[waiting])
                holds = compiled.predicates[waiting]
                if holds is not None and not (holds(new.binding) if judged is None else judged[waiting]):
                    new.dead |= 1 << waiting
                if waiting not in compiled.members and not self.progress.refresh(new, waiting):
                    return None
            for name in settled:  # forget the variables that nothing to come mentions
                if not compiled.mentions[name] & ~new.taken and all(
                    new.closed >> waiting & 1 for waiting in compiled.guarded_by.get(name, ())
                ):
                    del new.binding[name]
        new.witness = Witness(configuration.witness, node, position, values)
        return new if any(self.standing(new)) else None

    def _taken(self, configuration: Configuration, node: int, *, reuse: bool = False) -> Configuration | None:
        """The configuration with a node taken, or None where it is then in no scenario (looking at its part alone)."""
        in_core = node in self.compiled.members
        if not in_core and self.progress.over(configuration, node):
            return None
        new = configuration if reuse else configuration.copy()
        if self.compiled.core:
            new.inversions |= self.shared.inverted(configuration, node)
        new.taken |= 1 << node
        return new if in_core or self.progress.refresh(new, node) else None

    def replayed(self, steps: Iterable[tuple[int, Mapping[str, Json], int]]) -> Configuration | None:
        """The configuration after these nodes took their events, each with values and position, or None where none is left."""
        configuration: Configuration | None = self.start()
        for node, values, position in steps:
            if configuration is not None:
                configuration = self.extended(configuration, node, values, position, reuse=True)
        return configuration if configuration is not None and any(self.standing(configuration)) else None

    def admits(self, configuration: Configuration, node: int) -> bool:
        """Whether a node's event could come next, whatever its values."""
        if configuration.taken >> node & 1:
            return False
        new = self._taken(configuration, node)
        return new is not None and (not self.compiled.core or self.shared.possible(new))

    def closing(self, configuration: Configuration, names: Iterable[str]) -> Iterator[int]:
        """The nodes whose guard has waited for these variables alone, which are bound now."""
        guarded_by, needs = self.compiled.guarded_by, self.compiled.needs
        for node in dict.fromkeys(node for name in names for node in guarded_by.get(name, ())):
            if not configuration.closed >> node & 1 and all(name in configuration.binding for name in needs[node]):
                yield node
