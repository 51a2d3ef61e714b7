"""What a log has: kinds of events, their fields, and candidates for the time; a first tree for it.

The *discriminator* is the field whose value is the kind of an event. A field is a candidate if at
least 90 % of the first `SAMPLE` events have a text or an integer in it, with at most `KINDS` values
and, for 40 events or more, two events per value on average. Chosen is the first candidate of
`KNOWN`, else the one that best determines which fields an event has (at least half of the entropy
of the sets of fields, and two events per value; of equal ones, that with the fewest values).

Memory is bounded by `KINDS`, `FIELDS` and `DEPTH`; what exceeds them is counted, not analysed.
"""

import json
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import log2
from typing import Final, TypeAlias

from rvaft.errors import OptionError
from rvaft.model.assumptions import has_type, is_inexact
from rvaft.model.event_time import NUMERIC, UNITS, EventTime, TextFormat, TimeFormat, duration_text
from rvaft.model.expressions import WORD, assumptions_text, literal_text, name_text, pattern_text, time_text, word_text
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import EXACT_INTEGERS, Json, JsonObject, at, is_number
from rvaft.support.terminal import columns, cut

SAMPLE: Final = 1_000
KINDS: Final = 200
FIELDS: Final = 200
"""Maximum number of fields per kind."""
DEPTH: Final = 6
"""Maximum number of names in a path; a deeper object is one value."""
EXAMPLES: Final = 3
TIMES: Final = 20
"""Maximum number of candidates for the time field."""
KNOWN: Final = (
    *("event", "eventName", "event_name", "event.action", "event.name", "EventID", "Event.System.EventID"),
    *("topic", "event_type", "eventType", "action", "type", "msg_type", "activity", "concept:name", "verb"),
    *("operation", "kind", "program", "app", "method", "name"),
)
"""The usual names of discriminators, in the order of choice."""
_TIME_NAMES: Final = frozenset(
    {"date", "datetime", "eventtime", "stamp", "t", "time", "timegenerated", "timestamp", "ts", "when"}
)
_SOUNDS_LIKE_TIME: Final = re.compile(r"time|stamp|date|(^|_)ts($|_)|_at$", re.IGNORECASE)
_PLAUSIBLE: Final = (631_152_000 * UNITS["s"], 4_102_444_800 * UNITS["s"])
"""The years 1990 to 2099, to guess the unit of a number."""
_USUAL: Final = (
    *("%d/%b/%Y:%H:%M:%S %z", "%b %d %H:%M:%S", "%b %d %Y %H:%M:%S", "%a %b %d %H:%M:%S %Y", "%Y/%m/%d %H:%M:%S"),
    *("%m/%d/%Y %I:%M:%S %p", "%a, %d %b %Y %H:%M:%S %z", "%Y%m%d%H%M%S", "%Y-%m-%d %H:%M:%S %z"),
)
"""Usual formats of times that are texts, without those that ISO 8601 covers."""
_LONGEST: Final = 200
_TYPES: Final = (ValueType.BOOLEAN, ValueType.INTEGER, ValueType.NUMBER, ValueType.TEXT)
Path: TypeAlias = tuple[str, ...]


def path_text(path: Iterable[str]) -> str:
    """Return a path as the language writes it.

    >>> path_text(["header", "frame id"])
    'header."frame id"'
    """
    return ".".join(map(word_text, path))


def _kind(value: Json) -> str | int | None:
    """Return the kind that a value of the discriminator is; equal numbers are one kind."""
    if isinstance(value, str):
        return value if len(value) <= _LONGEST else None
    if not is_number(value) or not abs(value) < EXACT_INTEGERS or value != int(value):
        return None
    return int(value)


def _is_kind(value: Json) -> bool:
    return _kind(value) is not None


def _fold(text: str) -> str:
    return text.upper().casefold()


def _type_name(value: Json) -> str:
    if value is None:
        return "null"
    found = next((type_.value for type_ in _TYPES if has_type(value, type_)), None)
    return found or ("list" if isinstance(value, list) else "object" if isinstance(value, Mapping) else "not finite")


