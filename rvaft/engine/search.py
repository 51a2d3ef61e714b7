"""The search for the resolutions of a core that fit a configuration.

It walks the core from the root and resolves only the choices it reaches. A resolution in the making is dropped as soon as what was
taken cannot be reached any more, or breaks an order among the nodes it keeps: neither can be mended by choices to come.
"""

from collections.abc import Iterator
from functools import cached_property
from itertools import combinations
from typing import NamedTuple, Optional

from rvaft.engine.configuration import Configuration
from rvaft.engine.elements import Elements, Resolution
from rvaft.engine.order import Order
from rvaft.engine.plan import Plan
from rvaft.engine.progress import DONE, POSSIBLE, SURE, TOUCHED, Progress
from rvaft.errors import TooLarge
from rvaft.model import Gate


class Kept(NamedTuple):
    """A node of a resolution in the making with the children it keeps, and the node before it."""

    before: Optional["Kept"]
    node: int
    children: tuple[int, ...]


class Frame(NamedTuple):
    """A resolution in the making: the place in the core, the nodes reached, those resolved."""

    place: int
    reached: int
    kept: Kept | None


class Search:
    """Searches of one core; raises `TooLarge` where one takes more than `limit` steps."""

    def __init__(self, plan: Plan, progress: Progress, elements: Elements, order: Order, *, limit: int) -> None:
        self.plan = plan
        self.progress = progress
        self.elements = elements
        self.order = order
        self.limit = limit

    def resolutions(self, configuration: Configuration, *, complete: bool) -> Iterator[Resolution]:
        """Resolutions with a feasible scenario in which what is taken is downward closed; some, if there are any.

        If `complete`, only such where nothing remains to be taken.
        """
        able = self._able(configuration, complete=complete)
        touched = self.elements.touched(configuration)
        needed = [node for node in self.plan.core if self._needed(configuration, node)]
        agenda = [Frame(0, 1, None)] if able & 1 else []
        seen: set[tuple[int, int]] = set()
        steps = 0
        while agenda:
            place, reached, kept = agenda.pop()
            steps += 1
            if steps > self.limit:
                raise TooLarge(f"resolutions of the choices that share nodes: {self._choices}", limit=self.limit)
            options: list[tuple[int, ...]] = []
            while place < len(self.plan.core):
                node = self.plan.core[place]
                if reached >> node & 1:
                    steps += 1
                    if steps > self.limit:
                        raise TooLarge(
                            f"resolutions of the choices that share nodes: {self._choices}", limit=self.limit
                        )
                    options = list(self._options(configuration, node, able, complete=complete))
                    if len(options) != 1:
                        break
                    kept = Kept(kept, node, options[0])
                    reached |= _mask(options[0])
                place += 1
            ahead = (place, reached & self._ahead[place])
            if ahead in seen or not self._within_reach(place, reached, able, needed):
                continue
            if self._unordered:
                seen.add(ahead)  # what is reached ahead is all that matters
            resolution = _unrolled(kept)
            present = self.elements.present(configuration, resolution)
            if not self.order.allows(configuration, resolution, present, touched):
                continue
            if place == len(self.plan.core):
                yield resolution
                continue
            agenda.extend(
                Frame(place + 1, reached | _mask(children), Kept(kept, node, children))
                for children in reversed(options)
            )

    @cached_property
    def _ahead(self) -> tuple[int, ...]:
        """For each place in the core the nodes from there on."""
        masks = [0]
        for node in reversed(self.plan.core):
            masks.append(masks[-1] | 1 << node)
        return tuple(reversed(masks))

    @cached_property
    def _choices(self) -> str:
        names = [self.plan.names[n] for n in self.plan.core if self.plan.gates[n] in (Gate.OR, Gate.VOT)]
        return ", ".join(names[:10]) + (", …" if len(names) > 10 else "")

    def _needed(self, configuration: Configuration, node: int) -> bool:
        """Whether something taken is in a scenario only if this node is."""
        if configuration.taken >> node & 1:
            return True
        return any(self.elements.has(configuration, child, TOUCHED) for child in self.plan.children[node])

    def _within_reach(self, place: int, reached: int, able: int, needed: list[int]) -> bool:
        """Whether all that is needed is reached, or may be by choices to come."""
        for node in self.plan.core[place:]:
            if reached >> node & able >> node & 1:
                reached |= _mask(self.plan.children[node])
        return all(reached >> node & 1 for node in needed)

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
            if not unfit and count >= self.plan.least(node):
                able |= 1 << node
        return able

    # -- the choices at one node --------------------------------------------------------------------------------

    @cached_property
    def _unordered(self) -> bool:
        """Whether the core orders nothing: no ordered gate, and no event but at childless nodes."""
        inner = [node for node in self.plan.core if self.plan.children[node]]
        return not any(self.plan.own[node] or self.plan.gates[node] in (Gate.SAND, Gate.SAND_RL) for node in inner)

    def _options(
        self, configuration: Configuration, node: int, able: int, *, complete: bool
    ) -> Iterator[tuple[int, ...]]:
        """The ways to keep children of a node, given that it is kept. Alike ones are represented by one."""
        if not able >> node & 1:
            return
        children = self.plan.children[node]
        gate = self.plan.gates[node]
        if gate not in (Gate.OR, Gate.VOT):
            yield children
            return
        touched = [child for child in children if self.elements.has(configuration, child, TOUCHED)]
        if any(not able >> child & 1 for child in touched):
            return
        rest = [child for child in children if able >> child & 1 and child not in touched]
        parts = [child for child in rest if child not in self.elements.members]
        silent = [child for child in parts if self.elements.has(configuration, child, SURE if complete else DONE)]
        waiting = [child for child in parts if child not in silent]
        shared = [child for child in rest if child in self.elements.members]
        if gate is Gate.OR:
            # Waiting parts are alike, since what orders one orders the other, and so are silent ones, except that they
            # are in different branches.
            picks = silent if complete else [*silent[:1], *waiting[:1]]
            ways = (touched if len(touched) == 1 else []) if touched else [*picks, *shared]
            yield from ((child,) for child in ways)
            return
        # Silent parts cost nothing; where nothing is ordered, no child that is able does.
        sizes = [len(shared)] if self._unordered else range(len(shared) + 1)
        for size in sizes:
            missing = max(self.plan.thresholds[node] - size - len(touched) - len(silent), 0)
            if missing <= len(waiting):
                for picked in combinations(shared, size):
                    chosen = {*picked, *touched, *silent, *waiting[:missing]}
                    yield tuple(child for child in children if child in chosen)


def _mask(nodes: tuple[int, ...]) -> int:
    mask = 0
    for node in nodes:
        mask |= 1 << node
    return mask


def _unrolled(kept: Kept | None) -> Resolution:
    found: list[tuple[int, tuple[int, ...]]] = []
    while kept is not None:
        found.append((kept.node, kept.children))
        kept = kept.before
    return dict(reversed(found))
