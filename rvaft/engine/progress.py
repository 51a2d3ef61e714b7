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

from rvaft.engine.compiled_tree import Plan
from rvaft.engine.configuration import Configuration
from rvaft.model.nodes import Gate

TOUCHED, DONE, MORE, SURE = 1, 2, 4, 8
POSSIBLE = DONE | MORE

Tally = tuple[int, ...]


def _weights(flags: int) -> Tally:
    touched, done, more, sure = (int(bool(flags & flag)) for flag in (TOUCHED, DONE, MORE, SURE))
    possible = int(bool(flags & POSSIBLE))
    return (touched, possible, done, more, sure, *(touched * n for n in (possible, done, more, sure)))


# Children that are: touched, possible, done, more, sure; and touched and possible, done, more, sure.
_WEIGHTS = tuple(_weights(flags) for flags in range(16))


class Progress:
    """The flags of all nodes before any event, and their change as occurrences are taken."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._flags = [0] * len(plan.names)
        self._tallies: list[Tally] = [()] * len(plan.names)
        start = self.start()
        core = set(plan.core)
        for node in range(len(plan.names) - 1, -1, -1):
            if node not in core:
                self._tallies[node] = self._count(node)
                self._flags[node] = self._evaluate(start, node)

    def start(self) -> Configuration:
        """The configuration before any event."""
        return Configuration(self.plan.dead, self.plan.closed)

    def flags(self, configuration: Configuration, node: int) -> int:
        """The flags of a node of a part."""
        return configuration.flags.get(node, self._flags[node])

    def take(self, configuration: Configuration, node: int) -> bool:
        """Take a node's occurrence; False where the configuration is then in no scenario (and useless)."""
        if self.over(configuration, node):
            return False
        configuration.taken |= 1 << node
        return self.refresh(configuration, node)

    def over(self, configuration: Configuration, node: int) -> bool:
        """Whether something that comes after the node, or after a part that it is in, has been taken."""
        frozen = self.plan.freezer[node]
        while frozen >= 0:
            gate = self.plan.parent[frozen]
            if self._ended(configuration, gate, self.plan.slot[frozen]):
                return True
            if self.flags(configuration, gate) & (TOUCHED | DONE) == TOUCHED:
                return False  # what is in use and not done cannot be over, and no more can what contains it
            frozen = self.plan.freezer[gate]
        return False

    def _ended(self, configuration: Configuration, gate: int, slot: int) -> bool:
        """Whether something that comes after a child of a gate has been taken."""
        if self.plan.own[gate] and not self.plan.top_down and configuration.taken >> gate & 1:
            return True
        kind = self.plan.gates[gate]
        return kind is not None and kind.ordered and self._tally(configuration, gate)[0] > slot

    def refresh(self, configuration: Configuration, node: int) -> bool:
        """Bring the flags of a node and of those above it up to date; False where one in use is ruled out."""
        plan = self.plan
        while True:
            old = self.flags(configuration, node)
            new = self._evaluate(configuration, node)
            if new == old:
                return True
            configuration.flags[node] = new
            if new & TOUCHED and not new & POSSIBLE:
                return False
            parent = plan.parent[node]
            if parent < 0:
                return True
            configuration.tallies[parent] = self._recount(configuration, parent, plan.slot[node], old, new)
            node = parent

    # -- what a gate knows of its children ----------------------------------------------------------------------

    def _tally(self, configuration: Configuration, gate: int) -> Tally:
        return configuration.tallies.get(gate) or self._tallies[gate]

    def _count(self, gate: int) -> Tally:
        """The tally before any event, when no child is touched."""
        counts = [0] * 9
        for child in self.plan.children[gate]:
            counts = [a + b for a, b in zip(counts, _WEIGHTS[self._flags[child]], strict=True)]
        kind = self.plan.gates[gate]
        if kind is not None and kind.ordered:
            _, possible, done, more, sure, *_ = counts
            return (-1, 0, done, sure, possible, more)
        return tuple(counts)

    def _recount(self, configuration: Configuration, gate: int, slot: int, old: int, new: int) -> Tally:
        kind = self.plan.gates[gate]
        if kind is not None and kind.ordered:
            return self._recount_ordered(configuration, gate, slot, old, new)
        before = self._tally(configuration, gate)
        return tuple([n - a + b for n, a, b in zip(before, _WEIGHTS[old], _WEIGHTS[new], strict=True)])

    def _recount_ordered(self, configuration: Configuration, gate: int, slot: int, old: int, new: int) -> Tally:
        """The tally of an ordered gate.

        It is: the last child touched (or -1); how many before it are not done; how many of all are done, and sure; and how many
        from it on are possible, and have more.
        """
        last, late, done, sure, possible, more = self._tally(configuration, gate)
        _, was_possible, was_done, was_more, was_sure, *_ = _WEIGHTS[old]
        _, is_possible, is_done, is_more, is_sure, *_ = _WEIGHTS[new]
        done += is_done - was_done
        sure += is_sure - was_sure
        if slot < last:
            late += was_done - is_done
            return (last, late, done, sure, possible, more)
        possible += is_possible - was_possible
        more += is_more - was_more
        if new & TOUCHED and slot > last:
            for child in self.plan.children[gate][max(last, 0) : slot]:
                _, child_possible, child_done, child_more, *_ = _WEIGHTS[self.flags(configuration, child)]
                late += 1 - child_done
                if late:
                    break  # the gate is in no scenario any more, whatever the rest
                possible -= child_possible
                more -= child_more
            last = slot
        return (last, late, done, sure, possible, more)

    # -- the flags of one node ------------------------------------------------------------------------------------

    def _evaluate(self, configuration: Configuration, node: int) -> int:
        inner = self.inner(configuration, node)
        if self.plan.own[node]:
            inner = self._with_own(inner, taken=bool(configuration.taken >> node & 1))
        if configuration.dead >> node & 1:
            return inner & TOUCHED
        if not configuration.closed >> node & 1:
            return inner & ~SURE
        return inner

    def _with_own(self, inner: int, *, taken: bool) -> int:
        """The flags of a node with a runtime event, from those of its children taken together."""
        if self.plan.top_down:
            if taken:
                return inner | TOUCHED
            return TOUCHED if inner & TOUCHED else MORE if inner & POSSIBLE else 0
        if taken:
            return TOUCHED | (inner & (DONE | SURE))
        return inner & TOUCHED | (MORE if inner & POSSIBLE else 0)

    def inner(self, configuration: Configuration, node: int) -> int:
        """The flags of a node's children taken together; without children there is nothing left to do."""
        gate = self.plan.gates[node]
        if gate is None:
            return DONE | SURE
        tally = self._tally(configuration, node)
        if gate.ordered:
            last, late, done, sure, possible, more = tally
            size = len(self.plan.children[node])
            able = late == 0 and possible == size - max(last, 0)
            return _flags(last >= 0, able and done == size, able and more > 0, able and sure == size)
        if gate is Gate.AND:
            touched, possible, done, more, sure, *_ = tally
            size = len(self.plan.children[node])
            return _flags(touched, done == size, possible == size and more > 0, sure == size)
        return self._choice(tally, gate, self.plan.thresholds[node])

    def _choice(self, tally: Tally, gate: Gate, threshold: int) -> int:
        touched, possible, done, more, sure, touched_possible, touched_done, touched_more, touched_sure = tally
        if gate is Gate.OR:
            if touched == 0:
                return _flags(0, done, more, sure)
            return _flags(1, *((touched_done, touched_more, touched_sure) if touched == 1 else (0, 0, 0)))
        return _flags(
            touched,
            touched_done == touched and done >= threshold,
            touched_possible == touched and possible >= threshold and more > 0,
            touched_sure == touched and sure >= threshold,
        )


def _flags(touched: int, done: int, more: int, sure: int) -> int:
    return (TOUCHED if touched else 0) | (DONE if done else 0) | (MORE if more else 0) | (SURE if sure else 0)