def _leaves(event: Json, path: Path = ()) -> Iterator[tuple[Path, Json]]:
    """Yield all values at paths of names, objects before their fields."""
    for name, value in event.items():
        inner = (*path, name)
        yield inner, value
        if isinstance(value, Mapping) and len(inner) < DEPTH:
            yield from _leaves(value, inner)


@dataclass(slots=True)
class FieldCounts:
    """The values at one path in the events of one kind."""

    types: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)
    large: bool = False
    """Whether an integer exceeds what a double holds exactly."""

    @property
    def count(self) -> int:
        """The number of events that have the field."""
        return self.types.total()

    @property
    def type(self) -> ValueType:
        """The declared type that all values but null have."""
        found = {*self.types} - {"null"}
        if found == {"integer", "number"}:
            return ValueType.NUMBER
        return ValueType(*found) if len(found) == 1 and found <= {one.value for one in _TYPES} else ValueType.ANY

    def add(self, value: Json) -> None:
        """Count a value."""
        name = _type_name(value)
        self.types[name] += 1
        self.large = self.large or is_inexact(value)
        if len(self.examples) < EXAMPLES and self.types[name] <= SAMPLE and name not in ("object", "null"):
            text = cut(json.dumps(value, ensure_ascii=False))
            if text not in self.examples:
                self.examples.append(text)


@dataclass(slots=True)
class KindCounts:
    """The events of one kind; `omitted` counts values at paths beyond the limit."""

    value: Json = None
    events: int = 0
    fields: dict[Path, FieldCounts] = field(default_factory=dict)
    omitted: int = 0

    def add(self, event: JsonObject) -> None:
        """Count an event."""
        self.events += 1
        for path, value in _leaves(event):
            counts = self.fields.get(path)
            if counts is None:
                if len(self.fields) >= FIELDS:
                    self.omitted += 1
                    continue
                counts = self.fields[path] = FieldCounts()
            counts.add(value)

    def constant(self, path: Path) -> bool:
        """Whether every event has a value other than null at a path."""
        counts = self.fields.get(path)
        return counts is not None and counts.count == self.events and not counts.types["null"]


@dataclass(slots=True)
class TimeCandidate:
    """A field and a format that reads all its values; `late` is the largest lateness."""

    field: Path
    format: TimeFormat | TextFormat
    count: int = 0
    late: int = 0
    decreases: int = 0
    least: int = 0
    most: int = 0
    _latest: int | None = None

    @property
    def time(self) -> EventTime:
        """The declaration of the candidate."""
        return EventTime(self.field, self.format)

    @property
    def plausible(self) -> bool:
        """Whether all times lie in the years 1990 to 2099."""
        return _PLAUSIBLE[0] <= self.least and self.most < _PLAUSIBLE[1]

    def add(self, value: Json) -> bool:
        """Count a value; return whether the format reads it."""
        time = _read(self.format, value)
        if time is None:
            return False
        self.least = time if not self.count else min(self.least, time)
        self.most = time if not self.count else max(self.most, time)
        self.count += 1
        if self._latest is not None and time < self._latest:
            self.decreases += 1
            self.late = max(self.late, self._latest - time)
        self._latest = time if self._latest is None else max(self._latest, time)
        return True


def _read(form: TimeFormat | TextFormat, value: Json) -> int | None:
    return EventTime(("time",), form).read({"time": value})


def _plain(candidate: TimeCandidate) -> str:
    return re.sub(r"[^a-z]", "", candidate.field[-1].lower())


def _rank(candidate: TimeCandidate) -> tuple[object, ...]:
    """The order of candidates: most values, plausible, named as a time, in order, near the top."""
    named = 0 if _plain(candidate) in _TIME_NAMES else 1 if _SOUNDS_LIKE_TIME.search(candidate.field[-1]) else 2
    late = (candidate.late, len(candidate.field), candidate.field)
    form = candidate.format
    number = len(TimeFormat) if isinstance(form, TextFormat) else list(TimeFormat).index(form)
    return -candidate.count, not candidate.plausible, named, *late, number, str(form)


