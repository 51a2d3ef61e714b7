"""What all texts in C have: the reader of events, guards, relevance, times, keys, and the runtime around the tables."""

import re
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from textwrap import fill
from typing import ClassVar, Final

from backends.c.events import NumberedFields, Step, expression
from backends.c.observed_tests import comment
from rvaft.core.property import Property
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.event_time import EventTime, TextFormat, TimeFormat
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern, Variable
from rvaft.model.verdict import Semantics

_KEYS: Final = 1024
"""The default number of values of a key."""
_KEY_BYTES: Final = 68
"""The default number of bytes for each value of a key."""
_FILES: Final = ("runtime.c", "json.c", "program.c")
_SECTION: Final = re.compile(r"^/\* @(\w+) \*/\n", re.MULTILINE)
_INDENT: Final = "   "
_BUCKETS: Final = range(6, 23)
_SCALES: Final[Mapping[TimeFormat, int]] = {
    TimeFormat.SECONDS: 9,
    TimeFormat.MILLISECONDS: 6,
    TimeFormat.MICROSECONDS: 3,
    TimeFormat.NANOSECONDS: 0,
}
_LONG: Final = 1 << 62


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
    """A text of C with its numbers of stages (or nodes) and moves (or leaves)."""

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


@dataclass(frozen=True)
class Use:
    """How a text monitors a log: each value of a key as a log of its own, and with the tests of a log's counts.

    A `repeat` starts afresh after a detection with what has the value of `by`, or all. If not `repeats`, it cannot.
    """

    key: Sequence[KeyField] = ()
    counted: EventTests | None = None
    by: str | None = None
    repeats: bool = True


