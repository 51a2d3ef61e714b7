"""What a message is answered: the protocol between a monitor of ROSMonitoring and its oracle.

A message is one JSON event. The reply is that event with the field `verdict`, which ROSMonitoring publishes and reads: `false` and
`currently_false` as violations, `true` and `false` as definitive. A reply without it would count as a definitive `true`, so a
message that is no event gets an error with the verdict so far.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Self

from rvaft.analysis.pattern_index import Scope, TreeReads
from rvaft.api import monitor, one_of
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring.detection import explained, matched_events, places, told_fields
from rvaft.monitoring.monitor_set import Column, MonitorSet, Per, columns
from rvaft.monitoring.reader import BOM, decode
from rvaft.monitoring.run import EventBuffer

FIELDS: Final = ("topic", "service")
"""The fields of an event, at its top level, that hold such a name."""


def names(tree: RVAFT) -> dict[str, frozenset[str]]:
    """The names of topics and services that the runtime events and `ignore` declarations of a tree spell out, per field."""
    found: dict[str, set[str]] = {field: set() for field in FIELDS}
    for pattern in TreeReads(tree).patterns:
        for field, inner in pattern.fields if isinstance(pattern, ObjectPattern) else ():
            if field in found and isinstance(inner, Literal) and isinstance(inner.value, str):
                found[field].add(inner.value)
    return {field: frozenset(known) for field, known in found.items()}


class ColumnMonitor:
    """The monitor of one column, which gives up where it would raise `TooLarge`; `failure` then says why."""

    def __init__(self, monitors: MonitorSet, failure: str | None = None) -> None:
        self.monitors = monitors
        self.failure = failure

    def fork(self) -> Self:
        """An independent one that has read the same events."""
        return type(self)(self.monitors.fork(), self.failure)

    def read(self, event: Json, number: int) -> bool:
        """Read the event of that number, and say whether an explanation may name it."""
        if self.failure is None:
            try:
                self.monitors.step(event, number)
            except TooLarge as error:
                self.failure = str(error)
        return self.failure is None and self.monitors.serves

    @property
    def verdict(self) -> Verdict | None:
        """The verdict so far, or None after it gave up."""
        return None if self.failure is not None else self.monitors.verdicts[0]


class Session:
    """What one connection has read: `whole` of the tree, `parts` of its branches or kinds, by number or name.

    `buffer` has when and where the events came that an explanation may name: of each event no more, and of events a bounded number.
    """

    def __init__(self, whole: ColumnMonitor, parts: Mapping[str, ColumnMonitor]) -> None:
        self.whole = whole
        self.parts = parts
        self.fields = told_fields(whole.monitors.columns[0].part)
        self.buffer = EventBuffer()
        self.events = 0
        """How many were read."""

    def fork(self) -> Self:
        """An independent session that has read the same events."""
        twin = type(self)(self.whole.fork(), {label: part.fork() for label, part in self.parts.items()})
        twin.buffer.known.update(self.buffer.known)
        twin.events = self.events
        return twin

    def read(self, event: Json, came: Json = None) -> None:
        """Read one event; `came` is how it came, where that was put otherwise."""
        self.events += 1
        if self.whole.read(event, self.events):
            self.buffer.remember(self.events, places(event if came is None else came, self.fields))
        for part in self.parts.values():
            part.read(event, self.events)


def session(tree: RVAFT, semantics: Semantics | str = Semantics.PROJECTED, *, per: Per = Per.TREE) -> Session:
    """A session that has read nothing; the tree may be the part for one branch or kind.

    A part without a feasible scenario has no monitor. Raises what `rvaft.monitoring.monitor_set.columns` raises.
    """
    whole, *parts = columns(tree, per)
    return Session(watched(whole, semantics), {part.label: watched(part, semantics) for part in parts})


def watched(column: Column, semantics: Semantics | str, *, limit: int = DEFAULT_LIMIT) -> ColumnMonitor:
    """The monitor of a column that has read nothing; it gives up beyond `limit` partial matches."""
    meaning = one_of(Semantics, semantics)
    return ColumnMonitor(MonitorSet([column], lambda part: monitor(part, semantics=meaning, limit=limit), meaning))


MAX_MESSAGE: Final = 1024 * 1024
"""The longest message that is read unless told otherwise, in bytes."""


class Polarity(StrEnum):
    """What `true` says: the property holds (the undesired event never happens), or the tree is detected."""

    PROPERTY = "property"
    DETECTION = "detection"


class Vocabulary(StrEnum):
    """How definitive verdicts are sent: as JSON booleans, like the RML oracle, or as strings."""

    RML = "rml"
    STRINGS = "strings"


_OF_LINES: Final = re.compile(r"(?: \([^()]*\))?; a trace has one JSON object per line$")
"""What the reader of traces says of lines and places in them; a message is no line."""
_GAVE_UP: Final = "unknown"
"""ROSMonitoring's word for no verdict: no violation, and not definitive."""
_DEFINITIVE: Final = {"true": True, "false": False}
_WORDS: Final[Mapping[Polarity, Mapping[Verdict, str]]] = {
    Polarity.PROPERTY: {Verdict.TRUE: "false", Verdict.UNKNOWN: "currently_true", Verdict.FALSE: "true"},
    Polarity.DETECTION: {Verdict.TRUE: "true", Verdict.UNKNOWN: "currently_false", Verdict.FALSE: "false"},
}


