"""How far the nodes of a read-once part have come, kept up to date along the path from a node to its part's root.

Each node has four flags, all about the ways to resolve the choices below it (without a node whose guard failed) in which the
occurrences taken so far are downward closed:

- TOUCHED: an occurrence of it or below it has been taken;
- DONE: in some way the occurrences taken are all there are;
- MORE: in some way others remain;
- SURE: in some way they are all there are, and no guard of that way is still open.

A touched node that is neither DONE nor MORE is in no scenario, and neither is anything above it. What a gate needs to know
of its children are numbers of flags, so one event costs a few additions per node on its path, however wide the gates are.
"""

from operator import add
from typing import Final, TypeAlias

from rvaft.analysis.normal_form import Op
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import Configuration

TOUCHED, DONE, MORE, SURE = 1, 2, 4, 8
POSSIBLE: Final = DONE | MORE

Tally: TypeAlias = tuple[int, ...]
"""What a gate knows of its children.

Of a sequence: the last child touched (or -1); how many before it are not done; how many of all are done, and sure; and how many
from it on are possible, and have more. Of another gate: how many are touched, possible, done, have more, are sure; and how many of
those touched are the same.
"""


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
        self._sequence = [op is Op.SEQUENCE for op in compiled.ops]
        self._flags = [0] * len(compiled.names)
        self._tallies: list[Tally] = [()] * len(compiled.names)
        start = Configuration(compiled.dead, compiled.closed)
        for node in range(len(compiled.names) - 1, -1, -1):
            if node not in compiled.members:
                counts = [
                    sum(n) for n in zip(*(_COUNTED[self._flags[c]] for c in compiled.children[node]), strict=True)
                ]
                if self._sequence[node]:
                    _, possible, done, more, sure, *_ = counts
                    counts = [-1, 0, done, sure, possible, more]
                self._tallies[node] = tuple(counts)
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
            if self._sequence[parent]:
                tally = self._in_sequence(configuration, node, old, new)
            else:
                tally = tuple(map(add, configuration.tallies.get(parent) or self._tallies[parent], _CHANGES[old][new]))
            configuration.tallies[parent] = tally
            node = parent

    def _in_sequence(self, configuration: Configuration, node: int, old: int, new: int) -> Tally:
        """The tally of a sequence after a change of the flags of one child."""
        gate, slot = self.compiled.parent[node], self.compiled.slot[node]
        last, late, done, sure, possible, more = configuration.tallies.get(gate) or self._tallies[gate]
        _, possible_now, done_now, more_now, sure_now, *_ = _CHANGES[old][new]
        done += done_now
        sure += sure_now
        if slot < last:
            return (last, late - done_now, done, sure, possible, more)
        possible += possible_now
        more += more_now
        if new & TOUCHED and slot > last:
            for child in self.compiled.children[gate][max(last, 0) : slot]:
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
            taken = configuration.taken >> node & 1
            if not taken:
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
            last, late, is_done, is_sure, possible, more = tally
            if late or possible != size - max(last, 0):
                return TOUCHED if last >= 0 else 0
            return (
                (TOUCHED if last >= 0 else 0)
                | (DONE if is_done == size else 0)
                | (MORE if more else 0)
                | (SURE if is_sure == size else 0)
            )
        touched, possible, done, more, sure, able_touched, done_touched, more_touched, sure_touched = tally
        if compiled.ops[node] is not Op.ONE:  # those touched and as many others as are needed
            need = compiled.need[node]
            found = TOUCHED if touched else 0
            if done_touched == touched and done >= need:
                found |= DONE
            if more and able_touched == touched and possible >= need:
                found |= MORE
            if sure_touched == touched and sure >= need:
                found |= SURE
            return found
        if not touched:
            return (DONE if done else 0) | (MORE if more else 0) | (SURE if sure else 0)
        if touched > 1:
            return TOUCHED
        return TOUCHED | (DONE if done_touched else 0) | (MORE if more_touched else 0) | (SURE if sure_touched else 0)
