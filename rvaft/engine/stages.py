"""Stages: what partial matches that differ in their values alone have in common, and where an event takes all of them.

How far a match has come does not depend on the values it saw, but for whether the guards held that were decided. So what taking an event
does to the structure is worked out once for a stage, a node and the outcomes of the guards decided there; for each partial match
there remain those guards, and the values to remember. All of it is found when first needed, and forgotten when it gets large.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Final, NamedTuple

from rvaft.engine.commitment import commits
from rvaft.engine.configuration import Configuration
from rvaft.engine.dominance import Directions
from rvaft.engine.matching import Matching
from rvaft.engine.variables import exact
from rvaft.predicates import Predicate
from rvaft.values import Json

MEMORY: Final = 500_000
"""How much is remembered: stages, each with the nodes that it knows flags of."""

_MANY: Final = 4
"""Guards of which all outcomes are looked at."""


@dataclass(slots=True, eq=False)
class Stage:
    """How far a partial match has come; `sample` has it all, with no values that mean anything."""

    sample: Configuration
    is_match: bool
    names: tuple[str, ...]
    """The variables that partial matches here remember."""
    directions: Mapping[str, int]
    """Of these the ones of which a greater (1) or smaller (-1) value can do more."""
    moves: dict[int, "Move | None"] = field(default_factory=dict)

    def key(self, binding: Mapping[str, Json]) -> Hashable:
        """Equal for bindings of its variables that nothing can tell apart."""
        return tuple([exact(binding[name]) for name in self.names])


class Step(NamedTuple):
    """Where a move leads, and whether the one that took it need not be followed any more."""

    stage: Stage
    commits: bool


@dataclass(slots=True, eq=False)
class Move:
    """A node's event from a stage on: what has to agree, and what is to be decided.

    The guards in `alone` are decided by the values of the event, those in `joint` by those and the ones remembered.
    """

    stage: Stage
    node: int
    compared: tuple[str, ...]
    """The variables that are bound, and that the event must repeat."""
    alone: tuple[int, ...]
    joint: tuple[int, ...]
    predicates: tuple[Predicate, ...]
    """What the joint guards say."""
    mask: int
    """The guards in `alone` as a set."""
    steps: dict[tuple[int, tuple[bool, ...]], Step | None] = field(default_factory=dict)


class Stages:
    """The stages of a tree, as far as they are known."""

    def __init__(self, matching: Matching) -> None:
        self.matching = matching
        self.forgotten = 0
        """How often everything was forgotten; stages from before must not be mixed with those after."""
        plan = matching.plan
        self._directions = Directions(plan)
        self._known: dict[Hashable, Stage] = {}
        self._size = 0
        own = [
            [
                other
                for other in dict.fromkeys(n for name in names for n in plan.guarded_by.get(name, ()))
                if set(plan.needs[other]) <= set(names)
            ]
            for names in plan.exported
        ]
        self.alone: tuple[tuple[tuple[int, Predicate], ...], ...] = tuple(
            tuple((1 << other, holds) for other in guards if (holds := matching.predicates[other]) is not None)
            for guards in own
        )
        """For each node the guards that its own event may decide, each as a set of one, with what it says."""

    def tidy(self) -> None:
        """Forget everything where it is too much."""
        if self._size > MEMORY:
            self._known.clear()
            self._size = 0
            self.forgotten += 1

    def of(self, configuration: Configuration) -> Stage:
        """The stage of a configuration."""
        key = configuration.taken, configuration.dead, configuration.closed, configuration.inversions
        found = self._known.get(key)
        if found is None:
            self._size += 1 + len(configuration.flags)
            sample = configuration.copy()
            sample.binding, sample.witness = dict.fromkeys(configuration.binding), None
            is_match, _ = self.matching.standing(sample)
            found = self._known[key] = Stage(
                sample, is_match, tuple(sorted(sample.binding)), self._directions.of(sample)
            )
        return found

    def move(self, stage: Stage, node: int) -> Move | None:
        """A node's event from a stage on; None where it cannot come there."""
        if node not in stage.moves:
            self._size += 1
            stage.moves[node] = self._move(stage, node) if self.matching.admits(stage.sample, node) else None
        return stage.moves[node]

    def _move(self, stage: Stage, node: int) -> Move:
        sample, names = stage.sample, self.matching.plan.exported[node]
        bound = sample.copy()
        bound.binding.update(dict.fromkeys(names))
        closing = list(self.matching.closing(bound, names))
        needs = self.matching.plan.needs
        alone = tuple(guard for guard in closing if not any(name in sample.binding for name in needs[guard]))
        joint = tuple(guard for guard in closing if guard not in alone)
        return Move(
            stage,
            node,
            tuple(name for name in names if name in sample.binding),
            alone,
            joint,
            tuple(holds for guard in joint if (holds := self.matching.predicates[guard]) is not None),
            sum(1 << guard for guard in alone),
        )

    def step(self, move: Move, held: int, outcomes: tuple[bool, ...]) -> Step | None:
        """Where a move leads if, of the guards that its event decides, these hold, and the others have these outcomes."""
        key = (held & move.mask, outcomes)
        if key not in move.steps:
            self._size += 1
            judged = {guard: bool(held >> guard & 1) for guard in move.alone}
            judged.update(zip(move.joint, outcomes, strict=True))
            before, node = move.stage.sample, move.node
            values = dict.fromkeys(self.matching.plan.exported[node])
            after = self.matching.extended(before, node, values, 0, judged=judged)
            step = None if after is None else Step(self.of(after), commits(self.matching, before, after, node))
            move.steps[key] = step
        return move.steps[key]

    def hopeful(self, move: Move, held: int) -> bool:
        """Whether a move may lead anywhere if, of the guards that its event decides, these hold."""
        if len(move.joint) > _MANY:
            return True
        return any(self.step(move, held, outcomes) for outcomes in product((True, False), repeat=len(move.joint)))
