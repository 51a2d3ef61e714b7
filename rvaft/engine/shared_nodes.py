"""The search for the resolutions of a core that fit a configuration.

It walks the core from the root and resolves only the choices it reaches. A resolution in the making is dropped as soon as what was
taken cannot be reached any more, or breaks an order among the nodes it keeps: neither can be mended by choices to come.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import combinations
from typing import NamedTuple, Optional, TypeAlias

from rvaft.engine.compiled_tree import Plan
from rvaft.engine.configuration import Configuration
from rvaft.engine.progress import DONE, MORE, POSSIBLE, SURE, TOUCHED, Progress
from rvaft.errors import TooLarge
from rvaft.model.nodes import Gate

# Precedence among the elements of a core: its events, and its parts as wholes (semantics, section 2).


def bits(mask: int) -> Iterator[int]:
    """The members of a set, ascending."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


class Order:
    """The precedence of each resolution of one core."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    @cached_property
    def before(self) -> dict[int, int]:
        """What may precede each element, in whichever scenario."""
        kept = {node: self.plan.children[node] for node in self.plan.core}
        events = sum(1 << node for node in self.plan.core if self.plan.own[node])
        return self._before(kept, events | sum(1 << part for part in self.plan.parts))

    @cached_property
    def after(self) -> dict[int, int]:
        """What each element may precede."""
        found = dict.fromkeys(self.before, 0)
        for element, earlier in self.before.items():
            for other in bits(earlier):
                found[other] |= 1 << element
        return found

    def allows(
        self, configuration: Configuration, kept: Mapping[int, tuple[int, ...]], elements: tuple[int, int], touched: int
    ) -> bool:
        """Whether a resolution is feasible and the configuration is downward closed in it, with an order it allows.

        `elements` are those that have events in the scenario and those of them that are finished.
        """
        present, finished = elements
        before = self._before(kept, present)
        if any(before[element] & ~finished for element in bits(present & touched)):
            return False
        if any(before.get(late, 0) >> early & 1 for early, late in configuration.inversions):
            return False
        if any(before[element] >> element & 1 for element in bits(present)):
            return False
        return _acyclic(before, present & ~finished)

    def _before(self, kept: Mapping[int, tuple[int, ...]], present: int) -> dict[int, int]:
        """What directly precedes each present element; the rest of the precedence follows by transitivity."""
        plan = self.plan
        within: dict[int, int] = {}
        before = dict.fromkeys(bits(present), 0)
        for node in reversed(list(kept)):
            below = 0
            for child in kept[node]:
                below |= within[child] if child in kept else 1 << child & present
            gate = plan.gates[node]
            if gate is not None and gate.ordered:
                earlier = 0
                for child in kept[node]:
                    part = within[child] if child in kept else 1 << child & present
                    for element in bits(part) if earlier else ():
                        before[element] |= earlier
                    earlier |= part
            own = 1 << node & present
            if own and plan.top_down:
                for element in bits(below):
                    before[element] |= own
            elif own:
                before[node] |= below
            within[node] = below | own
        return before


def _acyclic(before: Mapping[int, int], elements: int) -> bool:
    """Whether the elements can be put in an order."""
    while elements:
        free = [element for element in bits(elements) if not before[element] & elements]
        if not free:
            return False
        for element in free:
            elements ^= 1 << element
    return True


# The elements of a core as a configuration has them: its events, and its parts as wholes.

Resolution: TypeAlias = Mapping[int, tuple[int, ...]]
"""The nodes of the core that a scenario reaches, parents first, each with the children it keeps."""


class Elements:
    """Which elements are there, taken, finished."""

    def __init__(self, plan: Plan, progress: Progress) -> None:
        self.plan = plan
        self.progress = progress

    @cached_property
    def members(self) -> frozenset[int]:
        """The nodes of the core."""
        return frozenset(self.plan.core)

    @cached_property
    def mask(self) -> int:
        """The same as a set of bits."""
        return sum(1 << node for node in self.plan.core)

    def touched(self, configuration: Configuration) -> int:
        """The elements of which something is taken."""
        touched = configuration.taken & self.mask
        for part in self.plan.parts:
            if self.progress.flags(configuration, part) & TOUCHED:
                touched |= 1 << part
        return touched

    def present(self, configuration: Configuration, kept: Resolution) -> tuple[int, int]:
        """The elements of a resolution that have events, and those of them that are finished; parts as finished as can be.

        The resolution may be in the making: what it has reached but not resolved is looked at too.
        """
        present = 1 << self.plan.root if self.plan.own[self.plan.root] else 0
        finished = present & configuration.taken
        for children in kept.values():
            for child in children:
                if child in self.members:
                    own = 1 << child if self.plan.own[child] else 0
                    present |= own
                    finished |= own & configuration.taken
                else:
                    flags = self.progress.flags(configuration, child)
                    if not flags & DONE or flags & TOUCHED:
                        present |= 1 << child
                    if flags & DONE and flags & TOUCHED:
                        finished |= 1 << child
        return present, finished

    def has(self, configuration: Configuration, child: int, flag: int) -> bool:
        """Whether a child of a core node is a part with a flag."""
        return child not in self.members and bool(self.progress.flags(configuration, child) & flag)


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


# Trees with shared nodes: what the core allows a configuration to be.
#
# The core (see `plan`) is what shared nodes tie together: a shared gate is resolved once, and whether one of its events precedes
# another depends on which gates above are in the scenario. Parts stand in it as single *elements*: whatever orders one event
# of a part against the rest of the tree orders all of them.

MEMORY = 20_000
"""How many answers are remembered; then the memory starts afresh."""


class Core:
    """The core of a plan; `limit` bounds the steps of one search."""

    def __init__(self, plan: Plan, progress: Progress, *, limit: int) -> None:
        self.plan = plan
        self.progress = progress
        self.elements = Elements(plan, progress)
        self.order = Order(plan)
        self._search = Search(plan, progress, self.elements, self.order, limit=limit)
        self._memory: dict[object, tuple[bool, bool]] = {}

    @property
    def members(self) -> frozenset[int]:
        """The nodes of the core."""
        return self.elements.members

    @cached_property
    def free(self) -> bool:
        """Whether the core leaves a choice."""
        return any(self.plan.gates[node] in (Gate.OR, Gate.VOT) for node in self.plan.core)

    def classify(self, configuration: Configuration) -> tuple[bool, bool]:
        """Whether what is taken is all of some feasible scenario, and, if not, whether it is a proper part of one."""
        key = self._key(configuration)
        found = self._memory.get(key)
        if found is None:
            if len(self._memory) >= MEMORY:
                self._memory.clear()
            complete = next(self.complete(configuration), None) is not None
            alive = not complete and any(self._unfinished(configuration))
            found = self._memory[key] = (complete, alive)
        return found

    def complete(self, configuration: Configuration) -> Iterator[Resolution]:
        """Resolutions whose occurrences are exactly those taken; some, if there are any."""
        return self._search.resolutions(configuration, complete=True)

    def possible(self, configuration: Configuration) -> bool:
        """Whether what is taken is all or a part of some feasible scenario, guards that are open left aside."""
        return next(self._search.resolutions(configuration, complete=False), None) is not None

    def _unfinished(self, configuration: Configuration) -> Iterator[int]:
        """What remains in resolutions that have what is taken as a part.

        Parts are looked at as finished as they can be: where that leaves nothing to come, there is a match already.
        """
        for kept in self._search.resolutions(configuration, complete=False):
            present, finished = self.elements.present(configuration, kept)
            yield present & ~finished

    def inverted(self, configuration: Configuration, node: int) -> frozenset[tuple[int, int]]:
        """The orders between elements that taking this node's event breaks."""
        element = self.plan.part_of[node]
        later = self.order.after[element] & self.elements.touched(configuration) & ~(1 << element)
        return frozenset((element, other) for other in bits(later))

    def settled(self, configuration: Configuration, node: int) -> bool:
        """Whether every scenario has, before this node's element, only what is taken (for a core without choices)."""
        before = self.order.before[self.plan.part_of[node]]
        return all(self._settled(configuration, element) for element in bits(before))

    def _settled(self, configuration: Configuration, element: int) -> bool:
        if element in self.members:
            return bool(configuration.taken >> element & 1)
        flags = self.progress.flags(configuration, element)
        return bool(flags & SURE) and not (flags & MORE and self.plan.chooses >> element & 1)

    def _key(self, configuration: Configuration) -> object:
        """What the answers depend on."""
        flags = tuple(self.progress.flags(configuration, part) for part in self.plan.parts)
        mask = self.elements.mask
        dead, closed = configuration.dead & mask, configuration.closed & mask
        return configuration.taken & mask, dead, closed, flags, configuration.inversions
