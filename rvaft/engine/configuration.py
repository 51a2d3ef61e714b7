"""A partial match, and how far the nodes of each read-once part have come in it.

What a node's event changes is brought up to date along the path from the node to its part's root.
Each node has four flags, all about the ways to resolve the choices below it (without a node whose
guard failed) in which the occurrences taken so far are downward closed:

- TOUCHED: an occurrence of it or below it has been taken;
- DONE: in some way the occurrences taken are all there are;
- MORE: in some way others remain;
- SURE: in some way they are all there are, and no guard of that way is still open.

A touched node that is neither DONE nor MORE is in no scenario, and neither is anything above it.
What a gate needs to know of its children are numbers of flags, so one event costs a few additions
per node on its path, however wide the gates are.
"""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from operator import add
from typing import Final, NamedTuple, Optional, TypeAlias

from rvaft.core.part_numbers import PartKind
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.model.values import Json, fingerprint


class Witness(NamedTuple):
    """The last occurrence taken, the position of its event, the values it saw, and what was before."""

    before: Optional["Witness"]
    node: int
    position: int
    values: Mapping[str, Json]


Tally: TypeAlias = tuple[int, ...]
"""What a gate knows of its children.

Of a sequence: the last child touched (or -1); how many before it are not done; how many of all are
done, and sure; and how many from it on are possible, and have more. Of another gate: how many are
touched, possible, done, have more, are sure; and how many of those touched are the same.
"""


@dataclass(slots=True)
class Configuration:
    """One partial match.

    `taken` are the occurrences that have their event. `dead` are the nodes whose guard does not
    hold, `closed` those whose guard waits for nothing. `binding` keeps the variables that still
    matter. `inversions` says which orders between two shared elements of the tree the match has
    broken: harmless while some scenario does not demand them (always empty where no node is
    shared). `flags` and `tallies` are what `PartProgress` knows, where it differs from the start;
    both follow from the rest. `witness` is how the match came about and no part of the state.
    """

    dead: int
    closed: int
    taken: int = 0
    binding: dict[str, Json] = field(default_factory=dict)
    inversions: frozenset[tuple[int, int]] = frozenset()
    flags: dict[int, int] = field(default_factory=dict)
    tallies: dict[int, Tally] = field(default_factory=dict)
    witness: Witness | None = None

    def copy(self) -> "Configuration":
        """An independent copy."""
        own = self.binding.copy(), self.inversions, self.flags.copy(), self.tallies.copy()
        return Configuration(self.dead, self.closed, self.taken, *own, self.witness)

    @property
    def key(self) -> Hashable:
        """Equal for configurations with equal futures."""
        return self.taken, self.dead, self.inversions, fingerprint(self.binding)


def history(last: Witness | None) -> list[Witness]:
    """The steps of a match up to its last one."""
    steps = []
    while last is not None:
        steps.append(last)
        last = last.before
    return steps[::-1]


class Snapshot(NamedTuple):
    """Groups of configurations in a form to be pickled: flat, since the chain of a long match is
    deeper than Python can recurse.

    A step that several matches share is written once: the number of the one before (-1 for none),
    node, position, values. Each configuration stands without its witness, with the number of its
    last step.
    """

    steps: list[tuple[int, int, int, Mapping[str, Json]]]
    groups: list[list[tuple[Configuration, int]]]
    begun: int = 0
    """The nodes of independent parts that need not begin again."""

    @classmethod
    def of(cls, *groups: list[Configuration]) -> "Snapshot":
        """What `groups_again` makes the same groups of; monitors go on while it waits to be written."""
        found, numbers = cls([], []), dict[int, int]()
        for one in chain(*groups):
            step, new = one.witness, []
            while step is not None and id(step) not in numbers:
                new.append(step)
                step = step.before
            for step in reversed(new):
                numbers[id(step)] = len(found.steps)
                before = -1 if step.before is None else numbers[id(step.before)]
                found.steps.append((before, step.node, step.position, step.values))
        for group in groups:
            found.groups.append(
                [(replace(one.copy(), witness=None), numbers.get(id(one.witness), -1)) for one in group]
            )
        return found

    def groups_again(self) -> Iterator[list[Configuration]]:
        """The groups."""
        steps: list[Witness] = []
        for before, node, position, values in self.steps:
            steps.append(Witness(None if before < 0 else steps[before], node, position, values))
        for group in self.groups:
            yield [replace(one.copy(), witness=None if last < 0 else steps[last]) for one, last in group]


TOUCHED, DONE, MORE, SURE = 1, 2, 4, 8
POSSIBLE: Final = DONE | MORE


def _counted(flags: int) -> Tally:
    touched, possible, done, more, sure = (int(flags & mask > 0) for mask in (TOUCHED, POSSIBLE, DONE, MORE, SURE))
    return (touched, possible, done, more, sure, *(touched * n for n in (possible, done, more, sure)))


_COUNTED: Final = [_counted(flags) for flags in range(16)]
_CHANGES: Final = [[tuple(b - a for a, b in zip(x, y, strict=True)) for y in _COUNTED] for x in _COUNTED]
"""From the flags of a child before and after to the change of the tally."""


class PartProgress:
    """The flags of all nodes before any event, and their change as occurrences are taken."""

    def __init__(self, compiled: CompiledTree) -> None:
        self.compiled = compiled
        self._sequence = [op is PartKind.SEQUENCE for op in compiled.ops]
        self._flags = [0] * len(compiled.names)
        self._tallies: list[Tally] = [()] * len(compiled.names)
        start = Configuration(compiled.dead, compiled.closed)
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
        """The flags of a node of a part."""
        found = configuration.flags.get(node)
        return self._flags[node] if found is None else found

    def over(self, configuration: Configuration, node: int) -> bool:
        """Whether something that comes after the node, or after a part that it is in, has been taken."""
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
                return False  # what is in use and not done cannot be over, and no more can what contains it
            frozen = compiled.freezer[gate]
        return False

    def refresh(self, configuration: Configuration, node: int) -> bool:
        """Bring the flags of a node and of those above it up to date; False where one in use is ruled out."""
        flags, parents = configuration.flags, self.compiled.parent
        while True:
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

    def _in_sequence(self, configuration: Configuration, tally: Tally, node: int, old: int, new: int) -> Tally:
        """The tally of a sequence after a change of the flags of one child."""
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
                    break  # the gate is in no scenario any more, whatever the rest
                possible -= child_possible
                more -= child_more
            last = slot
        return (last, late, done, sure, possible, more)

    def _evaluate(self, configuration: Configuration, node: int) -> int:
        """The flags of a node from what is taken and what it knows of its children."""
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
        return found if configuration.closed >> node & 1 else found & ~SURE

    def inner(self, configuration: Configuration, node: int) -> int:
        """The flags of a node's children taken together; without children there is nothing left to do."""
        compiled = self.compiled
        size = len(compiled.children[node])
        if not size:
            return DONE | SURE
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
        need = compiled.need[node]  # those touched and as many others as are needed
        found = TOUCHED if touched else 0
        if done_touched == touched and done >= need:
            found |= DONE
        if more and able_touched == touched and possible >= need:
            found |= MORE
        if sure_touched == touched and sure >= need:
            found |= SURE
        return found
