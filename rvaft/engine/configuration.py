"""A partial match (`Configuration`), and the progress of the nodes of its read-once parts.

A *way* resolves the choices below a node so that the occurrences taken are downward closed. A node
has four flags:

- TOUCHED: an occurrence at or below the node is taken;
- DONE: in some way, all occurrences are taken;
- MORE: in some way, occurrences remain;
- SURE: in some way, all occurrences are taken and no guard is open.

A touched node that is neither DONE nor MORE is in no scenario, and neither is its parent. Gates
count the flags of their children, so an event costs a few additions per node on the path from its
node to the root of the part.
"""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import chain
from operator import add
from typing import Any, Final, NamedTuple, Optional, TypeAlias, cast

from rvaft.core.property import PartKind
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.model.values import Json, fingerprint
from rvaft.support.bits import bits, mask_of


class Witness(NamedTuple):
    """The last step: node, position and values, and the earlier steps."""

    before: Optional["Witness"]
    node: int
    position: int
    values: Mapping[str, Json]


Tally: TypeAlias = tuple[int, ...]
"""The counts of a gate over its children.

- A sequence: the last touched child (or -1), the number of children before it that are not done,
  the numbers of done and sure children, and the numbers of possible children and of children with
  more from the last touched one on.
- Another gate: the numbers of touched, possible, done, more and sure children; then the numbers of
  touched children with each of the last four flags.
"""


@dataclass(slots=True)
class Configuration:
    """One partial match.

    - `taken`: the occurrences that have their event.
    - `dead`: the nodes whose guard failed; `closed`: the nodes without a waiting guard.
    - `binding`: the values of the variables that are still needed.
    - `inversions`: the broken orders between core elements; a scenario must not require them.
    - `unfit`: the windows that the events taken break, if their part may go on regardless.
    - `owing`: the children of ends in order that need a later event than those taken.
    - `broken`: a window over shared nodes and two elements with events too far apart for it.
    - `ended`: the parts that can have no more events, because of an absent event.
    - `unanswered`: the parts that need one more event, because of an absent event.
    - `decided`: the nodes whose absent event can come no more.
    - `held`: the guards over time points (`PointGuard`) that hold for the events so far.
    - `failing`: those that do not, so that a part with a time point needs another event.
    - `flags`, `tallies`: derived data of `PartProgress` where it differs from the start.
    - `witness`: the steps so far; not part of the state.
    """

    dead: int
    closed: int
    taken: int = 0
    binding: dict[str, Json] = field(default_factory=dict)
    inversions: frozenset[tuple[int, int]] = frozenset()
    flags: dict[int, int] = field(default_factory=dict)
    tallies: dict[int, Tally] = field(default_factory=dict)
    unfit: int = 0
    owing: int = 0
    broken: frozenset[tuple[int, int, int]] = frozenset()
    ended: int = 0
    unanswered: int = 0
    decided: int = 0
    held: int = 0
    failing: int = 0
    witness: Witness | None = None

    def copy(self) -> "Configuration":
        """Return an independent copy."""
        own = self.binding.copy(), self.inversions, self.flags.copy(), self.tallies.copy()
        broken, absent = (self.unfit, self.owing, self.broken), (self.ended, self.unanswered, self.decided)
        points = self.held, self.failing
        return Configuration(self.dead, self.closed, self.taken, *own, *broken, *absent, *points, self.witness)

    @property
    def fields(self) -> tuple[object, ...]:
        """The fields in order; the last is the witness."""
        return tuple([getattr(self, name) for name in Configuration.__slots__])

    @property
    def key(self) -> Hashable:
        """A key that is equal for partial matches with equal futures."""
        return self.taken, self.dead, *self._broken, fingerprint(self.binding)

    @property
    def place(self) -> tuple[Hashable, ...]:
        """The progress, which does not depend on the values of variables."""
        return self.taken, self.dead, self.closed, *self._broken

    @property
    def _broken(self) -> tuple[Hashable, ...]:
        broken = self.inversions, self.unfit, self.owing, self.broken
        return *broken, self.ended, self.unanswered, self.decided, self.held, self.failing


