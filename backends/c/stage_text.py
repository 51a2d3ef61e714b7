"""The writer of C for a property whose partial matches have stages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import ClassVar, Final

from backends.c.common_text import CELL, LONG, WORD, ConstantTable, Use, Writer, array, laid_out, times
from backends.c.events import expression
from backends.c.stages import Break, Load, Recall, Remembered, Slot, StageTable, TableStage, Test, Transition, slot_of
from rvaft.core.property import Property
from rvaft.model.guards import Guard, Operator
from rvaft.model.patterns import Pattern
from rvaft.model.verdict import Semantics

CAPACITY: Final = 1024
"""The default number of partial matches."""


class StageWriter(Writer):
    """Writes stages, and their moves."""

    runtime: ClassVar[tuple[str, ...]] = ("stages.c",)

    def __init__(
        self,
        prop: Property,
        semantics: Semantics,
        found: StageTable,
        use: Use,
    ) -> None:
        super().__init__(prop, semantics, use)
        self._found = found
        self._scattered = semantics is Semantics.SCATTERED
        self._loads, self._joins, self._slots, self._order, self._expiries = (ConstantTable() for _ in range(5))
        self._most_links = 1
        stages = found.stages
        self._absences = any(
            stage.breaks or stage.waits or any(move.recalls for move in stage.moves) for stage in stages
        )
        self._waits = any(stage.waits for stage in stages)
        recalls = (recall.remembered for stage in stages for move in stage.moves for recall in move.recalls)
        self._remembered = {one: number for number, one in enumerate(dict.fromkeys(recalls))}
        self._recalls = ConstantTable()

    def _observing(self) -> Property:
        return self._prop

    def _guard(self, tests: Iterable[Test], bound: Mapping[str, int], more: Iterable[str] = ()) -> int:
        """Return the number of the conjunction of some tests, and of further ones in C; 0 for none."""
        parts = [*more]
        for test in tests:
            loads = dict(test.loads)

            def term(guard: Guard, loads: Mapping[Slot, Load] = loads) -> str | None:
                slot = slot_of(guard)
                return None if slot is None else _term(slot, loads[slot], bound)

            parts.append(f"holds({expression(test.guard, term)})")
        text = " && ".join(dict.fromkeys(parts))
        return self._guards.setdefault(text, len(self._guards) + 1) if text else 0

    def _links(self, stage: TableStage) -> list[tuple[int, ...]]:
        """Return the lists of slots by which partial matches of a stage are found."""
        exact = tuple(range(stage.exact))
        joins = chain((move.joins for move in stage.moves), (one.joins for one in stage.breaks))
        joined = (tuple(sorted(slot for slot, _ in some)) for some in joins)
        return list(dict.fromkeys((exact, *joined))) if self._scattered else [exact]

    def _move(self, number: int, move: Transition, links: Sequence[tuple[int, ...]]) -> str:
        pattern = self._pattern(move.pattern)
        bound = self._bound[pattern]
        defined = [f"{_term(slot, load, bound)}.tag == RVAFT_INTEGER" for slot, load in move.defined]
        guard = self._guard(move.tests, bound, defined)
        loads = self._loads.place([_load(slot, load, bound) for slot, load in move.loads])
        joins = self._joins.place([f"{{{slot}, {bound[name]}}}" for slot, name in move.joins])
        link = links.index(tuple(sorted(slot for slot, _ in move.joins))) if self._scattered else 0
        recalls = self._recalls.place([self._recall(one, bound) for one in move.recalls]) if move.recalls else 0
        more = f", {recalls}, {len(move.recalls)}" if self._remembered else ""
        return f"{{{number}, {move.target}, {pattern}, {guard}, {loads}, {joins}, {len(move.joins)}, {link}{more}}}"

    def _break(self, number: int, one: Break, links: Sequence[tuple[int, ...]]) -> str:
        pattern = self._pattern(one.pattern)
        bound = self._bound[pattern]
        until = [] if one.end is None else [f"comes_by(e, OLD({one.end}), INT64_C({one.duration}))"]
        guard = self._guard([] if one.test is None else [one.test], bound, until)
        joins = self._joins.place([f"{{{slot}, {bound[name]}}}" for slot, name in one.joins])
        link = links.index(tuple(sorted(slot for slot, _ in one.joins))) if self._scattered else 0
        more = ", 0, 0" if self._remembered else ""
        return f"{{{number}, NONE, {pattern}, {guard}, 0, {joins}, {len(one.joins)}, {link}{more}}}"

    def _recall(self, recall: Recall, bound: Mapping[str, int]) -> str:
        """Return the row of what must not have come; its guard reads remembered values."""
        guard = 0 if recall.test is None else self._guard([recall.test], bound)
        loads = self._loads.place([_load(slot, load, bound) for slot, load in recall.loads]) if recall.loads else 0
        return f"{{{self._remembered[recall.remembered]}, {guard}, {loads}}}"

    def _remember(self, one: Remembered) -> str:
        pattern = self._pattern(one.pattern)
        bound = self._bound[pattern]
        loads = tuple((Slot((name,)), Load(variable=name)) for name in bound if not name.startswith("_"))
        guard = 0 if one.guard is None else self._guard([Test(one.guard, loads)], bound)
        fields = self._slots.place([str(bound[name]) for name in one.names]) if one.names else 0
        timed = "-1" if one.duration is None else f"INT64_C({one.duration})"
        return f"{{{pattern}, {guard}, {fields}, {len(one.names)}, {one.joined}, {timed}}}"

    def _tables(self) -> str:
        stages = self._found.stages
        rows, moves, owners, waits = list[str](), list[str](), list[int](), list[str]()
        for number, stage in enumerate(stages):
            links = self._links(stage)
            self._most_links = max(self._most_links, len(links))
            link = self._slots.place([str(one) for slots in links for one in (len(slots), *slots)])
            order = self._order.place([str(int(one)) for one in stage.smaller])
            expiries = self._expiries.place([f"{{{slot}, INT64_C({most})}}" for slot, most in stage.expiries])
            if self.late is None:
                expiries = 0
            more = f", {len(stage.breaks)}, {len(waits)}, {len(stage.waits)}" if self._absences else ""
            rows.append(
                f"{{{stage.rank}, {len(stage.slots)}, {stage.exact}, {len(moves)}, {len(stage.moves)}, {len(links)}, "
                f"{link}, {order}, {expiries}, {len(stage.expiries)}{more}}}"
            )
            moves += [self._move(number, move, links) for move in stage.moves]
            moves += [self._break(number, one, links) for one in stage.breaks]
            owners += [number] * (len(stage.moves) + len(stage.breaks))
            for wait in stage.waits:
                loads = self._loads.place([_load(slot, load, {}) for slot, load in wait.loads]) if wait.loads else 0
                waits.append(f"{{{wait.slot}, {wait.target}, {loads}, INT64_C({wait.most})}}")
        remembered = [self._remember(one) for one in self._remembered]
        made = [
            array("stage", "stages", rows),
            array("move", "moves", moves or ["{0, 0, 0, 0, 0, 0, 0, 0}"]),
            array("load", "loads", self._loads.rows or ["{COPY, 0, 0}"]),
            array("join", "joins", self._joins.rows or ["{0, 0}"]),
            array("uint16_t", "link_slots", self._slots.rows),
            array("wait", "waits", waits) if waits else "",
            array("recall", "recalls", self._recalls.rows) if remembered else "",
            array("remembered", "all_remembered", remembered) if remembered else "",
            array("uint8_t", "slot_order", self._order.rows or ["0"]),
            array("uint32_t", "starts", [str(one) for one in self._found.starts]),
            self._key_fields(),
            *([] if self._use.by is None else self._places_of(self._use.by)),
        ]
        if self._scattered:
            made += self._moves_by_pattern(owners)
        signature = "rvaft_monitor *m, uint32_t number, const cell *old, const rvaft_event *e"
        unused = ("    int *error = &m->error;\n", "    (void)error;\n    (void)old;\n    (void)e;\n")
        return "".join([*made, self._matching(signature, unused)])

    def _places_of(self, by: str) -> Iterator[str]:
        """Yield the tables of the slot of a variable in each stage, and of its field in each pattern."""
        slot = Slot((by,))
        slots = (str(one.slots.index(slot)) if slot in one.slots else "NONE" for one in self._found.stages)
        yield array("uint32_t", "by_slots", [*slots])
        yield array("uint16_t", "by_fields", [str(bound.get(by, 0)) for bound in self._bound] or ["0"])

    def _moves_by_pattern(self, owners: Sequence[int]) -> Iterator[str]:
        stages = self._found.stages
        order = sorted(range(len(owners)), key=lambda number: stages[owners[number]].rank)
        moves, breaks, place = dict[int, Pattern](), dict[int, Pattern](), 0
        for stage in stages:
            moves |= {place + n: one.pattern for n, one in enumerate(stage.moves)}
            place += len(stage.moves)
            breaks |= {place + n: one.pattern for n, one in enumerate(stage.breaks)}
            place += len(stage.breaks)
        for name, rows in (("moves", moves), *([("breaks", breaks)] if self._absences else [])):
            by_pattern: list[list[int]] = [[] for _ in self._tests] or [[]]
            for number in order:
                if number in rows:
                    by_pattern[self._patterns[rows[number]]].append(number)
            begins = [sum(map(len, by_pattern[:place])) for place in range(len(by_pattern) + 1)]
            yield array("uint32_t", f"pattern_{name}", [str(one) for one in begins])
            yield array("uint32_t", f"sorted_{name}", [str(one) for some in by_pattern for one in some] or ["0"])
        if self._expiring:
            yield array("expiry", "expiries", self._expiries.rows)

    @property
    def _expiring(self) -> bool:
        return self._scattered and self.late is not None and bool(self._expiries.rows)

    @property
    def _counts(self) -> tuple[int, int]:
        return len(self._found.stages), sum(len(stage.moves) for stage in self._found.stages)

    @property
    def _ends(self) -> bool:
        """Whether an event may end a partial match."""
        return self._absences or self._use.by is not None

    @property
    def _links_in_all(self) -> int:
        """The most lists by which a partial match is found, with that of the variable of repetition."""
        return self._most_links + int(self._use.by is not None)

    @property
    def _width(self) -> int:
        return max(len(stage.slots) for stage in self._found.stages)

    def _summary(self) -> str:
        stages, moves = self._counts
        most = max((len(stage.moves) for stage in self._found.stages), default=0)
        tests = max((len(stage.breaks) + len(stage.waits) for stage in self._found.stages), default=0)
        absent = f" and {tests} tests of absence" if tests else ""
        kinds = len(self._remembered)
        kept = (
            "   Events that may not come before others are remembered by their values: RVAFT_PAST.\n" if kinds else ""
        )
        return (
            f"   {stages} stages, {moves} moves, at most {self._width} values in a partial match.\n"
            f"   Work per event: at most {most} moves{absent} for each of RVAFT_CAPACITY partial matches.\n{kept}"
        )

    @property
    def _capacity(self) -> int:
        stages = len(self._found.stages)
        return CAPACITY if self._width or self._past_width else 4 * stages if self._absences else stages

    @property
    def _past_width(self) -> int:
        """The most values of a remembered event."""
        return max((len(one.names) for one in self._remembered), default=0)

    @property
    def _texts(self) -> int:
        kept = int(any(not slot.timed for stage in self._found.stages for slot in stage.slots))
        return kept + int(self._past_width > 0)

    def _members(self) -> Iterable[tuple[int, int]]:
        links = self._links_in_all
        own = 2 if self._key else 0
        ended = int(self._ends)
        partial = laid_out(times(WORD, links + 1 + own + ended), times(CELL, max(1, self._width)))
        buckets = times(WORD, 2 * links * self._buckets)
        store = laid_out(times(WORD, 3), buckets, times(partial, self._capacity + 1))
        made = [WORD, WORD, times(store, 1 if self._scattered else 2)]
        made += [WORD, WORD] if self._ends else []
        made += [LONG] if self._waits else []
        if self._remembered:
            owner = [WORD, LONG] if self._key else []
            past = laid_out(WORD, WORD, *owner, LONG, times(CELL, max(1, self._past_width)))
            number = self._capacity if self._past_width else len(self._remembered)
            made += [WORD, WORD, times(WORD, self._buckets), times(past, number)]
        return made

    def _sizes(self) -> Mapping[str, object]:
        stages = self._found.stages
        return {
            "SCATTERED": int(self._scattered),
            "PROJECTS": int(self._semantics.projects),
            "CONSECUTIVE": int(self._semantics is Semantics.CONSECUTIVE),
            "STORES": 1 if self._scattered else 2,
            "WIDTH": max(1, self._width),
            "DEPTH": max(stage.rank for stage in stages),
            "LINKS": self._links_in_all,
            "STARTS": len(self._found.starts),
            "STAGES": len(stages),
            "MOVES": max(1, sum(len(stage.moves) + len(stage.breaks) for stage in stages)),
            "ABSENCES": int(self._absences),
            "WAITS": int(self._waits),
            "REMEMBERED": len(self._remembered),
            "PAST_WIDTH": max(1, self._past_width),
            "PAST": "RVAFT_CAPACITY" if self._past_width else max(1, len(self._remembered)),
            "EXPIRIES": int(self._expiring),
        }


def _term(slot: Slot, load: Load, bound: Mapping[str, int]) -> str:
    if load.variable:
        return f"E({bound[load.variable]})"
    if load.past is not None:
        return f"PAST({load.past})"
    if load.slot is None:
        return "AT"
    if not load.now:
        return f"OLD({load.slot})"
    return f"{'later' if slot.operator is Operator.MAX else 'earlier'}(OLD({load.slot}), AT)"


def _load(slot: Slot, load: Load, bound: Mapping[str, int]) -> str:
    if load.variable:
        return f"{{FIELD, 0, {bound[load.variable]}}}"
    if load.slot is None:
        return "{NOW, 0, 0}"
    if not load.now:
        return f"{{COPY, {load.slot}, 0}}"
    return f"{{{'LATEST' if slot.operator is Operator.MAX else 'EARLIEST'}, {load.slot}, 0}}"
