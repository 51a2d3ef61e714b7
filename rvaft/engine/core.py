"""Trees with shared nodes: which resolutions of the core fit a configuration.

The core (see `plan`) is what shared nodes tie together: a shared gate is resolved once, and whether one of its events precedes
another depends on which gates above are in the scenario. The search walks the core from the root, resolves only the
choices it reaches, and drops a resolution as soon as it contains a failed guard or leaves out something taken. Parts
stand in it as single *elements*: whatever orders one event of a part against the rest of the tree orders all of them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple, TypeAlias

from rvaft.engine.configuration import Configuration
from rvaft.engine.order import Order, bits
from rvaft.engine.plan import Plan
from rvaft.engine.progress import DONE, MORE, POSSIBLE, SURE, TOUCHED, Progress
from rvaft.errors import TooLarge
from rvaft.model import Gate

Resolution: TypeAlias = Mapping[int, tuple[int, ...]]
"""The nodes of the core that a scenario reaches, each with the children it keeps."""

MEMORY = 20_000
"""How many answers are remembered; then the memory starts afresh."""


class Frame(NamedTuple):
    """A resolution in the making: the place in the core, what is reached, and the choices made, the last first."""

    place: int
    reached: int
    kept: tuple["Frame", int, tuple[int, ...]] | None


@dataclass(frozen=True)
class Core:
    """The core of a plan; `limit` bounds the steps of one search."""

    plan: Plan
    progress: Progress
    limit: int

    @cached_property
    def _order(self) -> Order:
        return Order(self.plan)

    @cached_property
    def _memory(self) -> dict[object, tuple[bool, bool]]:
        return {}

    @cached_property
    def members(self) -> frozenset[int]:
        """The nodes of the core."""
        return frozenset(self.plan.core)

    @cached_property
    def free(self) -> bool:
        """Whether the core leaves a choice."""
        return any(self.plan.gates[node] in (Gate.OR, Gate.VOT) for node in self.plan.core)

    @cached_property
    def _unordered(self) -> bool:
        """Whether the core orders nothing: no ordered gate, and no event but at childless nodes."""
        inner = [node for node in self.plan.core if self.plan.children[node]]
        return not any(self.plan.own[node] or self.plan.gates[node] in (Gate.SAND, Gate.SAND_RL) for node in inner)

    # -- questions ----------------------------------------------------------------------------------------------

    def classify(self, configuration: Configuration) -> tuple[bool, bool]:
        """Whether what is taken is all of some feasible scenario, and, if not, whether it is a proper part of one."""
        key = self._key(configuration)
        found = self._memory.get(key)
        if found is None:
            if len(self._memory) >= MEMORY:
                self._memory.clear()
            complete = next(self.complete(configuration), None) is not None
            going_on = (self._goes_on(configuration, kept) for kept in self._search(configuration, complete=False))
            alive = not complete and any(going_on)
            found = self._memory[key] = (complete, alive)
        return found

    def complete(self, configuration: Configuration) -> Iterator[Resolution]:
        """The resolutions whose occurrences are exactly those taken."""
        for kept in self._search(configuration, complete=True):
            if self._fits(configuration, kept):
                yield kept

    def inverted(self, configuration: Configuration, node: int) -> frozenset[tuple[int, int]]:
        """The orders between elements that taking this node's event breaks."""
        element = self.plan.part_of[node]
        later = self._order.after[element] & self._touched(configuration) & ~(1 << element)
        return frozenset((element, other) for other in bits(later))

    def settled(self, configuration: Configuration, node: int) -> bool:
        """Whether every scenario has, before this node's element, only what is taken (for a core without choices)."""
        return all(
            self._settled(configuration, element) for element in bits(self._order.before[self.plan.part_of[node]])
        )

    def _settled(self, configuration: Configuration, element: int) -> bool:
        if element in self.members:
            return bool(configuration.taken >> element & 1)
        flags = self.progress.flags(configuration, element)
        return bool(flags & SURE) and not (flags & MORE and self.plan.chooses >> element & 1)

    # -- views of a configuration -------------------------------------------------------------------------------

    def _key(self, configuration: Configuration) -> object:
        flags = tuple(self.progress.flags(configuration, part) for part in self.plan.parts)
        mask = self._mask
        dead, closed = configuration.dead & mask, configuration.closed & mask
        return configuration.taken & mask, dead, closed, flags, configuration.inversions

    @cached_property
    def _mask(self) -> int:
        return sum(1 << node for node in self.plan.core)

    def _touched(self, configuration: Configuration) -> int:
        """The elements of which something is taken."""
        touched = configuration.taken & self._mask
        for part in self.plan.parts:
            if self.progress.flags(configuration, part) & TOUCHED:
                touched |= 1 << part
        return touched

    def _elements(self, configuration: Configuration, kept: Resolution) -> tuple[int, int]:
        """The elements of a resolution that have events, and those of them that are finished; parts as finished as can be."""
        present = finished = 0
        for node, children in kept.items():
            if self.plan.own[node]:
                present |= 1 << node
                finished |= configuration.taken & 1 << node
            for child in children:
                if child not in self.members:
                    flags = self.progress.flags(configuration, child)
                    if not flags & DONE or flags & TOUCHED:
                        present |= 1 << child
                    if flags & DONE and flags & TOUCHED:
                        finished |= 1 << child
        return present, finished

    def _goes_on(self, configuration: Configuration, kept: Resolution) -> bool:
        """Whether some scenario of a resolution has what is taken as a proper part.

        Parts are looked at as finished as they can be: where that leaves nothing to come, there is a match already.
        """
        present, finished = self._elements(configuration, kept)
        unfinished = present & ~finished
        return bool(unfinished) and self._fits(configuration, kept)

    def _fits(self, configuration: Configuration, kept: Resolution) -> bool:
        """Whether what is taken is downward closed in a feasible scenario of a resolution."""
        elements = self._elements(configuration, kept)
        return self._order.allows(configuration, kept, elements, self._touched(configuration))

    # -- the search -----------------------------------------------------------------------------------------------

    def _search(self, configuration: Configuration, *, complete: bool) -> Iterator[Resolution]:
        """The resolutions that contain everything taken and nothing dead, and, if `complete`, nothing that remains."""
        able = self._able(configuration, complete=complete)
        if not able & 1:
            return
        core = self.plan.core
        agenda = [Frame(0, 1, None)]
        steps = 0
        while agenda:
            place, reached, kept = agenda.pop()
            steps += 1
            if steps > self.limit:
                raise TooLarge(f"resolutions of the choices that share nodes: {self._choices}", limit=self.limit)
            while place < len(core) and not reached >> core[place] & 1:
                if self._needed(configuration, core[place]):
                    break
                place += 1
            if place == len(core):
                yield _unrolled(kept)
                continue
            node = core[place]
            if not reached >> node & 1:
                continue
            frame = Frame(place, reached, kept)
            options = list(self._options(configuration, node, able, complete=complete))
            for children in reversed(options):
                more = sum(1 << child for child in children)
                agenda.append(Frame(place + 1, reached | more, (frame, node, children)))

    @cached_property
    def _choices(self) -> str:
        names = [self.plan.names[n] for n in self.plan.core if self.plan.gates[n] in (Gate.OR, Gate.VOT)]
        return ", ".join(names[:10]) + (", …" if len(names) > 10 else "")

    def _needed(self, configuration: Configuration, node: int) -> bool:
        """Whether something taken is in a scenario only if this node is."""
        if configuration.taken >> node & 1:
            return True
        return any(self._is(configuration, child, TOUCHED) for child in self.plan.children[node])

    def _is(self, configuration: Configuration, child: int, flag: int) -> bool:
        """Whether a child is a part with a flag."""
        return child not in self.members and bool(self.progress.flags(configuration, child) & flag)

    def _able(self, configuration: Configuration, *, complete: bool) -> int:
        """The nodes that are in some scenario of this kind, looking at each alone."""
        able = 0
        for part in self.plan.parts:
            if self.progress.flags(configuration, part) & (SURE if complete else POSSIBLE):
                able |= 1 << part
        for node in reversed(self.plan.core):
            unfit = configuration.dead >> node & 1
            if complete:
                unfit = unfit or not configuration.closed >> node & 1
                unfit = unfit or (self.plan.own[node] and not configuration.taken >> node & 1)
            count = sum(able >> child & 1 for child in self.plan.children[node])
            if not unfit and count >= self._least(node):
                able |= 1 << node
        return able

    def _least(self, node: int) -> int:
        match self.plan.gates[node]:
            case Gate.OR:
                return 1
            case Gate.VOT:
                return self.plan.thresholds[node]
            case _:
                return len(self.plan.children[node])

    def _options(
        self, configuration: Configuration, node: int, able: int, *, complete: bool
    ) -> Iterator[tuple[int, ...]]:
        """The ways to keep children of a node, given that it is kept."""
        if not able >> node & 1:
            return
        children = self.plan.children[node]
        gate = self.plan.gates[node]
        if gate not in (Gate.OR, Gate.VOT):
            yield children
            return
        touched = [child for child in children if self._is(configuration, child, TOUCHED)]
        if any(not able >> child & 1 for child in touched):
            return
        silent_flag = SURE if complete else DONE
        parts = [child for child in children if child not in self.members and able >> child & 1]
        silent = [child for child in parts if child not in touched and self._is(configuration, child, silent_flag)]
        waiting = [child for child in parts if child not in touched and child not in silent]
        shared = [child for child in children if child in self.members and able >> child & 1]
        if gate is Gate.OR:
            if touched:
                yield from [(touched[0],)] if len(touched) == 1 else []
                return
            # Waiting parts are alike, since what orders one orders the other, and so are silent ones, except that they
            # are in different branches.
            picks = silent if complete else [*silent[:1], *waiting[:1]]
            yield from ((child,) for child in (*picks, *shared))
            return
        sizes = [len(shared)] if self._unordered else range(len(shared) + 1)
        for size in sizes:
            for picked in combinations(shared, size):
                missing = self.plan.thresholds[node] - size - len(touched) - len(silent)
                if missing <= len(waiting):
                    chosen = {*picked, *touched, *silent, *waiting[: max(missing, 0)]}
                    yield self._sorted(node, chosen)

    def _sorted(self, gate: int, chosen: set[int]) -> tuple[int, ...]:
        return tuple(child for child in self.plan.children[gate] if child in chosen)


def _unrolled(kept: tuple[Frame, int, tuple[int, ...]] | None) -> Resolution:
    found: list[tuple[int, tuple[int, ...]]] = []
    while kept is not None:
        frame, node, children = kept
        found.append((node, children))
        kept = frame.kept
    return dict(reversed(found))
