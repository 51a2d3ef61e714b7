"""Trees with shared nodes: the scenarios of the core that are consistent with a partial match.

A shared gate is resolved once, and an order between events may depend on the gates above. A part is
a single *element* of the core (see `compiled_tree`): an order relative to the rest of the tree
applies to all of it.

The search resolves reached choices from the root on. It drops a partial resolution as soon as an
occurrence taken is unreachable or breaks an order. Of partial resolutions with the same reached
nodes and relevant orders, it follows one.
"""

from collections.abc import Hashable, Iterator, Mapping
from functools import cached_property
from itertools import chain, combinations
from typing import Final, TypeAlias

from rvaft.core.property import PartKind
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import DONE, MORE, POSSIBLE, SURE, TOUCHED, Configuration, PartProgress
from rvaft.errors import TooLarge
from rvaft.support.bits import bits, mask_of, union
from rvaft.support.budget import StepWork

MEMORY: Final = 20_000
"""The maximum number of cached results."""

Resolution: TypeAlias = Mapping[int, tuple[int, ...]]
"""The core nodes with kept children, parents first."""


class SharedNodes:
    """The core of a tree; raises `TooLarge` if one search takes more than `limit` steps, or all too much `effort`."""

    def __init__(
        self, compiled: CompiledTree, progress: PartProgress, effort: StepWork, *, limit: int, early: bool = False
    ) -> None:
        self.compiled = compiled
        self.effort = effort
        self.early = early
        self.progress = progress
        self.limit = limit
        self._mask = mask_of(compiled.core)
        inner = [node for node in compiled.core if compiled.children[node]]
        self._ordered = any(compiled.own[node] or compiled.ops[node] is PartKind.SEQUENCE for node in inner)
        """Whether the core has a sequence, or a gate with an event."""
        self._memory: dict[Hashable, tuple[bool, bool]] = {}

    def classify(self, configuration: Configuration) -> tuple[bool, bool]:
        """Return whether the occurrences are a whole scenario, else a proper part of one."""
        mask = self._mask
        decided = configuration.closed & mask, configuration.held & mask
        own = configuration.taken & mask, configuration.dead & mask, *decided
        parts = tuple([self.progress.flags(configuration, part) for part in self.compiled.parts])
        finished = configuration.ended >> self.compiled.root & 1 > 0
        key = (*own, parts, configuration.inversions, configuration.broken, finished)
        found = self._memory.get(key)
        if found is None:
            if len(self._memory) >= MEMORY:
                self._memory.clear()
            complete = next(self.resolutions(configuration, complete=True), None) is not None
            partial = False
            if not complete and not finished:
                # Parts are as complete as possible: without a remaining element there is already a
                # match.
                resolutions = self.resolutions(configuration, complete=False)
                partial = any(self._lacks(configuration, kept) for kept in resolutions)
            found = self._memory[key] = (complete, partial)
        return found

    def possible(self, configuration: Configuration, node: int) -> bool:
        """Whether the occurrences are part of a scenario.

        Open guards are ignored, and the windows above a node, as if its event had yet to come.
        """
        fresh = 1 << self.compiled.part_of[node]
        return next(self.resolutions(configuration, complete=False, fresh=fresh), None) is not None

    def inverted(self, configuration: Configuration, node: int) -> frozenset[tuple[int, int]]:
        """Return the orders that a node's event breaks."""
        element = self.compiled.part_of[node]
        touched = self.touched(configuration) & ~(1 << element)
        return frozenset((element, other) for other in bits(touched) if self._before[other] >> element & 1)

    def settled(self, configuration: Configuration, node: int, *, chosen: bool) -> bool:
        """Whether the element is `chosen` or certain, and its predecessors are taken."""
        own = self.compiled.part_of[node]
        if not chosen and not self.compiled.certain >> own & 1:
            return False
        for element in bits(self._before[own]):
            if any(self._has(configuration, rival, TOUCHED) for rival in self.rivals.get(element, ())):
                continue
            if element in self.compiled.members:
                if not configuration.taken >> element & 1:
                    return False
            else:
                flags = self.progress.flags(configuration, element)
                if not flags & SURE or (flags & MORE and self.compiled.picks >> element & 1):
                    return False
        return True

    @cached_property
    def rivals(self) -> dict[int, tuple[int, ...]]:
        """For each part below a choice of the core, the other parts of that choice."""
        compiled = self.compiled
        choices = (compiled.children[node] for node in compiled.core if compiled.ops[node] is PartKind.ONE)
        parts = [[child for child in children if child not in compiled.members] for children in choices]
        return {one: tuple(other for other in some if other != one) for some in parts for one in some}

    def touched(self, configuration: Configuration) -> int:
        """Return the elements with an event taken."""
        parts = (part for part in self.compiled.parts if self.progress.flags(configuration, part) & TOUCHED)
        return configuration.taken & self._mask | mask_of(parts)

    def _elements(self, configuration: Configuration, kept: Resolution) -> tuple[int, int]:
        """Return the elements with events, and those that are complete, parts if possible.

        A partial resolution includes reached but unresolved nodes.
        """
        compiled = self.compiled
        present, finished = int(compiled.own[compiled.root]), 0
        for child in chain.from_iterable(kept.values()):
            if child in compiled.members:
                present |= compiled.own[child] << child
            else:
                flags = self.progress.flags(configuration, child)
                if not flags & DONE or flags & TOUCHED:
                    present |= 1 << child
                if flags & DONE and flags & TOUCHED:
                    finished |= 1 << child
        return present, finished | present & configuration.taken & self._mask

    def _has(self, configuration: Configuration, child: int, flag: int) -> bool:
        return child not in self.compiled.members and self.progress.flags(configuration, child) & flag > 0

    @cached_property
    def _before(self) -> dict[int, int]:
        kept = {node: self.compiled.children[node] for node in self.compiled.core}
        events = mask_of(node for node in self.compiled.core if self.compiled.own[node])
        return self._precedence(kept, events | mask_of(self.compiled.parts))

    def _precedence(self, kept: Resolution, present: int) -> dict[int, int]:
        compiled = self.compiled
        within: dict[int, int] = {}
        before = dict.fromkeys(bits(present), 0)
        for node in reversed(list(kept)):
            below = 0
            for child in kept[node]:
                part = within[child] if child in kept else 1 << child & present
                if below and compiled.ops[node] is PartKind.SEQUENCE:
                    for element in bits(part):
                        before[element] |= below
                below |= part
            own = 1 << node & present
            if own and compiled.top_down:
                for element in bits(below):
                    before[element] |= own
            elif own:
                before[node] |= below
            within[node] = below | own
        return before

    def _outlook(
        self, configuration: Configuration, kept: Resolution, elements: tuple[int, int], touched: int, ahead: int
    ) -> Hashable:
        """Return the relevant state of a resolution for the nodes `ahead`, or None if no scenario
        fits.
        """
        present, finished = elements
        left = present & ~finished
        if not self._ordered:
            return left > 0
        before = self._precedence(kept, present | ahead)
        if any(before[element] & left for element in bits(present & touched)):
            return None
        if any(before.get(late, 0) >> early & 1 for early, late in configuration.inversions):
            return None
        if any(before[element] >> element & 1 for element in bits(present)):
            return None
        while left:  # unless there is a cycle, some element has no remaining predecessor
            free = mask_of(element for element in bits(left) if not before[element] & left)
            if not free:
                return None
            left ^= free
        # for each node ahead: predecessors, and constraints on its part
        left = present & ~finished
        early, late = (mask_of(pair[end] for pair in configuration.inversions) for end in (0, 1))
        relations: list[Hashable] = [left > 0]
        for node in bits(ahead):
            direct = earlier = agenda = before[node]
            after = mask_of(one for one in bits(present & (touched | late)) if before[one] >> node & 1)
            while agenda:
                agenda = union(before[one] for one in bits(agenda)) & ~earlier
                earlier |= agenda
            orders = direct & ahead, earlier & ahead, direct & early, after & late
            relations.append((*orders, direct & left > 0, after & touched > 0))
        return tuple(relations)

    def _spans(
        self,
        configuration: Configuration,
        kept: Resolution,
        elements: tuple[int, int],
        ahead: int,
        *,
        complete: bool,
        fresh: int,
    ) -> Hashable | None:
        """Return the relevant state of the windows of a resolution, or None if one fails.

        A window fails with events too far apart or without events, unless an event below it remains
        and the window need not fail early.
        """
        compiled, found = self.compiled, list[Hashable]()
        if not compiled.over_core:
            return ()
        (present, finished), resolved = elements, not ahead
        below = self._below(kept)
        for window in compiled.over_core:
            if window not in kept:
                continue
            apart = [pair for pair in configuration.broken if pair[0] == window]
            broken = any(below[window] >> one & below[window] >> other & 1 for _, one, other in apart)
            if broken and (complete or self.early):
                return None
            inside = below[window]
            remains = inside & fresh > 0 or self._goes_on(configuration, kept, inside, present, finished)
            goes_on = not complete and remains
            if resolved and (broken or not inside & present) and not goes_on:
                return None
            far = mask_of(one for _, *pair in apart for one in pair)
            found.append((inside & far, inside & ahead, broken, goes_on, inside & present > 0))
        return tuple(found)

    def _below(self, kept: Resolution) -> dict[int, int]:
        """Return the elements and unresolved nodes below each resolved node."""
        below: dict[int, int] = {}
        for node in sorted(kept, reverse=True):
            below[node] = self.compiled.own[node] << node
            for child in kept[node]:
                below[node] |= below[child] if child in kept else 1 << child
        return below

    def _goes_on(
        self, configuration: Configuration, kept: Resolution, inside: int, present: int, finished: int
    ) -> bool:
        """Whether an event may remain among some elements."""
        if inside & present & ~finished:
            return True
        parts = (one for one in bits(inside & ~self._mask) if self.progress.flags(configuration, one) & MORE)
        able = mask_of(parts)
        if not self._ordered or not able:
            return able > 0
        before, touched = self._precedence(kept, present | able), self.touched(configuration)
        return any(not any(before[later] >> one & 1 for later in bits(touched & present)) for one in bits(able))

    def _lacks(self, configuration: Configuration, kept: Resolution) -> bool:
        """Whether an event remains in a resolution without a match."""
        present, finished = self._elements(configuration, kept)
        if present & ~finished:
            return True
        below = self._below(kept)
        return any(
            window in kept
            and (
                not below[window] & present
                or any(
                    at == window and below[window] >> one & below[window] >> other & 1
                    for at, one, other in configuration.broken
                )
            )
            for window in self.compiled.over_core
        )

    def resolutions(self, configuration: Configuration, *, complete: bool, fresh: int = 0) -> Iterator[Resolution]:
        """Iterate over resolutions with a feasible scenario in which the occurrences taken are
        downward closed.

        At least one is returned if any exists. If `complete`, no occurrence remains. An occurrence of the
        elements `fresh` counts as remaining.
        """
        compiled, core = self.compiled, self.compiled.core
        able = self._able(configuration, complete=complete)
        touched = self.touched(configuration)
        needed = mask_of(  # nodes that the occurrences taken need
            node
            for node in core
            if configuration.taken >> node & 1
            or any(self._has(configuration, child, TOUCHED) for child in compiled.children[node])
        )
        # nodes of the core that are not resolved, reached nodes, resolved nodes; parents have smaller numbers
        agenda: list[tuple[int, int, dict[int, tuple[int, ...]]]] = [(self._mask, 1, {})] if able & 1 else []
        seen: set[Hashable] = set()
        steps = 0
        while agenda:
            rest, reached, kept = agenda.pop()
            steps += 1
            options: list[tuple[int, ...]] = []
            while ahead := reached & rest:
                node = (ahead & -ahead).bit_length() - 1
                steps += 1
                options = list(self._options(configuration, node, able, complete=complete))
                if len(options) != 1:
                    break
                kept[node] = options[0]
                whole = len(options[0]) == len(compiled.children[node])
                reached |= compiled.child_masks[node] if whole else mask_of(options[0])
                rest &= -2 << node
            if steps > self.limit:
                named = compiled.some(node for node in core if compiled.chooses >> node & 1)
                raise TooLarge(f"resolutions of the choices that share nodes: {named}", limit=self.limit)
            within_reach, possible = reached, rest & able
            while later := within_reach & possible:
                node_ahead = (later & -later).bit_length() - 1
                within_reach |= compiled.child_masks[node_ahead]
                possible &= -2 << node_ahead
            fits = not needed & ~within_reach
            self.effort.spend(len(core) if fits else 1, "resolutions of the choices that share nodes")
            if not fits:
                continue
            elements = self._elements(configuration, kept)
            outlook = self._outlook(configuration, kept, elements, touched, ahead)
            if outlook is None:
                continue
            spans = self._spans(configuration, kept, elements, ahead, complete=complete, fresh=fresh)
            if spans is None or (ahead, outlook, spans) in seen:
                continue
            seen.add((ahead, outlook, spans))
            if not ahead:
                yield kept
            else:
                rest &= -2 << node
                agenda.extend((rest, reached | mask_of(c), {**kept, node: c}) for c in reversed(options))

    def _able(self, configuration: Configuration, *, complete: bool) -> int:
        compiled, taken = self.compiled, configuration.taken
        wanted = SURE if complete else POSSIBLE
        able = mask_of(part for part in compiled.parts if self.progress.flags(configuration, part) & wanted)
        for node in reversed(compiled.core):
            fit = not configuration.dead >> node & 1
            if complete:
                sure = configuration.closed | configuration.held
                fit = fit and sure >> node & (taken >> node | (not compiled.own[node])) & 1 > 0
            if fit and sum(able >> child & 1 for child in compiled.children[node]) >= compiled.need[node]:
                able |= 1 << node
        return able

    def _options(
        self, configuration: Configuration, node: int, able: int, *, complete: bool
    ) -> Iterator[tuple[int, ...]]:
        """Iterate over the distinct ways to keep children."""
        compiled = self.compiled
        children = compiled.children[node]
        if not able >> node & 1:
            return
        if not compiled.chooses >> node & 1:
            yield children
            return
        touched = [child for child in children if self._has(configuration, child, TOUCHED)]
        if any(not able >> child & 1 for child in touched):
            return
        rest = [child for child in children if able >> child & 1 and child not in touched]
        shared = [child for child in rest if child in compiled.members]
        silent = [child for child in rest if self._has(configuration, child, SURE if complete else DONE)]
        waiting = [child for child in rest if child not in compiled.members and child not in silent]
        if compiled.ops[node] is PartKind.ONE:
            # waiting parts are equivalent, silent ones except for their branches
            picks = silent if complete else [*silent[:1], *waiting[:1]]
            ways = (touched if len(touched) == 1 else []) if touched else [*picks, *shared]
            yield from ((child,) for child in ways)
            return
        # Silent parts cost nothing; without orders and broken windows, no possible child does.
        for size in range(len(shared) + 1) if self._ordered or configuration.broken else [len(shared)]:
            missing = max(compiled.need[node] - size - len(touched) - len(silent), 0)
            # a window with events too far apart needs another event
            most = max(missing, 1) if compiled.over_core and not complete else missing
            for count in range(missing, min(most, len(waiting)) + 1):
                for picked in combinations(shared, size):
                    chosen = {*picked, *touched, *silent, *waiting[:count]}
                    yield tuple(child for child in children if child in chosen)