def history(last: Witness | None) -> list[Witness]:
    """Return the steps up to the last, marks among them (see `Mark`)."""
    steps = []
    while last is not None:
        steps.append(last)
        last = last.before
    return steps[::-1]


def events_of(last: Witness | None) -> list[Witness]:
    """Return the steps up to the last that are events."""
    return [step for step in history(last) if step.node >= 0]


class Mark(IntEnum):
    """What becomes known of an absent event of a partial match; it is noted as a step.

    - BROKEN: it came, while it breaks the clause if no event of the part, or another one, follows.
    - DECIDED: the time in which it could come has passed.
    - FINISHED: no event of the match can follow, since it had to use the last one.
    """

    BROKEN = 0
    DECIDED = 1
    FINISHED = 2

    def at(self, node: int) -> int:
        """Return the node of a step that is this mark at a node."""
        return -1 - len(Mark) * node - self

    @staticmethod
    def of(node: int) -> tuple["Mark", int]:
        """Return the mark and its node."""
        at, mark = divmod(-1 - node, len(Mark))
        return Mark(mark), at


FlatGroups: TypeAlias = tuple[list[tuple[int, int, int, Mapping[str, Json]]], list[list[tuple[object, ...]]]]
"""Groups of partial matches as plain data, because pickling long chains of steps recurses too deeply.

A step is the index of the step before it (or -1), node, position and values. A partial match is the
tuple of its fields, with the index of its last step instead of the witness.
"""


def flattened(*groups: list[Configuration]) -> FlatGroups:
    """Return groups of partial matches as data that later steps do not change."""
    steps: list[tuple[int, int, int, Mapping[str, Json]]] = []
    numbers = dict[int, int]()
    for one in chain(*groups):
        step, new = one.witness, list[Witness]()
        while step is not None and id(step) not in numbers:
            new.append(step)
            step = step.before
        for step in reversed(new):
            numbers[id(step)] = len(steps)
            before = -1 if step.before is None else numbers[id(step.before)]
            steps.append((before, step.node, step.position, step.values))
    return steps, [[(*one.copy().fields[:-1], numbers.get(id(one.witness), -1)) for one in some] for some in groups]


def unflattened(flat: FlatGroups) -> Iterator[list[Configuration]]:
    """Iterate over the restored groups."""
    steps: list[Witness] = []
    for before, node, position, values in flat[0]:
        steps.append(Witness(None if before < 0 else steps[before], node, position, values))
    for group in flat[1]:
        made = [Configuration(*fields).copy() for *fields, _ in cast("Any", group)]
        for one, (*_, last) in zip(made, group, strict=True):
            one.witness = None if (step := cast("int", last)) < 0 else steps[step]
        yield made


TOUCHED, DONE, MORE, SURE = 1, 2, 4, 8
POSSIBLE: Final = DONE | MORE


def _counted(flags: int) -> Tally:
    touched, possible, done, more, sure = (int(flags & mask > 0) for mask in (TOUCHED, POSSIBLE, DONE, MORE, SURE))
    return (touched, possible, done, more, sure, *(touched * n for n in (possible, done, more, sure)))


_COUNTED: Final = [_counted(flags) for flags in range(16)]
_CHANGES: Final = [[tuple(b - a for a, b in zip(x, y, strict=True)) for y in _COUNTED] for x in _COUNTED]