def laid_out(*fields: tuple[int, int]) -> tuple[int, int]:
    """Return the size and the alignment of a C structure with fields of these sizes and alignments.

    >>> laid_out(WORD, LONG, times(BYTE, 3))
    (24, 8)
    """
    size, most = 0, 1
    for width, alignment in fields:
        size = -(-size // alignment) * alignment + width
        most = max(most, alignment)
    return -(-size // most) * most, most


def times(field: tuple[int, int], count: int) -> tuple[int, int]:
    """Return the size and the alignment of an array."""
    return field[0] * count, field[1]


BYTE: Final = (1, 1)
WORD: Final = (4, 4)
LONG: Final = (8, 8)
CELL: Final = (16, 8)
"""The size and the alignment of `cell`."""


class Writer(ABC):
    """Writes the tables of a property between the parts of the runtime."""

    runtime: ClassVar[tuple[str, ...]]
    """The files with the sections of the runtime that depend on the tables."""

    def __init__(self, prop: Property, semantics: Semantics, use: Use) -> None:
        self._prop = prop
        self._semantics = semantics
        self._use = use
        self._fields = NumberedFields()
        self._key = [(self._fields.number(first), self._fields.number(second)) for first, second in use.key]
        self._fields.whole.update(*self._key)
        self._guards: dict[str, int] = {}
        self._patterns: dict[Pattern, int] = {}
        self._tests: list[str] = []
        self._bound: list[dict[str, int]] = []

    @abstractmethod
    def _tables(self) -> str:
        """Return the tables and the functions over them; it numbers the fields that they read."""

    @abstractmethod
    def _summary(self) -> str:
        """Return lines of the title: sizes, and the work for an event."""

    @abstractmethod
    def _observing(self) -> Property:
        """Return the property that has the tests of events."""

    @property
    @abstractmethod
    def _capacity(self) -> int:
        """The default number of partial matches; 0 if it is fixed."""

    @property
    def _named(self) -> bool:
        """Whether values are kept."""
        return bool(self._capacity)

    @property
    @abstractmethod
    def _texts(self) -> int:
        """The number of texts for each partial match, or 0 if values that may be texts are not kept."""

    @abstractmethod
    def _members(self) -> Iterable[tuple[int, int]]:
        """Yield the layouts of the fields of `rvaft_monitor` in the section `members`."""

    @abstractmethod
    def _sizes(self) -> Mapping[str, object]:
        """Return the macros of the tables."""

    @property
    @abstractmethod
    def _counts(self) -> tuple[int, int]:
        """The numbers of stages and moves, or of nodes and leaves."""

    @property
    def _buckets(self) -> int:
        """The default number of buckets of a hash table."""
        return 1 << max(_BUCKETS[0], (2 * self._capacity - 1).bit_length())

    def written(self) -> WrittenMonitor:
        """Return the text."""
        tables = self._tables()
        relevance = self._relevance() if self._semantics.projects else ""
        counting = "" if self._use.counted is None else self._count_tests(self._use.counted)
        time = self._time()
        runtime, *others = (_file(name) for name in _FILES)
        sections = [_sections(_file(name)) for name in self.runtime]
        sections.append({"tables": f"{tables}{relevance}{counting}{time}"})
        runtime = _SECTION.sub(lambda found: "".join(some.get(found[1], "") for some in sections), runtime)
        code = "\n".join((f"{self._title()}{self._config()}{runtime}", *others))
        return WrittenMonitor(f"{comment(self._observing(), code)}{code}", *self._counts)

    def _title(self) -> str:
        paths = (".".join(map(str, path)) for path in self._fields.paths)
        fields = ", ".join(f"field[{number}] is {path}" for number, path in enumerate(paths)) or "none is read"
        listed = f"Fields of an event: {_in_comment(fields)}. */"
        shown = fill(listed, 100, initial_indent=_INDENT, subsequent_indent=_INDENT)
        return (
            f'/* A monitor of the tree "{_in_comment(self._prop.tree.root)}" under {self._semantics}, by rvaft.\n'
            f"{self._summary()}"
            f"   Memory: sizeof(rvaft_monitor) is {self._size()} bytes with the sizes below. Nothing is\n"
            "   allocated; only values of lists and objects are read by recursion, at most 500 levels.\n"
            f"{shown}\n\n"
        )

    def _size(self) -> int:
        """Return the size of a monitor in bytes, as C lays it out."""
        fields = max(1, len(self._fields.paths))
        made = [LONG, LONG, times(WORD, 4)]
        if self._key:
            state = laid_out(LONG, times(WORD, 8))
            table = times(WORD, _KEYS), times(state, _KEYS), times(LONG, _KEYS), times(BYTE, (1 + _KEY_BYTES) * _KEYS)
            made += [WORD, laid_out(times(LONG, 5), times(WORD, 6), *table)]
        made += self._members()
        if self._named:
            number = self._texts * self._capacity or 1
            content = 32 * number if self._texts else 8
            words = times(WORD, 4 + self._buckets + 4 * number)
            made += [laid_out(words, times(BYTE, number + content)), times(CELL, fields)]
        return laid_out(*made, times(BYTE, fields))[0]

    def _config(self) -> str:
        late = self.late
        defaults: dict[str, object] = {"SCRATCH": "65536U", "JSON": 1, "MAIN": 0, "PLACES": 0}
        capacity = {"CAPACITY": self._capacity} if self._capacity else {}
        if self._named:
            number = f"({self._texts}U * RVAFT_CAPACITY)" if self._texts > 1 else "RVAFT_CAPACITY"
            texts = (
                {"TEXTS": number, "TEXT_BYTES": "(32U * RVAFT_TEXTS)"} if self._texts else {"TEXTS": 1, "TEXT_BYTES": 8}
            )
            defaults = {**texts, **defaults}
        defaults = {**capacity, **defaults}
        if self._key:
            defaults |= {"KEYS": _KEYS, "KEY_BYTES": f"({_KEY_BYTES}U * RVAFT_KEYS)"}
        defaults["API"] = ""
        fixed = {
            **self._sizes(),
            "FIELDS": max(1, len(self._fields.paths)),
            "PATTERNS": max(1, len(self._tests)),
            "LATE": "(-1)" if late is None else f"INT64_C({late})",
            "TIMED": int(self._prop.time is not None),
            "NAMED": int(self._named),
            "KEYED": int(bool(self._key)),
            "COUNTED": int(self._use.counted is not None),
            "BY": int(self._use.by is not None),
            "REPEATS": int(self._use.repeats),
            **({"KEY_FIELDS": len(self._key)} if self._key else {}),
        }
        lines = [f"#ifndef RVAFT_{name}\n#define RVAFT_{name} {value}\n#endif\n" for name, value in defaults.items()]
        lines += [f"#define RVAFT_{name} {value}\n" for name, value in fixed.items()]
        for bits in _BUCKETS if self._named else ():
            word = "if" if bits == _BUCKETS[0] else "elif"
            lines.append(f"#{word} RVAFT_CAPACITY <= {1 << bits - 1}\n#define RVAFT_BUCKETS {1 << bits}U\n")
        lines += [f"#else\n#define RVAFT_BUCKETS {1 << _BUCKETS[-1] + 1}U\n#endif\n"] if self._named else []
        return "".join([*lines, "\n"])

    def _pattern(self, pattern: Pattern) -> int:
        if pattern not in self._patterns:
            self._patterns[pattern] = len(self._tests)
            test, bound = self._fields.tests(pattern)
            self._tests.append(test)
            self._bound.append(bound)
        return self._patterns[pattern]

    def _matching(self, signature: str, names: Sequence[str]) -> str:
        """Return the functions that test an event and a guard; `names` are the arguments of the latter."""
        tests = "".join(f"    matches[{number}] = ({test}) ? 1 : 0;\n" for number, test in enumerate(self._tests))
        guards = "".join(
            f"        case {number}:\n            return {test};\n" for test, number in self._guards.items()
        )
        return "".join(
            (
                "/* Which patterns an event matches. */\n/*@ assigns matches[0 .. RVAFT_PATTERNS - 1]; */\n",
                "static void match(uint8_t *matches, const rvaft_event *e) {\n    (void)e;\n",
                tests or "    matches[0] = 0;\n",
                f"}}\n\n/* Whether a guard holds. */\nstatic int guard({signature}) {{\n",
                *names,
                f"    switch (number) {{\n{guards}        default:\n            return 1;\n    }}\n}}\n\n",
            )
        )

    def _key_fields(self) -> str:
        """Return the table of the fields of the key of a log."""
        if not self._key:
            return ""
        rows = ", ".join(f"{{{first}, {second}}}" for first, second in self._key)
        return f"static const uint16_t key_fields[][2] = {{{rows}}};\n\n"

    @property
    def late(self) -> int | None:
        """How late events may be in nanoseconds; None if no event is late."""
        time = self._prop.time
        if time is not None and time.late is not None and time.late >= _LONG:
            raise NotExpressible(unwritten("a lateness of more than 62 bits"))
        return None if time is None else time.late

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
                array("uint16_t", "texts_apart", apart or ["0"]),
                "/* Which patterns an event matches, and with which guards. */\n",
                "static void count_tests(int *error, const rvaft_event *e, uint8_t *fits) {\n",
                "    (void)error;\n    (void)e;\n",
                *(lines or ["    fits[0] = 0;\n"]),
                "}\n\n",
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
        made += [array("field_node", "fields", rows), "#endif\n"]
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


def _file(name: str) -> str:
    return files("backends.c").joinpath(name).read_text("utf-8")


def _sections(text: str) -> dict[str, str]:
    """Return the sections of a file by name."""
    _, *found = _SECTION.split(text)
    return {name: body.rstrip("\n") + "\n\n" for name, body in zip(found[::2], found[1::2], strict=True)}


def _in_comment(text: str) -> str:
    """Return a text that neither ends a comment nor begins another one."""
    return "".join(c if c.isprintable() else "?" for c in text).replace("*/", "* /").replace("/*", "/ *")


def rows(kind: str, name: str, found: Iterable[str], about: Iterable[str]) -> str:
    """Return a constant array with a comment for each row."""
    lines = "".join(f"    {row}, /* {_in_comment(one)} */\n" for row, one in zip(found, about, strict=True))
    return f"static const {kind} {name}[] = {{\n{lines}}};\n\n"


def array(kind: str, name: str, rows: Sequence[str]) -> str:
    """Return a constant array."""
    lines, line = [], "   "
    for row in rows:
        if len(line) + len(row) > 110:
            lines.append(line)
            line = "   "
        line += f" {row},"
    body = "\n".join([*lines, line])
    return f"static const {kind} {name}[] = {{\n{body}\n}};\n\n"