class LogFields:
    """Counts of the events of one log, in one pass.

    >>> fields = LogFields()
    >>> for event in ({"event": "a", "n": 1}, {"event": "b"}, {"event": "a", "n": 2.5}):
    ...     fields.add(event)
    >>> fields.finish()
    >>> fields.by, [(kind.value, kind.events) for kind in fields.kinds]
    (('event',), [('a', 2), ('b', 1)])
    """

    def __init__(self, by: str | None = None, time: EventTime | None = None, year: int | None = None) -> None:
        self._stated = time
        usual = [TextFormat(one, None if "%Y" in one else year) for one in _USUAL]
        stated = [] if time is None or time.format in (*TimeFormat, *usual) else [time.format]
        self._formats = [*TimeFormat, *stated, *(one for one in usual if not one.needs_year)]
        self.by: Path | None = None
        self._wanted = by
        self.events = 0
        self.without = 0
        """Events without a text or an integer in the discriminator."""
        self.others = 0
        """Events of kinds beyond the limit."""
        self.other_case = False
        """Whether a value differs only in case from a kind."""
        self.candidates: tuple[tuple[Path, int], ...] = ()
        """The possible discriminators with their numbers of values in the first events."""
        self._kinds: dict[Hashable, KindCounts] = {}
        self._folded: dict[str, str] = {}
        self._times: list[TimeCandidate] = []
        self._sample: list[JsonObject] | None = []

    @property
    def kinds(self) -> Sequence[KindCounts]:
        """The kinds, the most frequent first."""
        return sorted(self._kinds.values(), key=lambda kind: -kind.events)

    @property
    def times(self) -> Sequence[TimeCandidate]:
        """The candidates for the time, the best first."""
        read = (one for one in self._times if one.count)
        best = sorted(
            (one for one in read if one.plausible or _is_time_name(one)),
            key=lambda one: (one.time != self._stated, _rank(one)),
        )
        plausible = {one.field for one in best if one.plausible}
        return [one for one in best if one.plausible or one.field not in plausible]

    def add(self, event: JsonObject) -> None:
        """Count an event."""
        if self._sample is None:
            self._add(event)
            return
        self._sample.append(event)
        if len(self._sample) >= SAMPLE:
            self.finish()

    def finish(self) -> None:
        """Count the first events, at the end of the log."""
        if self._sample is None:
            return
        sample, self._sample = self._sample, None
        self._choose(sample)
        for event in sample:
            self._add(event)

    def _add(self, event: JsonObject) -> None:
        self.events += 1
        found = None if self.by is None else at(event, self.by)
        value = _kind(found)
        if isinstance(found, str):
            known = self._folded.get(_fold(found), found)
            self.other_case = self.other_case or known != found
        if self.by is not None and value is None:
            self.without += 1
        elif value in self._kinds or len(self._kinds) < KINDS:
            if value not in self._kinds:
                self._kinds[value] = KindCounts(value)
                if isinstance(value, str):
                    self._folded.setdefault(_fold(value), value)
            self._kinds[value].add(event)
        else:
            self.others += 1
        self._times = [one for one in self._times if (time := at(event, one.field)) is None or one.add(time)]

    def _choose(self, sample: Sequence[JsonObject]) -> None:
        """Choose the discriminator and the candidates for the time."""
        values: dict[Path, list[Json]] = {}
        shapes: list[tuple[Path, ...]] = []
        for event in sample:
            found = dict(_leaves(event))
            shapes.append(tuple(sorted(found)))
            for path, value in found.items():
                if path in values or len(values) < FIELDS:
                    values.setdefault(path, []).append(value)
        for path, form in product(filter(all, values), self._formats):
            candidate = TimeCandidate(path, form)
            some = [value for value in values[path] if value is not None]
            if some and all(map(candidate.add, some)):
                self._times.append(candidate)
        best = self.times[:TIMES]
        timed = {one.field for one in best}
        self._times = [TimeCandidate(one.field, one.format) for one in best]
        fits = {
            path: kinds
            for path, some in values.items()
            if path not in timed and _may_discriminate(kinds := [*filter(_is_kind, some)], len(sample))
        }
        self.candidates = tuple((path, count) for path, some in fits.items() if (count := len(set(some))) > 1)
        if self._wanted is not None:
            same = (path for path in values if ".".join(path) == self._wanted)
            self.by = next(same, tuple(self._wanted.split(".")))
        else:
            known = {".".join(path): path for path in fits}
            self.by = next((known[name] for name in KNOWN if name in known), None) or _best(fits, sample, shapes)


