"""The writer of C: the tables of a property, between the two parts of the runtime."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from textwrap import fill
from typing import Final

from backends.c.events import EventFields, Step, expression
from backends.c.questions import comment
from backends.c.stages import Load, Slot, StageTable, TableStage, Test, Transition, slot_of, stages_of
from rvaft.core.property import Property
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.event_time import EventTime, TextFormat, TimeFormat
from rvaft.model.guards import Guard, Operator
from rvaft.model.patterns import Pattern, Variable
from rvaft.model.verdict import Semantics

CAPACITY: Final = 1024
"""The default number of partial matches."""
_KEYS: Final = 1024
"""The default number of values of a key."""
_FILES: Final = ("runtime.c", "json.c", "program.c")
_INDENT: Final = "   "
_MARK: Final = "/* @tables */\n"
_BUCKETS: Final = range(6, 23)
_SCALES: Final[Mapping[TimeFormat, int]] = {
    TimeFormat.SECONDS: 9,
    TimeFormat.MILLISECONDS: 6,
    TimeFormat.MICROSECONDS: 3,
    TimeFormat.NANOSECONDS: 0,
}
_LONG: Final = 1 << 62
_SHORT: Final = 1 << 16


class ConstantTable:
    """The rows of a table; equal runs of rows are stored once."""

    def __init__(self) -> None:
        self.rows: list[str] = []
        self._known: dict[Hashable, int] = {}

    def place(self, rows: Sequence[str]) -> int:
        """Return the place of these rows."""
        key = tuple(rows)
        if key not in self._known:
            self._known[key] = len(self.rows)
            self.rows += rows
        return self._known[key]


@dataclass(frozen=True)
class WrittenMonitor:
    """A text of C with its sizes."""

    text: str
    stages: int
    moves: int


KeyField = tuple[tuple[str, ...], tuple[str, ...]]
"""The paths of a key in an event: the second is read where the first is absent."""


@dataclass(frozen=True)
class EventTests:
    """The tests by which a monitor groups the events of a log, to count them.

    Events of a group pass the same tests, and have the same texts in the fields `apart`. `clock` is the
    field of times where a tree declares none.
    """

    letters: Sequence[tuple[Pattern, Guard | None]]
    apart: Sequence[str]
    clock: str


def translation(
    prop: Property,
    semantics: Semantics,
    limit: int,
    key: Sequence[KeyField] = (),
    counted: EventTests | None = None,
) -> WrittenMonitor:
    """Return one self-contained C file, which monitors each value of a key as a log of its own.

    Raises `NotExpressible` and `TooLarge`.
    """
    if key and semantics is not Semantics.SCATTERED:
        raise NotExpressible(unwritten("a key of the events needs `scattered`"))
    found = stages_of(prop, semantics, limit)
    if not found.starts:  # no scenario is feasible: one that waits for nothing
        found = StageTable((*found.stages, TableStage((), 0, (), (), (), 1)), (len(found.stages),))
    return _Writer(prop, semantics, found, key, counted).written()


class _Writer:
    def __init__(
        self,
        prop: Property,
        semantics: Semantics,
        found: StageTable,
        key: Sequence[KeyField],
        counted: EventTests | None,
    ) -> None:
        self._prop = prop
        self._semantics = semantics
        self._found = found
        self._scattered = semantics is Semantics.SCATTERED
        self._fields = EventFields()
        self._key = [(self._fields.number(first), self._fields.number(second)) for first, second in key]
        self._fields.whole.update(*self._key)
        self._counted = counted
        self._guards: dict[str, int] = {}
        self._patterns: dict[Pattern, int] = {}
        self._tests: list[str] = []
        self._bound: list[dict[str, int]] = []
        self._loads, self._joins, self._slots, self._order, self._expiries = (ConstantTable() for _ in range(5))

    def _pattern(self, pattern: Pattern) -> int:
        if pattern not in self._patterns:
            self._patterns[pattern] = len(self._tests)
            test, bound = self._fields.tests(pattern)
            self._tests.append(test)
            self._bound.append(bound)
        return self._patterns[pattern]

    def _guard(self, tests: Iterable[Test], bound: Mapping[str, int]) -> int:
        """Return the number of the conjunction of some tests, 0 for none."""
        parts = []
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
        joined = (tuple(sorted(slot for slot, _ in move.joins)) for move in stage.moves)
        return list(dict.fromkeys((exact, *joined))) if self._scattered else [exact]

    def _move(self, number: int, move: Transition, links: Sequence[tuple[int, ...]]) -> str:
        pattern = self._pattern(move.pattern)
        bound = self._bound[pattern]
        guard = self._guard(move.tests, bound)
        loads = self._loads.place([_load(slot, load, bound) for slot, load in move.loads])
        joins = self._joins.place([f"{{{slot}, {bound[name]}}}" for slot, name in move.joins])
        link = links.index(tuple(sorted(slot for slot, _ in move.joins))) if self._scattered else 0
        return f"{{{number}, {move.target}, {pattern}, {guard}, {loads}, {joins}, {len(move.joins)}, {link}}}"

    def _relevance(self) -> str:
        def fits(pattern: Pattern, when: Guard | None) -> str:
            test, bound = self._fields.tests(pattern)

            def term(guard: Guard) -> str | None:
                return f"E({bound[guard.name]})" if isinstance(guard, Variable) else None

            return test if when is None else f"{test} && holds({expression(when, term)})"

        ignored = dict.fromkeys(fits(one.pattern, one.when) for one in self._prop.ignored)
        relevant = dict.fromkeys(fits(one.pattern, one.when) for one in self._prop.alphabet)
        any_of = " ||\n           ".join(f"({test})" for test in relevant)
        lines = [f"    if ({test}) {{\n        return 0;\n    }}\n" for test in ignored]
        return "".join(
            (
                "/* Whether an event is relevant. */\n/*@ assigns *error; */\n",
                "static int relevant(int *error, const rvaft_event *e) {\n    (void)error;\n    (void)e;\n",
                *lines,
                f"    return {any_of};\n}}\n\n",
            )
        )

    def _count_tests(self, counted: EventTests) -> str:
        """Return the function that tests an event for its group: 1 for a pattern, 2 for its guard."""
        lines = list[str]()
        for number, (pattern, when) in enumerate(counted.letters):
            test, bound = self._fields.tests(pattern)

            def term(guard: Guard, bound: Mapping[str, int] = bound) -> str | None:
                return f"E({bound[guard.name]})" if isinstance(guard, Variable) else None

            guarded = "" if when is None else f" + (holds({expression(when, term)}) ? 2 : 0)"
            lines.append(f"    fits[{number}] = ({test}) ? (uint8_t)(1{guarded}) : 0;\n")
        apart = [str(self._fields.number((name,))) for name in counted.apart]
        clock = "" if self._prop.time else f"#define RVAFT_CLOCK {self._fields.number((counted.clock,))}\n"
        return "".join(
            (
                f"#define RVAFT_TESTS {max(1, len(lines))}\n#define RVAFT_TEXTS_APART {len(apart)}U\n{clock}",
                _array("uint16_t", "texts_apart", apart or ["0"]),
                "/* Which patterns an event matches, and with which guards. */\n",
                "static void count_tests(int *error, const rvaft_event *e, uint8_t *fits) {\n",
                "    (void)error;\n    (void)e;\n",
                *(lines or ["    fits[0] = 0;\n"]),
                "}\n\n",
            )
        )

    def written(self) -> WrittenMonitor:
        """Return the text."""
        stages = self._found.stages
        rows, moves, owners, most_links = list[str](), list[str](), list[int](), 1
        for number, stage in enumerate(stages):
            links = self._links(stage)
            most_links = max(most_links, len(links))
            link = self._slots.place([str(one) for slots in links for one in (len(slots), *slots)])
            order = self._order.place([str(int(one)) for one in stage.smaller])
            expiries = self._expiries.place([f"{{{slot}, INT64_C({most})}}" for slot, most in stage.expiries])
            if not self._late:
                expiries = 0
            rows.append(
                f"{{{stage.rank}, {len(stage.slots)}, {stage.exact}, {len(moves)}, {len(stage.moves)}, {len(links)}, "
                f"{link}, {order}, {expiries}, {len(stage.expiries)}}}"
            )
            for move in stage.moves:
                moves.append(self._move(number, move, links))
                owners.append(number)
        relevance = self._relevance() if self._semantics.projects else ""
        relevance += "" if self._counted is None else self._count_tests(self._counted)
        time = self._time()
        runtime, *others = (files("backends.c").joinpath(name).read_text("utf-8") for name in _FILES)
        head, tail = runtime.split(_MARK)
        config = self._config(most_links)
        tables = self._tables(rows, moves, owners) + relevance + time
        code = "\n".join((f"{self._title(len(moves), most_links)}{config}{head}{tables}{tail}", *others))
        return WrittenMonitor(f"{comment(self._prop, code)}{code}", len(stages), len(moves))

    @property
    def _late(self) -> int | None:
        time = self._prop.time
        if time is not None and time.late is not None and time.late >= _LONG:
            raise NotExpressible(unwritten("a lateness of more than 62 bits"))
        return None if time is None else time.late

    def _title(self, moves: int, links: int) -> str:
        tree, stages = self._prop.tree, self._found.stages
        slots = max(len(stage.slots) for stage in stages)
        most = max((len(stage.moves) for stage in stages), default=0)
        paths = (".".join(map(str, path)) for path in self._fields.paths)
        fields = ", ".join(f"field[{number}] is {path}" for number, path in enumerate(paths)) or "none is read"
        listed = f"Fields of an event: {_in_comment(fields)}. */"
        shown = fill(listed, 100, initial_indent=_INDENT, subsequent_indent=_INDENT)
        return (
            f'/* A monitor of the tree "{_in_comment(tree.root)}" under {self._semantics}, by rvaft.\n'
            f"   {len(stages)} stages, {moves} moves, at most {slots} values in a partial match.\n"
            f"   Work per event: at most {most} moves for each of RVAFT_CAPACITY partial matches.\n"
            f"   Memory: sizeof(rvaft_monitor) is {self._size(links)} bytes with the sizes below. Nothing is\n"
            "   allocated; only values of lists and objects are read by recursion, at most 500 levels.\n"
            f"{shown}\n\n"
        )

    def _sizes(self) -> tuple[int, bool]:
        """Return the default capacity, and whether partial matches hold values that may be texts."""
        slots = [slot for stage in self._found.stages for slot in stage.slots]
        return CAPACITY if slots else len(self._found.stages), any(not slot.timed for slot in slots)

    def _size(self, links: int) -> int:
        """Return the size of a monitor in bytes, as C lays it out."""
        capacity, texts = self._sizes()
        buckets = 1 << max(_BUCKETS[0], (2 * capacity - 1).bit_length())
        number, content = (capacity, 32 * capacity) if texts else (1, 8)
        fields = max(1, len(self._fields.paths))
        width = max(1, *(len(stage.slots) for stage in self._found.stages))
        own = 8 if self._key else 0
        store = _whole(12 + 8 * links * buckets) + (capacity + 1) * (_whole(4 * links + 4 + own) + 16 * width)
        keys = 16 + (4 + 40 + 64) * _KEYS if self._key else 0
        pool = 16 + 4 * buckets + 17 * number + content
        stores = store if self._scattered else 2 * store
        return 40 + keys + stores + _whole(_padded(pool)) + _whole(17 * fields)

    def _config(self, links: int) -> str:
        stages = self._found.stages
        width = max(1, *(len(stage.slots) for stage in stages))
        capacity, values = self._sizes()
        late = self._late
        defaults = {
            "CAPACITY": capacity,
            "TEXTS": "RVAFT_CAPACITY" if values else 1,
            "TEXT_BYTES": "(32U * RVAFT_TEXTS)" if values else 8,
            "SCRATCH": "65536U",
            "JSON": 1,
            "MAIN": 0,
            "PLACES": 0,
            **({"KEYS": _KEYS, "KEY_BYTES": "(64U * RVAFT_KEYS)"} if self._key else {}),
            "API": "",
        }
        expiring = self._scattered and late is not None and bool(self._expiries.rows)
        fixed = {
            "SCATTERED": int(self._scattered),
            "PROJECTS": int(self._semantics.projects),
            "CONSECUTIVE": int(self._semantics is Semantics.CONSECUTIVE),
            "STORES": 1 if self._scattered else 2,
            "WIDTH": width,
            "DEPTH": max(stage.rank for stage in stages),
            "LINKS": links,
            "FIELDS": max(1, len(self._fields.paths)),
            "PATTERNS": max(1, len(self._tests)),
            "STARTS": len(self._found.starts),
            "STAGES": len(stages),
            "MOVES": max(1, sum(len(stage.moves) for stage in stages)),
            "LATE": "(-1)" if late is None else f"INT64_C({late})",
            "TIMED": int(self._prop.time is not None),
            "EXPIRIES": int(expiring),
            "KEYED": int(bool(self._key)),
            "COUNTED": int(self._counted is not None),
            **({"KEY_FIELDS": len(self._key)} if self._key else {}),
        }
        lines = [f"#ifndef RVAFT_{name}\n#define RVAFT_{name} {value}\n#endif\n" for name, value in defaults.items()]
        lines += [f"#define RVAFT_{name} {value}\n" for name, value in fixed.items()]
        for bits in _BUCKETS:
            word = "if" if bits == _BUCKETS[0] else "elif"
            lines.append(f"#{word} RVAFT_CAPACITY <= {1 << bits - 1}\n#define RVAFT_BUCKETS {1 << bits}U\n")
        lines.append(f"#else\n#define RVAFT_BUCKETS {1 << _BUCKETS[-1] + 1}U\n#endif\n\n")
        return "".join(lines)

    def _tables(self, rows: Sequence[str], moves: Sequence[str], owners: Sequence[int]) -> str:
        found = self._found
        made = [
            _array("stage", "stages", rows),
            _array("move", "moves", moves or ["{0, 0, 0, 0, 0, 0, 0, 0}"]),
            _array("load", "loads", self._loads.rows or ["{COPY, 0, 0}"]),
            _array("join", "joins", self._joins.rows or ["{0, 0}"]),
            _array("uint16_t", "link_slots", self._slots.rows),
            _array("uint8_t", "slot_order", self._order.rows or ["0"]),
            _array("uint32_t", "starts", [str(one) for one in found.starts]),
            *([_key_fields(self._key)] if self._key else []),
        ]
        if self._scattered:
            order = sorted(range(len(moves)), key=lambda number: found.stages[owners[number]].rank)
            all_moves = [move for stage in found.stages for move in stage.moves]
            by_pattern: list[list[int]] = [[] for _ in self._tests] or [[]]
            for number in order:
                by_pattern[self._patterns[all_moves[number].pattern]].append(number)
            begins = [sum(map(len, by_pattern[:place])) for place in range(len(by_pattern) + 1)]
            made.append(_array("uint32_t", "pattern_moves", [str(one) for one in begins]))
            flat = [str(one) for some in by_pattern for one in some]
            made.append(_array("uint32_t", "sorted_moves", flat or ["0"]))
            if self._late is not None and self._expiries.rows:
                made.append(_array("expiry", "expiries", self._expiries.rows))
        tests = "".join(f"    matches[{number}] = ({test}) ? 1 : 0;\n" for number, test in enumerate(self._tests))
        guards = "".join(
            f"        case {number}:\n            return {test};\n" for test, number in self._guards.items()
        )
        return "".join(
            (
                *made,
                "/* Which patterns an event matches. */\n/*@ assigns matches[0 .. RVAFT_PATTERNS - 1]; */\n",
                "static void match(uint8_t *matches, const rvaft_event *e) {\n    (void)e;\n",
                tests or "    matches[0] = 0;\n",
                "}\n\n/* Whether a guard holds for a partial match and an event. */\n",
                "static int guard(rvaft_monitor *m, uint32_t number, const cell *old, const rvaft_event *e) {\n",
                "    int *error = &m->error;\n    (void)error;\n    (void)old;\n    (void)e;\n",
                f"    switch (number) {{\n{guards}        default:\n            return 1;\n    }}\n}}\n\n",
            )
        )

    def _time(self) -> str:
        time = self._prop.time
        made = ["#if RVAFT_JSON\n"]
        if time is not None:
            made.append(f"#define READ_TIME(e, time) {self._reading(time)}\n")
        rows = self._fields.rows() or ['{"", 0, -1, -1, 0, 0, 0}']
        first = 0 if self._fields.paths else -1
        made.append(f"#define FIRST_FIELD {first}\n#define FIRST_KEYS {self._fields.keys(())}\n")
        made += [_array("field_node", "fields", rows), "#endif\n"]
        return "".join(made)

    def _reading(self, time: EventTime) -> str:
        only = time.field not in self._fields.paths and time.format is not TimeFormat.ROS
        field = self._fields.number(time.field)
        self._fields.times.update({field} if only else ())
        match time.format:
            case TextFormat():
                raise NotExpressible(
                    unwritten(f"the time format {time.format}: only numbers, iso8601, ros and filetime are read")
                )
            case TimeFormat.ISO8601:
                return f"iso_time(&(e)->field[{field}], time)"
            case TimeFormat.FILETIME:
                return f"filetime(&(e)->field[{field}], time)"
            case TimeFormat.ROS:
                names: tuple[Step, ...] = ("sec", "nanosec", "secs", "nsecs")
                parts = ", ".join(f"&(e)->field[{self._fields.number((*time.field, name))}]" for name in names)
                return f"ros_time({parts}, time)"
            case _:
                return f"decimal_time(&(e)->field[{field}], {_SCALES[time.format]}, time)"


def _in_comment(text: str) -> str:
    """Return a text that neither ends a comment nor begins another one."""
    return "".join(c if c.isprintable() else "?" for c in text).replace("*/", "* /").replace("/*", "/ *")


def _whole(size: int) -> int:
    return (size + 7) // 8 * 8


def _padded(size: int) -> int:
    return (size + 3) // 4 * 4


def _key_fields(key: Sequence[tuple[int, int]]) -> str:
    rows = ", ".join(f"{{{first}, {second}}}" for first, second in key)
    return f"static const uint16_t key_fields[][2] = {{{rows}}};\n\n"


def _array(kind: str, name: str, rows: Sequence[str]) -> str:
    lines, line = [], "   "
    for row in rows:
        if len(line) + len(row) > 110:
            lines.append(line)
            line = "   "
        line += f" {row},"
    body = "\n".join([*lines, line])
    return f"static const {kind} {name}[] = {{\n{body}\n}};\n\n"


def _term(slot: Slot, load: Load, bound: Mapping[str, int]) -> str:
    if load.variable:
        return f"E({bound[load.variable]})"
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
