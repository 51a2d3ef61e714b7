"""The writers of C for units: for each node the match that starts last, or a front of matches."""

from collections.abc import Iterable, Mapping
from typing import ClassVar, Final

from backends.c.common_text import CELL, LONG, WORD, Use, Writer, array, laid_out, rows, times
from backends.c.events import expression
from backends.c.unit_tables import NONE, PlacedLeaf, UnitTables, duration
from rvaft.core.passes import expand_times
from rvaft.core.property import Property
from rvaft.model.guards import Guard
from rvaft.model.patterns import Variable
from rvaft.model.verdict import Semantics

CAPACITY: Final = 1024
"""The default number of partial matches; an instance counts as one for each `SHARE` of its starts."""
SHARE: Final = 8
_ROOM: Final = 16
"""The events of matches for which there is room, for each partial match."""


class UnitWriter(Writer):
    """Writes nodes and leaves."""

    runtime: ClassVar[tuple[str, ...]] = ("starts.c", "units.c")

    def __init__(self, prop: Property, found: UnitTables, use: Use) -> None:
        super().__init__(prop, Semantics.SCATTERED, use)
        self._found = found

    def _observing(self) -> Property:
        return expand_times(self._prop)

    @property
    def _counts(self) -> tuple[int, int]:
        return len(self._found.nodes), len(self._found.leaves)

    def _tables(self) -> str:
        names, leaves = list[str](), list[str]()
        for one in self._found.leaves:
            pattern = self._pattern(one.leaf.pattern)
            bound = self._bound[pattern]
            leaves.append(self._leaf(one, pattern, self._guard(one.leaf.guard, bound), len(names)))
            names += [str(bound[name]) for name in one.names]
        by = self._use.by
        kinds = [
            f"{{{len(kind.names)}, {kind.slots}, {duration(kind.window)}{more}}}"
            for kind in self._found.kinds
            for more in ["" if by is None else f", {kind.names.index(by)}"]
        ]
        made = (
            rows("node", "nodes", self._found.nodes, self._found.names),
            rows("leaf", "leaves", leaves, (one.leaf.source for one in self._found.leaves)),
            array("kind", "kinds", kinds) if self._named or not self._found.fronts else "",
            array("uint32_t", "names", names or ["0"]) if self._named else "",
            self._key_fields(),
        )
        unused = ("    (void)error;\n    (void)e;\n",)
        return "".join([*made, self._matching("int *error, uint32_t number, const rvaft_event *e", unused)])

    def _leaf(self, one: PlacedLeaf, pattern: int, guard: int, names: int) -> str:
        after = NONE if one.after is None else one.after
        counted = f"{one.kind}, {one.leaf.number}, {one.ring}, {int(one.leaf.timed)}, {int(one.settled)}"
        more = "" if self._found.fronts else f", {one.levels}, {one.room}"
        return f"{{{one.node}, {one.unit}, {pattern}, {guard}, {after}, {names}, {counted}{more}}}"

    def _guard(self, guard: Guard | None, bound: Mapping[str, int]) -> int:
        """Return the number of a guard, 0 for none."""
        if guard is None:
            return 0

        def term(inner: Guard) -> str | None:
            return f"E({bound[inner.name]})" if isinstance(inner, Variable) else None

        return self._guards.setdefault(f"holds({expression(guard, term)})", len(self._guards) + 1)

    @property
    def _capacity(self) -> int:
        return CAPACITY if self._named else 0

    @property
    def _named(self) -> bool:
        return bool(self._key or self._texts)

    @property
    def _texts(self) -> int:
        return max(len(kind.names) for kind in self._found.kinds)

    @property
    def _share(self) -> int:
        """The number of partial matches as which an instance counts."""
        return max(1, -(-self._found.starts // SHARE))

    @property
    def _instances(self) -> int:
        return -(-self._capacity // self._share) if self._named else len(self._found.kinds)

    def _summary(self) -> str:
        nodes, leaves = self._counts
        names = dict.fromkeys(" with ".join(one.names) for one in self._found.leaves if one.names)
        named = [f"a value of {' or '.join(names)}"] if names else []
        named += ["a value of the key of the log"] if self._key else []
        room = f"Instances: {self._instances}" + (f", each for {' and '.join(named)}" if named else "")
        return (
            f"   {nodes} nodes, {leaves} leaves, at most {self._found.starts} starts of matches in an instance.\n"
            f"   {room}.\n"
            "   Work per event: for each leaf that it fits, the nodes above and their children.\n"
        )

    def _members(self) -> Iterable[tuple[int, int]]:
        named: list[tuple[int, int]] = []
        if self._named:
            named = [WORD, WORD, *([WORD, WORD] if self._key else []), *([LONG] if self._expiring else [])]
            named.append(times(CELL, max(1, self._texts)))
        table = [times(WORD, 6 + self._buckets)] if self._named else []
        return [LONG, laid_out(*table, times(laid_out(*named, self._kept), self._instances + 1))]

    @property
    def _kept(self) -> tuple[int, int]:
        """The layout of what an instance keeps."""
        start = laid_out(LONG, *([LONG] if self._found.timed else []))
        ring = times(laid_out(WORD, WORD), self._most("rings"))
        return laid_out(times(WORD, self._most("order")), ring, times(start, self._most("starts")))

    def _most(self, what: str) -> int:
        found: Iterable[int] = (getattr(kind, what) for kind in self._found.kinds)
        return max(1, *found)

    @property
    def _expiring(self) -> bool:
        windows = any(kind.window is not None for kind in self._found.kinds)
        return self._named and self.late is not None and windows

    def _sizes(self) -> Mapping[str, object]:
        found = self._found
        share = self._share
        shared = "RVAFT_CAPACITY" if share == 1 else f"((RVAFT_CAPACITY + {share - 1}U) / {share}U)"
        needed = self._most("events") + 4 * found.depth + found.levels + 8
        room = min(needed, _ROOM * self._share) if self._named else needed
        return {
            "FRONTS": 0,
            "WINDOWS": int(found.timed),
            "WAITS": 0,
            "EXPIRIES": int(self._expiring),
            "RINGED": int(any(kind.rings for kind in found.kinds)),
            "LEVELS": found.levels,
            "NODES": len(found.nodes),
            "LEAVES": len(found.leaves),
            "DEPTH": found.depth,
            "NAMES": max(1, self._texts),
            "SLOTS": max(kind.slots for kind in found.kinds),
            "STARTS": self._most("starts"),
            "RINGS": self._most("rings"),
            "ORDER": self._most("order"),
            "INSTANCES": shared if self._named else len(found.kinds),
            "EVENTS": f"({room}U * RVAFT_INSTANCES + {needed}U)",
        }


class FrontWriter(UnitWriter):
    """Writes nodes and leaves where times may decrease within a window."""

    runtime: ClassVar[tuple[str, ...]] = ("fronts.c", "units.c")

    @property
    def _capacity(self) -> int:
        return CAPACITY

    def _summary(self) -> str:
        named, within = (
            super()._summary(),
            "   Partial matches: RVAFT_CAPACITY, of which none of a node lies within another.\n",
        )
        first, found, _, *others = named.splitlines(keepends=True)
        return "".join((first, found, within, *others))

    @property
    def _kept(self) -> tuple[int, int]:
        ring = times(WORD, 5 * self._most("rings"))
        return laid_out(times(WORD, 2 * self._most("slots")), ring)

    def _members(self) -> Iterable[tuple[int, int]]:
        span = laid_out(times(LONG, 4), WORD, WORD)
        return [laid_out(times(WORD, 4), times(span, self._capacity)), *super()._members()]

    def _sizes(self) -> Mapping[str, object]:
        found = self._found
        needed = 8 * found.depth + 64
        own = {
            "FRONTS": self._most("slots"),
            "NEED": found.need,
            "SIBLINGS": found.siblings,
            "EVENTS": f"({min(2 * found.depth + 4, _ROOM)}U * RVAFT_CAPACITY + {needed}U)",
        }
        return {**super()._sizes(), **own}