def _is_time_name(candidate: TimeCandidate) -> bool:
    return _plain(candidate) in _TIME_NAMES or candidate.format not in NUMERIC


def _may_discriminate(values: Sequence[Json], events: int) -> bool:
    if not values or 10 * len(values) < 9 * events:
        return False
    different = len(set(values))
    return different <= KINDS and (events < 40 or 2 * different <= events)


def _entropy(items: Iterable[Hashable]) -> float:
    counts = Counter(items)
    total = counts.total()
    return sum(-count / total * log2(count / total) for count in counts.values())


def _best(fits: Iterable[Path], sample: Sequence[JsonObject], shapes: Sequence[tuple[Path, ...]]) -> Path | None:
    """Return the field that determines the sets of fields best, or None if none gives half of it."""
    whole = _entropy(shapes)
    ranked = []
    for path in fits:
        kinds = [_kind(at(event, path)) for event in sample]
        gain = whole + _entropy(kinds) - _entropy(zip(kinds, shapes, strict=True))
        if whole and gain >= whole / 2 and 2 * len(set(kinds)) <= len(sample):
            ranked.append((-round(gain, 9), len(set(kinds)), path))
    return min(ranked)[2] if ranked else None


# The table of fields.


def _limits(found: LogFields) -> Iterator[str]:
    if found.without and found.by is not None:
        yield f"{found.without} events have no text or integer in {path_text(found.by)} and are not analysed"
    if found.others:
        yield f"{found.others} events are of kinds beyond the first {KINDS} and are not analysed"
    for kind in found.kinds:
        if kind.omitted:
            yield f"{_title(found, kind)}: {kind.omitted} values at paths beyond the first {FIELDS} are not counted"


def _title(found: LogFields, kind: KindCounts) -> str:
    return "all events" if found.by is None else f"{path_text(found.by)} {literal_text(kind.value)}"


def fields_text(found: LogFields) -> list[str]:
    r"""Return the fields of a log as lines of text.

    >>> fields = LogFields()
    >>> fields.add({"event": "a", "n": None})
    >>> fields.finish()
    >>> print(*fields_text(fields), sep="\n")
    events: 1
    kinds: 1 by the field event
    time: no candidate
    <BLANKLINE>
    event "a": 1 event
      FIELD  TYPES   ABSENT  NULL  EXAMPLES
      event  1 text  0       0     "a"
      n      1 null  0       1
    """
    lines = [f"events: {found.events}"]
    if found.by is None:
        names = ", ".join(f"{path_text(path)} ({count} values)" for path, count in found.candidates[:5])
        lines.append(f"kinds: none found; choose a field with --by{f': {names}' if names else ''}")
    else:
        lines.append(f"kinds: {len(found.kinds)} by the field {path_text(found.by)}")
    for place, one in enumerate(found.times[:5]):
        text = f"{time_text(one.time)}: {one.count} values, {_order(one)}"
        lines.append(f"{'      ' if place else 'time: '}{text}")
    if not found.times:
        lines.append("time: no candidate")
    lines += [f"note: {limit}" for limit in _limits(found)]
    for kind in found.kinds:
        rows = [("FIELD", "TYPES", "ABSENT", "NULL", "EXAMPLES")]
        for path, counts in kind.fields.items():
            types = ", ".join(f"{count} {name}" for name, count in counts.types.most_common())
            cells = (str(kind.events - counts.count), str(counts.types["null"]), ", ".join(counts.examples))
            rows.append((path_text(path), types, *cells))
        lines += ["", f"{_title(found, kind)}: {kind.events} event{'s' * (kind.events != 1)}"]
        lines += [f"  {line}" for line in columns(rows)]
    return lines