@dataclass(frozen=True, slots=True)
class Protocol:
    """How messages are read and answered; `longest` is the length of a message in bytes beyond which it is an error."""

    reads: Scope
    names: Mapping[str, frozenset[str]]
    tree: RVAFT
    polarity: Polarity = Polarity.PROPERTY
    vocabulary: Vocabulary = Vocabulary.RML
    longest: int = MAX_MESSAGE

    def reply(self, message: str | bytes, session: Session) -> dict[str, Json]:
        """The answer to a message; an event is read by the session, anything else leaves it as it was."""
        event: dict[str, Json] = {}
        found: dict[str, Json] = {}
        try:
            event = self._event(message)
        except ValueError as error:
            found = {"error": _OF_LINES.sub("", str(error))}
        else:
            session.read(self._as_written(event), event)
            if session.whole.failure is not None:
                found = {"error": session.whole.failure}
            elif (explanation := session.whole.monitors.explanation(0)) is not None:
                known = session.buffer.events(matched_events([explanation]))
                found = explained(explanation, self.tree, known, session.fields)
        verdicts: dict[str, Json] = {"verdict": self.word(session.whole.verdict)}
        if session.parts:
            verdicts["verdicts"] = {label: self.word(part.verdict) for label, part in session.parts.items()}
        return {**event, **found, **verdicts}

    def word(self, verdict: Verdict | None) -> str | bool:
        """A verdict as ROSMonitoring's word for it; None is that of a monitor that gave up."""
        if verdict is None:
            return _GAVE_UP
        word = _WORDS[self.polarity][verdict]
        return _DEFINITIVE.get(word, word) if self.vocabulary is Vocabulary.RML else word

    def _as_written(self, event: Mapping[str, Json]) -> Mapping[str, Json]:
        """The event with its names as the tree spells them; one that the tree spells both ways, or not at all, stays as it is.

        ROS takes `/command` and `command` for one name (at the root namespace), and the versions of ROSMonitoring write it either way.
        A tree takes them for two values, so this holds on the wire alone. A name with more than one leading slash has no other spelling.
        """
        renamed: dict[str, Json] = {}
        for field, known in self.names.items():
            name = event.get(field)
            if isinstance(name, str) and name not in known and not name.startswith("//"):
                other = name[1:] if name.startswith("/") else f"/{name}"
                if other in known:
                    renamed[field] = other
        return {**event, **renamed} if renamed else event

    def _event(self, message: str | bytes) -> dict[str, Json]:
        line = message.encode() if isinstance(message, str) else message
        if len(line) > self.longest:
            raise ValueError(f"a message of {len(line)} bytes; the longest that is read has {self.longest}")
        if line.startswith(BOM):
            raise ValueError("a byte order mark before the event; send the event alone")
        return decode(line, reads=self.reads, finite=True)


def protocol(
    tree: RVAFT,
    *,
    polarity: Polarity = Polarity.PROPERTY,
    vocabulary: Vocabulary = Vocabulary.RML,
    longest: int = MAX_MESSAGE,
) -> Protocol:
    """The protocol for a tree, or for the part of one.

    >>> import rvaft
    >>> tree = rvaft.loads("top and a; a;")
    >>> protocol(tree).reply('{"event": "b"}', session(tree))
    {'event': 'b', 'verdict': 'currently_true'}
    """
    return Protocol(TreeReads(tree), names(tree), tree, polarity, vocabulary, longest)
