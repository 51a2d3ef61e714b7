"""Warnings about data that could hide a detection, with counts and a first example.

Guards are evaluated on events, not on partial matches: each event that binds a variable of a
comparison is checked with the last values of the other variables.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from enum import StrEnum
from itertools import chain, product
from typing import Final, NamedTuple

from rvaft.core.letters import Values, reader
from rvaft.core.pattern_index import flat
from rvaft.model.assumptions import AssumptionCheck
from rvaft.model.event_time import UNITS, Jump, duration_text
from rvaft.model.expressions import guard_text
from rvaft.model.guards import Guard, Operation, Operator, time_points, value, variables, walk
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, at
from rvaft.readers.json_lines import NonFiniteEvent, described
from rvaft.stream.statistics import UNSEEN, EventKind, EventTypeIndex
from rvaft.support.wording import counted

MOST: Final = 20
_ANY: Final = (1, "a", True)
"""Samples for an unknown value."""
_JUNCTIONS: Final = (Operator.AND, Operator.OR, Operator.NOT)
_BY_VALUE: Final = frozenset({Operator.DIV, Operator.MUL, Operator.NUMBER})
"""Operators that may be undefined for values of the right types."""


class Doubt(StrEnum):
    """Why an event could not be part of a match."""

    GUARD = "undefined guard"
    TIME = "unreadable time"
    LATE = "late event"
    JUMP = "time far ahead"
    NUMBER = "number that is not finite"
    ASSUMPTION = "broken assumption"


_MESSAGES: Final = {
    Doubt.GUARD: "undefined guard in {events}: {about}, where {example}",
    Doubt.TIME: "no readable time in {events}: {example}",
    Doubt.LATE: "{events} later than {about}, which no match uses: {example}",
    Doubt.JUMP: "{events} late after one time that is more than {about} ahead: {example}",
    Doubt.NUMBER: "undefined number in {events}: {example}",
    Doubt.ASSUMPTION: "assumption '{about}' broken in {events}: {example}",
}


@dataclass(slots=True)
class DataWarning:
    """The events with one fault; `about` is the guard, the allowed lateness or the assumption."""

    reason: Doubt
    about: str
    first: str
    example: str
    count: int = 0


class _Comparison(NamedTuple):
    """An atomic condition of a guard; undefined if neither it nor the `whole` guard can be decided."""

    condition: Guard
    whole: Guard | None
    names: tuple[str, ...]
    text: str


def _can_be_decided(guard: Guard, known: Mapping[str, Json]) -> bool:
    """Whether some values of unbound variables decide the guard, assumed for more than three."""
    others = [name for name in variables(guard) if name not in known]
    chosen = product((*_ANY, *(known[name] for name in variables(guard) if name in known)), repeat=len(others))
    bindings = ({**known, **dict(zip(others, some, strict=True))} for some in chosen)
    return len(others) > 3 or any(isinstance(value(guard, binding), bool) for binding in bindings)


@dataclass(slots=True)
class _LetterChecks:
    """The checks of events of one letter: its fields, and value types known as `good`.

    `fields` is None if the pattern does not locate the variables, or types do not decide.
    """

    values: Values
    parts: Sequence[_Comparison]
    fields: Sequence[str] | None
    good: set[tuple[type, ...]] = field(default_factory=set)
    version: int = -1


class DataWarnings:
    """Counts for the events of traces of one tree; can be pickled and merged.

    `warn` is called at once with the first event of a trace that is late because of a time far ahead.
    """

    def __init__(self, types: EventTypeIndex, warn: Callable[[str], object] | None = None) -> None:
        self.found: dict[tuple[Doubt, str], DataWarning] = {}
        self._last: dict[str, Json] = {}
        self.attach(types, warn)

    def attach(self, types: EventTypeIndex, warn: Callable[[str], object] | None = None) -> None:
        """Attach the tree, after unpickling."""
        self.warn = warn
        self._warned: str | None = None
        """The prefix of the last trace with such a warning."""
        self._types, self.time, self.version = types, types.tree.time, 0
        self._checks = dict(_checks(types))

    def __getstate__(self) -> dict[str, object]:
        """Return the counts without the tree."""
        return {"found": self.found, "_last": self._last}

    def see(self, event: Mapping[str, Json], number: int, prefix: str, event_kind: EventKind) -> None:
        """Check an event whose kind has checks, or a `NonFiniteEvent`."""
        good = event_kind.checks.good
        if (
            good is not None
            and self.time is None
            and type(event) is dict
            and good[0] is self
            and good[1] == self.version
        ):
            fields = good[2]
            if fields is not None and len(fields) == 1 and (type(event[fields[0]]),) in good[3]:
                return
        if event_kind.checks.looked_at == UNSEEN:
            event_kind.checks.looked_at = tuple(number for number in event_kind.fits if number in self._checks)
        if isinstance(event, NonFiniteEvent):
            place = f"{prefix}event {number}"
            if event_kind.checks.looked_at or self.time is None or event.field.split(".")[0] != self.time.field[0]:
                self.note(Doubt.NUMBER, "", place, f"{event.field} is {event.number}")
            return
        of, version, fields, known = good or (None, -1, None, ())
        if of is not self or version != self.version:
            fields, known = self._good(event_kind)
        kinds = None if fields is None else tuple([type(event[field]) for field in fields])
        if kinds is None or kinds not in known:
            self._look(event, f"{prefix}event {number}", event_kind, kinds)
        if self.time is None or not event_kind.entries or self.time.read(event) is not None:
            return
        if event_kind.relevant is not None:
            name, found = ".".join(self.time.field), at(event, self.time.field, UNSEEN)
            wrong = "" if found is UNSEEN else f"{name} is {described(found)}, not {self.time.format}"
            self.note(Doubt.TIME, "", f"{prefix}event {number}", wrong or f"the field {name} is missing")

    def _good(self, event_kind: EventKind) -> tuple[Sequence[str] | None, set[tuple[type, ...]]]:
        """Return the fields to check, None if types do not decide, and an empty set."""
        of_letters = [self._checks[letter].fields for letter in event_kind.checks.looked_at]
        known = [fields for fields in of_letters if fields is not None]
        fields = tuple(dict.fromkeys(chain(*known))) if len(known) == len(of_letters) else None
        good = set[tuple[type, ...]]()
        event_kind.checks.good = self, self.version, fields, good
        return fields, good

    def _look(
        self, event: Mapping[str, Json], place: str, event_kind: EventKind, kinds: tuple[type, ...] | None
    ) -> None:
        """Check an event; events with the same value types may skip the check."""
        version, good = self.version, True
        for letter in event_kind.checks.looked_at:
            one = self._checks[letter]
            types = None if one.fields is None else tuple([type(event[field]) for field in one.fields])
            if types is None or one.version != version or types not in one.good:
                self._check(one, event, types, place)
                good = good and types in one.good
        if good and kinds is not None and version == self.version and event_kind.checks.good is not None:
            event_kind.checks.good[3].add(kinds)

    def over(self, events: Iterable[tuple[int, Json]], prefix: str) -> Iterator[tuple[int, Json, EventKind | None]]:
        """Check and yield events with number and kind (None if late)."""
        latest, look_up, assumed = None, self._types.of, checked(self._types.tree)
        jumps: tuple[Jump, ...] = ()
        time = self.time if self.time is not None and self.time.late is not None else None
        for number, event in events:
            if assumed is not None:
                self.note_broken(assumed, event, f"{prefix}event {number}")
            late = False
            if time is not None:
                before = latest
                late, latest = time.is_late(event, before)
                if latest != before:
                    jumps = time.jumped(jumps, number, before, latest)
            if late:
                self.note_late(event, number, prefix, latest, jumps)
                yield number, event, None
                continue
            event_kind = look_up(event)
            if event_kind.checks.looked_at or type(event) is not dict:
                self.see(event, number, prefix, event_kind)
            yield number, event, event_kind

    def note(self, reason: Doubt, about: str, place: str, example: str) -> None:
        """Count one event."""
        self.found.setdefault((reason, about), DataWarning(reason, about, place, example)).count += 1

    def note_broken(self, assumed: AssumptionCheck, event: Json, place: str) -> None:
        """Count the assumptions that an event breaks, each once."""
        for assumption, message in {one.assumption: one.message for one in assumed.broken(event)[::-1]}.items():
            self.note(Doubt.ASSUMPTION, assumption, place, message)

    def note_late(self, event: Json, number: int, prefix: str, latest: int | None, jumps: Sequence[Jump] = ()) -> None:
        """Count a late event; `latest` is the greatest time before it, with its last jumps."""
        assert self.time is not None, "only where times are declared are events late"
        time, written = self.time.read(event) or 0, self.time.written(event)
        shown = f"{Decimal(time).scaleb(-9).normalize():f} s" if isinstance(written, Mapping) else json.dumps(written)
        behind = f"{duration_text((latest or 0) - time)} behind the latest"
        example = f"{'.'.join(self.time.field)} is {shown}, {behind}"
        allowed, place = self.time.late or 0, f"{prefix}event {number}"
        self.note(Doubt.LATE, duration_text(allowed), place, example)
        jump = next((one for one in jumps if one.makes_late(time, latest or 0, allowed)), None)
        if jump is None:
            return
        line = "" if jump.line is None else f" (line {jump.line})"
        ahead = f"{prefix}event {jump.number}{line} is {_about(jump.time - time)} ahead"
        if self.warn is not None and self._warned != prefix:
            self._warned = prefix
            self.warn(f"{ahead} of event {number}, which is late, as others like it may be: no match uses them")
        self.note(Doubt.JUMP, duration_text(allowed), place, ahead)

    def merge(self, other: "DataWarnings") -> None:
        """Add the counts of a later trace."""
        for name, one in other.found.items():
            known = self.found.get(name, replace(one, count=0))
            self.found[name] = replace(known, count=known.count + one.count)

    @property
    def lines(self) -> Iterator[str]:
        """Return a sentence per guard or other reason, at most `MOST`."""
        for one in list(self.found.values())[:MOST]:
            example = f"{one.example} (first: {one.first})"
            yield _MESSAGES[one.reason].format(events=counted(one.count), about=one.about, example=example)
        if len(self.found) > MOST:
            yield f"{len(self.found) - MOST} more warnings"

    def _check(
        self, checks: _LetterChecks, event: Mapping[str, Json], types: tuple[type, ...] | None, place: str
    ) -> None:
        values = checks.values(event)
        known, undefined = {**self._last, **values}, set[str]()
        decided: dict[int, bool] = {}
        for part in checks.parts:
            if part.whole is not None and id(part.whole) not in decided:
                decided[id(part.whole)] = _can_be_decided(part.whole, known)
            if part.whole is not None and decided[id(part.whole)]:
                continue
            if part.text not in undefined and not _can_be_decided(part.condition, known):
                undefined.add(part.text)
                example = ", ".join(f"{name} is {described(known[name])}" for name in part.names if name in known)
                self.note(Doubt.GUARD, part.text, place, example)
        if undefined:
            return
        for name in {name for part in checks.parts for name in part.names if name in values}:
            if type(self._last.get(name, self)) is not type(values[name]):
                self.version += 1
            self._last[name] = values[name]
        if checks.version != self.version:
            checks.version = self.version
            checks.good.clear()
        if types is not None:
            checks.good.add(types)


def _about(nanoseconds: int) -> str:
    """Return a duration with one decimal of the longest unit that fits."""
    unit, size = next(((unit, size) for unit, size in UNITS.items() if size <= nanoseconds), ("ns", 1))
    return f"{round(nanoseconds / size, 1):g} {unit}"


def checked(tree: RVAFT, *, order: bool = False) -> AssumptionCheck | None:
    """Return a new check of one trace, or None without assumptions.

    Late events have a warning of their own, so their check is left out without `order`.
    """
    assumptions = tree.assumes if order else tree.assumes - {Assumption.ORDER}
    return AssumptionCheck(tree, assumptions) if assumptions else None


def _checks(types: EventTypeIndex) -> Iterator[tuple[int, _LetterChecks]]:
    tree = types.tree
    guards = [(node.when, f"of {node.name}") for node in tree.top_down() if node.when is not None]
    parts = [part for guard, whose in guards for part in _parts(guard, whose)]
    for number, (kind, _, letter) in enumerate(types.letters):
        names, read = set(pattern_variables(letter.pattern)), reader(number, letter)
        own = [one for one in parts if not names.isdisjoint(one.names)] if kind == "entry" else []
        if kind == "ignored" and letter.when is not None:
            own = [*_parts(letter.when, "of an ignore")]
        if own or (kind == "entry" and tree.time is not None):
            inside = (one for part in own for one in walk(part.condition))
            by_value = any(isinstance(one, Operation) and one.operator in _BY_VALUE for one in inside)
            compared, plain = {name for part in own for name in part.names}, flat(letter.pattern)
            fields = None if plain is None else [field for field, name in plain.variables.items() if name in compared]
            yield number, _LetterChecks(read.values, own, None if by_value else fields)


def _parts(guard: Guard, whose: str) -> Iterator[_Comparison]:
    """Yield the conditions of a guard that can be undefined, except on time points."""
    timed, text = bool(time_points(guard)), f"{guard_text(guard)} {whose}"
    agenda = [guard]
    while agenda:
        part = agenda.pop()
        if isinstance(part, Operation) and part.operator in _JUNCTIONS:
            agenda.extend(reversed(part.operands))
            continue
        names = variables(part)
        # equality of finite values is always defined
        equality = isinstance(part, Operation) and part.operator in (Operator.EQ, Operator.NE, Operator.IN)
        may_be_undefined = not equality or sum(isinstance(one, Operation) for one in walk(part)) > 1
        if may_be_undefined and 0 < len(names) <= 4 and not time_points(part):
            yield _Comparison(part, None if timed else guard, names, text)