def _order(candidate: TimeCandidate) -> str:
    if not candidate.late:
        return "in order"
    return f"{candidate.decreases} out of order, by up to {duration_text(rounded(candidate.late))}"


def fields_json(found: LogFields) -> dict[str, Json]:
    """Return the fields of a log as a JSON object.

    >>> fields = LogFields()
    >>> fields.finish()
    >>> fields_json(fields)["events"]
    0
    """
    return {
        "events": found.events,
        "by": None if found.by is None else list(found.by),
        "without": found.without if found.by is not None else 0,
        "others": found.others,
        "candidates": [{"field": list(path), "values": count} for path, count in found.candidates],
        "times": [
            {
                "field": list(one.field),
                "format": str(one.format),
                "count": one.count,
                "out_of_order": one.decreases,
                "lateness_ns": one.late,
            }
            for one in found.times
        ],
        "kinds": [
            {
                "value": kind.value,
                "events": kind.events,
                "omitted": kind.omitted,
                "fields": [
                    {
                        "field": list(path),
                        "types": dict(counts.types),
                        "absent": kind.events - counts.count,
                        "null": counts.types["null"],
                        "examples": counts.examples,
                    }
                    for path, counts in kind.fields.items()
                ],
            }
            for kind in found.kinds
        ],
    }


# The tree to start from.