class PartProgress:
    """The initial flags of nodes, and their updates."""

    def __init__(self, compiled: CompiledTree) -> None:
        self.compiled = compiled
        self._windows = mask_of(node for node in compiled.windows if node not in compiled.members)
        self._sequence = [op is PartKind.SEQUENCE for op in compiled.ops]
        self._flags = [0] * len(compiled.names)
        self._tallies: list[Tally] = [()] * len(compiled.names)
        start = Configuration(0, compiled.closed)
        for node in range(len(compiled.names) - 1, -1, -1):
            if node not in compiled.members:
                children = (_COUNTED[self._flags[child]] for child in compiled.children[node])
                counts = tuple(map(sum, zip(*children, strict=True)))
                if self._sequence[node]:
                    _, possible, done, more, sure, *_ = counts
                    counts = (-1, 0, done, sure, possible, more)
                self._tallies[node] = counts
                self._flags[node] = self._evaluate(start, node)

    def flags(self, configuration: Configuration, node: int) -> int:
        """Return the flags of a node."""
        found = configuration.flags.get(node)
        return self._flags[node] if found is None else found

    def over(self, configuration: Configuration, node: int) -> bool:
        """Whether an occurrence after the node or its part has been taken."""
        compiled = self.compiled
        frozen = compiled.freezer[node]
        while frozen >= 0:
            gate = compiled.parent[frozen]
            if compiled.own[gate] and not compiled.top_down and configuration.taken >> gate & 1:
                return True
            if self._sequence[gate]:
                tally = configuration.tallies.get(gate)
                if tally is not None and tally[0] > compiled.slot[frozen]:
                    return True
            if self.flags(configuration, gate) & (TOUCHED | DONE) == TOUCHED:
                return False
            frozen = compiled.freezer[gate]
        return False

    def mentioned(self, configuration: Configuration, name: str) -> bool:
        """Whether a variable occurs in an event that may still come."""
        later = self.compiled.mentions[name] & ~configuration.taken
        return any(not self._excluded(configuration, node) for node in bits(later))

    def _excluded(self, configuration: Configuration, node: int) -> bool:
        """Whether a choice in the part of a node has been made against it."""
        parent = self.compiled.parent[node]
        while parent >= 0:
            # the gate's own event touches the gate, but makes no choice
            chosen = self.compiled.ops[parent] is PartKind.ONE and self.inner(configuration, parent) & TOUCHED
            if chosen and not self.flags(configuration, node) & TOUCHED:
                return True
            node, parent = parent, self.compiled.parent[parent]
        return False

    def refresh(self, configuration: Configuration, node: int) -> bool:
        """Update the flags upwards; return False if a touched node is ruled out."""
        return self._refreshed(configuration, node, -1)

    def _refreshed(self, configuration: Configuration, node: int, top: int) -> bool:
        """Update the flags from a node up to below another one; return False if a touched node is ruled out."""
        flags, parents = configuration.flags, self.compiled.parent
        while node != top:
            old = self.flags(configuration, node)
            new = self._evaluate(configuration, node)
            if new == old:
                return True
            flags[node] = new
            if new & TOUCHED and not new & POSSIBLE:
                return False
            parent = parents[node]
            if parent < 0:
                return True
            tally = configuration.tallies.get(parent) or self._tallies[parent]
            if self._sequence[parent]:
                tally = self._in_sequence(configuration, tally, node, old, new)
            else:
                tally = tuple(map(add, tally, _CHANGES[old][new]))
            configuration.tallies[parent] = tally
            node = parent
        return True

    def _in_sequence(self, configuration: Configuration, tally: Tally, node: int, old: int, new: int) -> Tally:
        slot = self.compiled.slot[node]
        last, late, done, sure, possible, more = tally
        _, possible_now, done_now, more_now, sure_now, *_ = _CHANGES[old][new]
        done += done_now
        sure += sure_now
        if slot < last:
            return (last, late - done_now, done, sure, possible, more)
        possible += possible_now
        more += more_now
        if new & TOUCHED and slot > last:
            for child in self.compiled.children[self.compiled.parent[node]][max(last, 0) : slot]:
                _, child_possible, child_done, child_more, *_ = _COUNTED[self.flags(configuration, child)]
                late += 1 - child_done
                if late:
                    break
                possible -= child_possible
                more -= child_more
            last = slot
        return (last, late, done, sure, possible, more)

    def _evaluate(self, configuration: Configuration, node: int) -> int:
        """Return the flags of a node, by the flags of those below."""
        failing = configuration.failing
        for guard in self.compiled.pointed_from.get(node, ()) if failing else ():
            if failing >> guard & 1:
                found = self._evaluated(configuration, node) & TOUCHED
                for way in self.repaired(configuration, guard):
                    found |= self._evaluate(way, node)
                return found
        return self._evaluated(configuration, node)

    def repaired(self, configuration: Configuration, guard: int) -> Iterator[Configuration]:
        """Iterate over the ways to repair a failing guard, with flags up to below the guard's `top`.

        Either its node is not in the scenario, or a part with one of its time points needs another event.
        """
        pointed = self.compiled.pointed[guard]
        for node, is_absent in ((guard, True), *((point, False) for point in pointed.points)):
            way = configuration.copy()
            way.failing &= ~(1 << guard)
            way.dead |= is_absent << guard
            way.unfit |= (not is_absent) << node
            if node in self.compiled.members or self._refreshed(way, node, pointed.top):
                yield way

    def _evaluated(self, configuration: Configuration, node: int) -> int:
        compiled = self.compiled
        found = self.inner(configuration, node)
        if compiled.own[node]:
            if not configuration.taken >> node & 1:
                more = MORE if found & POSSIBLE else 0
                found &= TOUCHED
                if not (found and compiled.top_down):
                    found |= more
            elif compiled.top_down:
                found |= TOUCHED
            else:
                found = TOUCHED | found & (DONE | SURE)
        if configuration.dead >> node & 1:
            return found & TOUCHED
        if configuration.ended >> node & 1:
            found &= ~MORE
        if configuration.unanswered >> node & 1:
            found &= ~(DONE | SURE)
        if configuration.unfit >> node & 1 or (self._windows >> node & 1 and not found & TOUCHED):
            return found & (TOUCHED | MORE)
        return found if (configuration.closed | configuration.held) >> node & 1 else found & ~SURE

    def inner(self, configuration: Configuration, node: int) -> int:
        """Return the joint flags of a node's children."""
        compiled = self.compiled
        size = len(compiled.children[node])
        if not size:
            return DONE | SURE
        if compiled.ends >> node & 1:
            return self._in_order_of_ends(configuration, node)
        tally = configuration.tallies.get(node) or self._tallies[node]
        if self._sequence[node]:
            last, late, done, sure, possible, more = tally
            found = TOUCHED if last >= 0 else 0
            if late or possible != size - max(last, 0):
                return found
            return found | (DONE if done == size else 0) | (MORE if more else 0) | (SURE if sure == size else 0)
        touched, possible, done, more, sure, able_touched, done_touched, more_touched, sure_touched = tally
        if touched and compiled.ops[node] is PartKind.ONE:
            if touched > 1:
                return TOUCHED
            more = more_touched
        need = compiled.need[node]  # the touched children and as many others as needed
        found = TOUCHED if touched else 0
        if done_touched == touched and done >= need:
            found |= DONE
        if more and able_touched == touched and possible >= need:
            found |= MORE
        if sure_touched == touched and sure >= need:
            found |= SURE
        return found

    def _in_order_of_ends(self, configuration: Configuration, node: int) -> int:
        """Return the joint flags of children that end in order.

        In each way, the children before some child are done, and the later ones without events or with
        more.
        """
        children = self.compiled.children[node]
        touched, surely, done, first, last_more = 0, True, len(children), 0, -1
        for slot, child in enumerate(children):
            flags = self.flags(configuration, child)
            fits = flags & DONE > 0 and not configuration.owing >> child & 1
            touched |= flags & TOUCHED
            surely = surely and fits and flags & SURE > 0
            if not fits:
                done = min(done, slot)
            if flags & MORE:
                last_more = slot
            elif not flags & DONE or flags & TOUCHED:
                first = slot + 1
        found = touched | (DONE if done == len(children) else 0) | (SURE if surely else 0)
        return found | (MORE if first <= done and last_more >= first else 0)

    def reordered(self, configuration: Configuration, node: int) -> list[int]:
        """Note an event of a node for the ends in order above it; return those, inner ones first."""
        compiled, found = self.compiled, list[int]()
        parent = compiled.parent[node] if compiled.ends else -1
        while parent >= 0:
            if compiled.ends >> parent & 1:
                found.append(parent)
                configuration.owing &= ~(1 << node)
                for later in compiled.children[parent][compiled.slot[node] + 1 :]:
                    if self.flags(configuration, later) & TOUCHED:
                        configuration.owing |= 1 << later
            node, parent = parent, compiled.parent[parent]
        return found
