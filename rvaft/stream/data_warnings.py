"""What could have been part of a match and was not, for a reason that its author may not have
meant: counts, each with the first example.

Such are guards that are undefined, times that cannot be read, events that come too late, and
numbers that are not finite.

Whether a guard is undefined is asked of events, not of partial matches, so it does not matter how
these are followed: of every event that binds a variable of a comparison, together with the values
that other events gave to the other variables last.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from enum import StrEnum
from itertools import chain, product
from typing import Final, NamedTuple

from rvaft.core.classifier import Values, flat, reader
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import guard_text
from rvaft.model.guards import Guard, Operation, Operator, time_points, value, variables, walk
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.values import Json, at
from rvaft.readers.json_lines import NonFiniteEvent, described
from rvaft.stream.detection import counted
from rvaft.stream.statistics import UNSEEN, EventKind, EventTypeIndex

MOST: Final = 20
"""Guards that are told one by one."""
_ANY: Final = (1, "a", True)
"""Values that stand for one that is not known: where none makes a comparison defined, nothing does."""
_JUNCTIONS: Final = (Operator.AND, Operator.OR, Operator.NOT)
_BY_VALUE: Final = frozenset({Operator.DIV, Operator.MUL, Operator.NUMBER})
"""What is undefined not for the types of its operands alone."""


class Reason(StrEnum):
    """Why something was no part of a match."""

    GUARD = "undefined guard"
    TIME = "unreadable time"
    LATE = "late event"
    NUMBER = "number that is not finite"


_SAID: Final = {
    Reason.GUARD: "undefined guard in {events}: {about}, where {example}",
    Reason.TIME: "no readable time in {events}: {example}",
    Reason.LATE: "{events} later than {about}, which no match uses: {example}",
    Reason.NUMBER: "undefined number in {events}: {example}",
}


@dataclass(slots=True)
class DataWarning:
    """So many events, the first of them, and what was wrong with that; `about` is the guard, if it
    is one, or how late events may be.
    """

    reason: Reason
    about: str
    first: str
    example: str
    count: int = 0


class _Comparison(NamedTuple):
    """A comparison in a guard, or what else is true or false there; `text` says which guard.

    The guard is undefined where none of the `deciding` can be decided.
    """

    deciding: tuple[Guard, ...]
    names: tuple[str, ...]
    text: str


def _can_be_decided(guard: Guard, known: Mapping[str, Json]) -> bool:
    """Whether some values of the other variables make it true or false; of very many of them that
    is taken for granted.
    """
    others = [name for name in variables(guard) if name not in known]
    chosen = product((*_ANY, *(known[name] for name in variables(guard) if name in known)), repeat=len(others))
    bindings = ({**known, **dict(zip(others, some, strict=True))} for some in chosen)
    return len(others) > 3 or any(isinstance(value(guard, binding), bool) for binding in bindings)


@dataclass(slots=True)
class _Asked:
    """What is asked of events of one letter, the `fields` with its variables, and the types of the
    values there that are known to be `good`.

    There are no fields where the pattern does not say where these stand, or where more than the types decides.
    """

    values: Values
    parts: Sequence[_Comparison]
    fields: Sequence[str] | None
    good: set[tuple[type, ...]] = field(default_factory=set)
    version: int = -1


class DataWarnings:
    """Counts over the events of one trace or several; can be pickled, and added to those of other
    traces of the same tree.
    """

    def __init__(self, types: EventTypeIndex) -> None:
        self.found: dict[tuple[Reason, str], DataWarning] = {}
        self._last: dict[str, Json] = {}
        self.attach(types)

    def attach(self, types: EventTypeIndex) -> None:
        """Know the tree again, after a pickle."""
        self._types, self.time, self.version = types, types.tree.time, 0
        self._asked = dict(_asked(types))

    def __getstate__(self) -> dict[str, object]:
        """The counts, without what the tree says."""
        return {"found": self.found, "_last": self._last}

    def see(self, event: Mapping[str, Json], number: int, prefix: str, event_kind: EventKind) -> None:
        """Look at an event of which something is asked, or that is a `NonFiniteEvent`."""
        good = event_kind.checks.good
        if (
            good is not None
            and self.time is None
            and type(event) is dict
            and good[0] is self
            and good[1] == self.version
        ):
            fields = good[2]  # mostly; asked of every event
            if fields is not None and len(fields) == 1 and (type(event[fields[0]]),) in good[3]:
                return
        if event_kind.checks.looked_at == UNSEEN:
            event_kind.checks.looked_at = tuple(number for number in event_kind.fits if number in self._asked)
        if isinstance(event, NonFiniteEvent):
            place = f"{prefix}event {number}"
            if event_kind.checks.looked_at or self.time is None or event.field.split(".")[0] != self.time.field[0]:
                self.note(Reason.NUMBER, "", place, f"{event.field} is {event.number}")
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
            self.note(Reason.TIME, "", f"{prefix}event {number}", wrong or f"the field {name} is missing")

    def _good(self, event_kind: EventKind) -> tuple[Sequence[str] | None, set[tuple[type, ...]]]:
        """The fields that are asked of events of a shape, None where more than the types there
        decides, and types that are known to be good now.
        """
        asked = [self._asked[letter].fields for letter in event_kind.checks.looked_at]
        known = [fields for fields in asked if fields is not None]
        fields = tuple(dict.fromkeys(chain(*known))) if len(known) == len(asked) else None
        good = set[tuple[type, ...]]()
        event_kind.checks.good = self, self.version, fields, good
        return fields, good

    def _look(
        self, event: Mapping[str, Json], place: str, event_kind: EventKind, kinds: tuple[type, ...] | None
    ) -> None:
        """Ask what is to be asked of an event, and note whether none of it need be asked of others
        with values of these types.
        """
        version, good = self.version, True
        for letter in event_kind.checks.looked_at:
            one = self._asked[letter]
            types = None if one.fields is None else tuple([type(event[field]) for field in one.fields])
            if types is None or one.version != version or types not in one.good:
                self._ask(one, event, types, place)
                good = good and types in one.good
        if good and kinds is not None and version == self.version and event_kind.checks.good is not None:
            event_kind.checks.good[3].add(kinds)

    def over(self, events: Iterable[tuple[int, Json]], prefix: str) -> Iterator[tuple[int, Json, EventKind | None]]:
        """The events of a trace, which have numbers, and what they are, nothing for one that is
        late, each after it was looked at.
        """
        latest, look_up = None, self._types.of
        time = self.time if self.time is not None and self.time.late is not None else None
        for number, event in events:
            late = False
            if time is not None:
                late, latest = time.is_late(event, latest)
            if late:
                self.note_late(event, number, prefix, latest)
                yield number, event, None
                continue
            event_kind = look_up(event)
            if event_kind.checks.looked_at or type(event) is not dict:
                self.see(event, number, prefix, event_kind)
            yield number, event, event_kind

    def note(self, reason: Reason, about: str, place: str, example: str) -> None:
        """Count one event."""
        self.found.setdefault((reason, about), DataWarning(reason, about, place, example)).count += 1

    def note_late(self, event: Json, number: int, prefix: str, latest: int | None) -> None:
        """Count an event that is late, after one of the time `latest`."""
        assert self.time is not None, "only where times are declared are events late"
        time, written = self.time.read(event) or 0, self.time.written(event)
        shown = f"{Decimal(time).scaleb(-9).normalize():f} s" if isinstance(written, Mapping) else json.dumps(written)
        behind = f"{duration_text((latest or 0) - time)} behind the latest"
        said = f"{'.'.join(self.time.field)} is {shown}, {behind}"
        self.note(Reason.LATE, duration_text(self.time.late or 0), f"{prefix}event {number}", said)

    def merge(self, other: "DataWarnings") -> None:
        """Add the counts of a later trace."""
        for name, one in other.found.items():
            known = self.found.get(name, replace(one, count=0))
            self.found[name] = replace(known, count=known.count + one.count)

    @property
    def lines(self) -> Iterator[str]:
        """Each as a sentence, one for each guard; of very many guards the first."""
        for one in list(self.found.values())[:MOST]:
            example = f"{one.example} (first: {one.first})"
            yield _SAID[one.reason].format(events=counted(one.count), about=one.about, example=example)
        if len(self.found) > MOST:
            yield f"{len(self.found) - MOST} other guards were undefined"

    def _ask(self, asked: _Asked, event: Mapping[str, Json], types: tuple[type, ...] | None, place: str) -> None:
        values = asked.values(event)
        known, undefined = {**self._last, **values}, set[str]()
        for part in asked.parts:
            if part.text not in undefined and not any(_can_be_decided(guard, known) for guard in part.deciding):
                undefined.add(part.text)
                said = ", ".join(f"{name} is {described(known[name])}" for name in part.names if name in known)
                self.note(Reason.GUARD, part.text, place, said)
        if undefined:
            return
        for name in {name for part in asked.parts for name in part.names if name in values}:
            if type(self._last.get(name, self)) is not type(values[name]):
                self.version += 1
            self._last[name] = values[name]
        if asked.version != self.version:
            asked.version = self.version
            asked.good.clear()
        if types is not None:
            asked.good.add(types)


def _asked(types: EventTypeIndex) -> Iterator[tuple[int, _Asked]]:
    """What is asked of events, with the numbers of their letters."""
    tree = types.tree
    guards = [(node.when, f"of {node.name}") for node in tree.top_down() if node.when is not None]
    parts = [part for guard, whose in guards for part in _parts(guard, whose)]
    for number, (kind, _, letter) in enumerate(types.letters):
        names, read = set(pattern_variables(letter.pattern)), reader(number, letter)
        own = [one for one in parts if not names.isdisjoint(one.names)] if kind == "entry" else []
        if kind == "ignored" and letter.when is not None:
            own = [*_parts(letter.when, "of an ignore")]
        if own or (kind == "entry" and tree.time is not None):
            inside = (one for part in own for one in walk(part.deciding[0]))
            by_value = any(isinstance(one, Operation) and one.operator in _BY_VALUE for one in inside)
            told, plain = {name for part in own for name in part.names}, flat(letter.pattern)
            fields = None if plain is None else [field for field, name in plain.variables.items() if name in told]
            yield number, _Asked(read.values, own, None if by_value else fields)


def _parts(guard: Guard, whose: str) -> Iterator[_Comparison]:
    """The comparisons of a guard that some value makes undefined, but for those of times."""
    timed = bool(time_points(guard))
    agenda = [guard]
    while agenda:
        part = agenda.pop()
        if isinstance(part, Operation) and part.operator in _JUNCTIONS:
            agenda.extend(reversed(part.operands))
            continue
        names = variables(part)
        # Of values that are finite equality is always true or false.
        equality = isinstance(part, Operation) and part.operator in (Operator.EQ, Operator.NE, Operator.IN)
        told = not equality or sum(isinstance(one, Operation) for one in walk(part)) > 1
        if told and 0 < len(names) <= 4 and not time_points(part):
            yield _Comparison((part,) if timed else (part, guard), names, f"{guard_text(guard)} {whose}")