def rounded(late: int) -> int:
    """Return a lateness rounded up to the longest unit that it reaches.

    >>> duration_text(rounded(61_000_000_000)), rounded(0)
    ('2 min', 0)
    """
    size = next((size for size in UNITS.values() if size <= late), 1)
    return -(-late // size) * size


def inferred_tree(found: LogFields) -> str:
    """Return the text of a tree to start from, which the log fits; raises `OptionError`.

    Parameters are the fields that every event of the kind has, with a value other than null.

    >>> fields = LogFields()
    >>> fields.add({"event": "login", "user": "eve"})
    >>> fields.finish()
    >>> print(inferred_tree(fields), end="")
    # Inferred from 1 event by the field event. Edit:
    # - the gates and the leaves: keep the events of your attack or fault, in their order;
    # - the arguments: a value, or a variable that several nodes share;
    # - the assumptions: they hold on this log; keep those that hold on every log.
    assume types, present, case, exact;
    <BLANKLINE>
    event login(user: text) = { event: "login", user: user };
    <BLANKLINE>
    toplevel any_event;
    any_event or login_seen;
    login_seen on login(_); # 1 event
    """
    if not found.kinds:
        raise OptionError("the log has no events to infer a tree from")
    time = next(iter(found.times), None)
    names = _names([_event_name(kind.value) for kind in found.kinds], ())
    leaves = _names([f"{name}_seen" for name in names], ("any_event",))
    statements, nodes = list[str](), list[str]()
    assumed = {Assumption.TYPES, Assumption.PRESENT, Assumption.CASE, Assumption.EXACT}
    if found.other_case:
        assumed.discard(Assumption.CASE)
    stated_paths = {path for path in (found.by, time.field if time else None) if path is not None}
    for kind, name, leaf in zip(found.kinds, names, leaves, strict=True):
        parts, optional = _parts(kind, stated_paths)
        if any(kind.fields[path].large for path in parts):
            assumed.discard(Assumption.EXACT)
        parameters = _names([_word(path[-1]) for path in parts], ("true", "false", "null", "_"))
        typed = [
            parameter if (type_ := kind.fields[path].type) is ValueType.ANY else f"{parameter}: {type_}"
            for parameter, path in zip(parameters, parts, strict=True)
        ]
        values: dict[Path, Pattern] = {} if found.by is None else {found.by: Literal(kind.value)}
        values |= {path: Variable(parameter) for path, parameter in zip(parts, parameters, strict=True)}
        statements.append(f"event {word_text(name)}({', '.join(typed)}) = {pattern_text(_object(values))};")
        statements += [f"#   {line}" for line in optional]
        call = f"{word_text(name)}({', '.join('_' for _ in parts)})"
        nodes.append(f"{name_text(leaf)} on {call}; # {kind.events} event{'s' * (kind.events != 1)}")
    by = "" if found.by is None else f" by the field {path_text(found.by)}"
    head = [
        f"# Inferred from {found.events} event{'s' * (found.events != 1)}{by}. Edit:",
        "# - the gates and the leaves: keep the events of your attack or fault, in their order;",
        "# - the arguments: a value, or a variable that several nodes share;",
        "# - the assumptions: they hold on this log; keep those that hold on every log.",
        *(f"# Not analysed: {limit}." for limit in _limits(found)),
    ]
    stated = None
    if time is not None:
        stated = EventTime(time.field, time.format, rounded(time.late))
        assumed.add(Assumption.ORDER)
        others = [time_text(one.time) for one in found.times[1:5]]
        head += [f"# Also possible: {'; '.join(others)}."] if others else []
        head.append(f"{time_text(stated)};")
    head.append(f"assume {assumptions_text(assumed, stated)};")
    root = ["toplevel any_event;", f"any_event or {' '.join(map(name_text, leaves))};"]
    return "\n".join([*head, "", *statements, "", *root, *nodes]) + "\n"


def _parts(kind: KindCounts, known: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """Return the paths of the parameters, and comments on the fields that are no parameters.

    `known` are the fields that the tree states elsewhere.
    """
    stated = set(known)
    constant = {path for path in kind.fields if kind.constant(path)}
    whole = {path for path in constant if {*kind.fields[path].types} == {"object"}}
    opened = {path[:size] for path in constant | stated for size in range(1, len(path))}
    parts = [path for path in kind.fields if path in constant - stated and not (path in whole and path in opened)]
    optional = []
    for path, counts in kind.fields.items():
        if path in constant | stated or not {path[:size] for size in range(1, len(path))} <= constant:
            continue
        absent, nulls = kind.events - counts.count, counts.types["null"]
        often = " and ".join(
            text for text in (f"absent in {absent}" if absent else "", f"null in {nulls}" if nulls else "") if text
        )
        optional.append(f"no parameter: {path_text(path)} ({counts.type}) is {often} of {kind.events} events")
    return parts, optional


def _object(values: Mapping[Path, Pattern]) -> ObjectPattern:
    """Return the pattern with these values at their paths."""
    inner: dict[str, dict[Path, Pattern]] = {}
    for (name, *rest), value in values.items():
        inner.setdefault(name, {})[tuple(rest)] = value
    return ObjectPattern(tuple((name, some[()] if () in some else _object(some)) for name, some in inner.items()))


def _word(text: str) -> str:
    """Return a word of the language for a text, which begins with a small letter."""
    word = re.sub(r"[^A-Za-z0-9_]+", "_", text).lstrip("_")
    return f"{word[0].lower()}{word[1:]}" if word[:1].isalpha() else f"f_{word}"


def _event_name(value: Json) -> str:
    return "event" if value is None else str(value) if WORD.fullmatch(str(value)) else _word(str(value).strip("/"))


def _names(wanted: Iterable[str], taken: Iterable[str]) -> list[str]:
    """Return different names; a number makes a repeated one different."""
    used, made = set(taken), list[str]()
    for name in wanted:
        number, new = 2, name
        while new in used:
            number, new = number + 1, f"{name}_{number}"
        used.add(new)
        made.append(new)
    return made
