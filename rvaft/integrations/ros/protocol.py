"""The protocol between a monitor of ROSMonitoring and its oracle.

A message is one JSON event. The reply is the event with the field `verdict`. ROSMonitoring treats
`false` and `currently_false` as violations, `true` and `false` as definitive. A reply without
verdict would count as definitive `true`, so a malformed message gets an error with the current
verdict.

A definitive verdict ends a monitor that only logs. So ⊥ is sent as definitive only on request, and
a detection only if the session ends with it.
"""

import re
from collections.abc import Mapping
from copy import copy
from dataclasses import KW_ONLY, dataclass
from datetime import datetime
from enum import StrEnum
from functools import partial
from operator import methodcaller
from typing import Any, Final, Self

from rvaft.core.fields_to_read import TreeReads
from rvaft.engine.monitor import repeating_engine
from rvaft.errors import TooLarge
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DEFAULT_LIMIT, Explanation
from rvaft.readers.json_lines import decode, marked
from rvaft.readers.log import BOM
from rvaft.stream.data_warnings import DataWarnings, checked
from rvaft.stream.detection import explained, identifying_fields, kept, matched_events
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.listeners import Listener
from rvaft.stream.monitor_set import DetectionCount, MonitorSet, Per, columns
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange, time_told

MAX_MESSAGE: Final = 1024 * 1024
"""Default maximum size of a message in bytes."""
_WHOLE: Final = "tree"
_OF_LINES: Final = re.compile(r"(?: \([^()]*\))?; a trace has one JSON object per line$")
"""References to lines and traces, which messages lack."""


class Polarity(StrEnum):
    """The meaning of `true`: the property holds (no undesired event), or the tree is detected."""

    PROPERTY = "property"
    DETECTION = "detection"


class Vocabulary(StrEnum):
    """The form of definitive verdicts: JSON Booleans like the RML oracle, or strings."""

    RML = "rml"
    STRINGS = "strings"


_DEFINITIVE: Final = {"true": True, "false": False}
_WORDS: Final[Mapping[Polarity, Mapping[Verdict, str]]] = {
    Polarity.PROPERTY: {Verdict.TRUE: "false", Verdict.UNKNOWN: "currently_true", Verdict.FALSE: "true"},
    Polarity.DETECTION: {Verdict.TRUE: "true", Verdict.UNKNOWN: "currently_false", Verdict.FALSE: "false"},
}


_GOING_ON: Final = {Polarity.PROPERTY: "currently_false", Polarity.DETECTION: "currently_true"}


class Session:
    """The state of one connection: monitors of the tree or part, and of its branches or kinds by
    label.

    A monitor fails beyond `limit` partial matches; `failures` has the reasons. `buffer` keeps time
    and topic of a bounded number of recent events, for explanations. `repeat` and `cooldown` are as
    for `MonitorSet`, `repeat_by` as for `rvaft.monitor`.
    """

    def __init__(
        self,
        tree: RVAFT,
        semantics: Semantics | str | None = None,
        *,
        per: Per = Per.TREE,
        limit: int = DEFAULT_LIMIT,
        repeat: bool = False,
        repeat_by: str | None = None,
        cooldown: int | None = None,
    ) -> None:
        self.semantics = meaning = resolve_semantics(tree, semantics)
        self.repeat = repeat = repeat or repeat_by is not None
        make = partial(repeating_engine, semantics=meaning, limit=limit, repeat=repeat, by=repeat_by)
        repeating: Any = {"repeat": repeat, "cooldown": cooldown}
        parts = columns(tree, per)
        self.monitors = {column.label: MonitorSet([column], make, meaning, **repeating) for column in parts}
        self.failures: dict[str, str] = {}
        self.untold: Explanation | None = None
        """A detection by the time, which the next reply tells."""
        self.fields = identifying_fields(tree)
        self.buffer = EventBuffer()
        self.listener: Listener | None = None
        self.watch = MonitoredTrace("", self.looked_at, buffer=self.buffer)
        self.data_warnings = DataWarnings(self.monitors[_WHOLE].types)
        self.assumed = checked(tree)
        self.events = 0

    def fork(self) -> Self:
        """Return an independent session in the same state."""
        twin = copy(self)
        twin.monitors = {label: monitors.fork() for label, monitors in self.monitors.items()}
        twin.failures = dict(self.failures)
        twin.buffer = EventBuffer()
        twin.buffer.known.update(self.buffer.known)
        twin.data_warnings = DataWarnings(self.monitors[_WHOLE].types)
        twin.data_warnings.merge(self.data_warnings)
        twin.watch = MonitoredTrace("", twin.looked_at, buffer=twin.buffer, events=self.events)
        return twin

    def notify(self, listener: Listener, trace: str, key: tuple[Json, ...] | None = None) -> None:
        """Notify a listener of further events, as those of a trace or key."""
        self.listener, self.watch.trace, self.watch.key = listener, trace, key
        listener.begin(self.watch)

    @property
    def looked_at(self) -> MonitorSet:
        """The monitors as a read-only set."""
        return MonitorSet.beside(list(self.monitors.values()))

    def read(self, event: Json, original: Json) -> None:
        """Read one event; `original` is the event before renaming."""
        self.events += 1
        if self.assumed is not None:
            self.data_warnings.note_broken(self.assumed, event, f"event {self.events}")
        changed: list[int] = []
        for column, (label, monitors) in enumerate(self.monitors.items()):
            if label not in self.failures:
                try:
                    changed += [column] * len(monitors.step(event, self.events))
                except TooLarge as error:
                    self.failures[label] = str(error)
        whole = self.monitors[_WHOLE]
        if _WHOLE not in self.failures and whole.serves:
            self.buffer.remember(self.events, kept(original, self.fields))
        if _WHOLE not in self.failures and whole.late:
            self.data_warnings.note_late(event, self.events, "", whole.engines[0].latest, whole.engines[0].jumps)
        elif _WHOLE not in self.failures:
            self.data_warnings.see(event, self.events, "", whole.types.of(event))
        if self.listener is not None and _WHOLE not in self.failures:
            self.watch.events, self.watch.monitors = self.events, self.looked_at
            if changed:
                self.listener.change(VerdictChange(self.watch, self.events, event, changed))
            elif whole.concerned and any(monitors.live for monitors in self.monitors.values()):
                self.listener.event(self.watch, self.events, event)

    def pass_time(self, time: Json | datetime) -> None:
        """Tell the monitors of a tree that reads times that a time has come, which may detect without an event."""
        if self.monitors[_WHOLE].time is None:
            return
        self.begin_again()
        changed: list[int] = []
        for column, (label, monitors) in enumerate(self.monitors.items()):
            if label not in self.failures:
                changed += [column] * len(monitors.told(methodcaller("pass_time", time), self.events))
        if _WHOLE in map([*self.monitors].__getitem__, changed):
            self.untold = self.explain()
        if self.listener is not None and changed and _WHOLE not in self.failures:
            self.watch.events, self.watch.monitors = self.events, self.looked_at
            self.listener.change(VerdictChange(self.watch, self.events, {}, changed, passed=time_told(time)))

    def explain(self) -> Explanation | None:
        """Return the explanation of a detection of the whole tree, and remember it with the count."""
        found = None if _WHOLE in self.failures else self.monitors[_WHOLE].explanation(0)
        if found is not None:
            self.count.explanation = found
        return found

    def begin_again(self) -> None:
        """Restart the monitors that have detected."""
        for monitors in self.monitors.values():
            monitors.begin_again()

    @property
    def count(self) -> DetectionCount:
        """The detections of the whole tree."""
        return self.monitors[_WHOLE].found[0]

    def verdict(self, label: str = _WHOLE) -> Verdict | None:
        """Return the current verdict, or None if the monitor failed."""
        return None if label in self.failures else self.monitors[label].verdicts[0]


@dataclass(eq=False)
class MessageProtocol:
    """Reads and answers messages for a tree or part.

    Messages of more than `longest` bytes are errors; with `strict_json`, so are numbers that are
    not finite, which replies otherwise repeat. `definitive` sends ⊥ as definitive.

    >>> import rvaft
    >>> tree = rvaft.loads("top and a; a;")
    >>> MessageProtocol(tree).reply('{"event": "b"}', Session(tree))
    {'event': 'b', 'verdict': 'currently_true'}
    """

    tree: RVAFT
    _: KW_ONLY
    polarity: Polarity = Polarity.PROPERTY
    vocabulary: Vocabulary = Vocabulary.RML
    longest: int = MAX_MESSAGE
    definitive: bool = False
    strict_json: bool = False

    def __post_init__(self) -> None:
        self._reads = TreeReads(self.tree)
        self._names: dict[str, set[str]] = {"topic": set(), "service": set()}
        for pattern in self._reads.patterns:
            for field, inner in pattern.fields if isinstance(pattern, ObjectPattern) else ():
                if field in self._names and isinstance(inner, Literal) and isinstance(inner.value, str):
                    self._names[field].add(inner.value)

    def reply(self, message: str | bytes, session: Session) -> dict[str, Json]:
        """Return the reply to a message; only a valid event changes the session."""
        event, found, _ = self.answer(message, session)
        return {**event, **found}

    def answer(self, message: str | bytes, session: Session) -> tuple[dict[str, Json], dict[str, Json], Verdict | None]:
        """Return the event of a message, what the reply adds, and the verdict, None of a monitor that failed."""
        event: dict[str, Json] = {}
        found: dict[str, Json] = {}
        try:
            event = self._event(message.encode() if isinstance(message, str) else message)
        except ValueError as error:
            found = {"error": _OF_LINES.sub("", str(error))}
        else:
            session.read(self._as_spelled(event), event)
            if _WHOLE in session.failures:
                found = {"error": session.failures[_WHOLE]}
            elif (explanation := session.explain() or session.untold) is not None:
                known = session.buffer.events(matched_events([explanation]))
                count = session.count.fields if session.repeat else {}
                found = {**count, **explained(explanation, self.tree, known, session.fields)}
        verdict = session.verdict()
        if event and session.untold is not None:
            verdict, session.untold = Verdict.TRUE, None
        verdicts = {**{label: session.verdict(label) for label in session.monitors}, _WHOLE: verdict}
        parts = {label: self.word(one, going_on=session.repeat) for label, one in verdicts.items()}
        found["verdict"] = parts.pop(_WHOLE)
        session.begin_again()
        return event, {**found, "verdicts": {**parts}} if parts else found, verdict

    def _event(self, line: bytes) -> dict[str, Json]:
        if len(line) > self.longest:
            raise ValueError(f"a message of {len(line)} bytes; the maximum is {self.longest}")
        if line.startswith(BOM):
            raise ValueError("a byte order mark before the event; send the event alone")
        return decode(line, reads=self._reads, strict=self.strict_json, passed_on=True)

    def word(self, verdict: Verdict | None, *, going_on: bool) -> str | bool:
        """Return the word for a verdict; one that is not `going_on` after a detection is definitive."""
        if verdict is None:
            return "unknown"  # neither a violation nor definitive
        if verdict is Verdict.TRUE and going_on:
            return _GOING_ON[self.polarity]
        holds = verdict is Verdict.FALSE and self.polarity is Polarity.PROPERTY
        word = _WORDS[self.polarity][Verdict.UNKNOWN if holds and not self.definitive else verdict]
        return _DEFINITIVE.get(word, word) if self.vocabulary is Vocabulary.RML else word

    def _as_spelled(self, event: dict[str, Json]) -> dict[str, Json]:
        """Return the event with topic and service names spelled as in the tree.

        ROS treats `/command` and `command` (in the root namespace) as equal, while trees
        distinguish them. A name that the tree spells both ways, or that starts with several
        slashes, is unchanged.
        """
        renamed: dict[str, Json] = {}
        for field, known in self._names.items():
            name = event.get(field)
            if isinstance(name, str) and name not in known and not name.startswith("//"):
                other = name[1:] if name.startswith("/") else f"/{name}"
                if other in known:
                    renamed[field] = other
        return marked({**event, **renamed}, self._reads) if renamed else event


def reply_of_all(
    protocols: Mapping[str, MessageProtocol], message: str | bytes, sessions: Mapping[str, Session]
) -> dict[str, Json]:
    """Return the reply to a message for trees by name: of several, with what each says in `trees`.

    The verdict of several is a detection if a tree detects, which is definitive once no other can; a
    monitor that failed leaves it unknown, unless another detects.

    >>> import rvaft
    >>> trees = {name: rvaft.loads(f"top and {name}; {name};") for name in "ab"}
    >>> protocols = {name: MessageProtocol(tree) for name, tree in trees.items()}
    >>> sessions = {name: Session(tree) for name, tree in trees.items()}
    >>> found = reply_of_all(protocols, '{"event": "a"}', sessions)
    >>> found["verdict"], {name: told["verdict"] for name, told in found["trees"].items()}
    ('currently_false', {'a': False, 'b': 'currently_true'})
    """
    if len(protocols) == 1:
        [(name, protocol)] = protocols.items()
        return protocol.reply(message, sessions[name])
    answers = {name: protocol.answer(message, sessions[name]) for name, protocol in protocols.items()}
    verdicts = [verdict for _, _, verdict in answers.values()]
    event = next(event for event, _, _ in answers.values())
    trees: dict[str, Json] = {name: found for name, (_, found, _) in answers.items()}
    going_on = any(session.repeat for session in sessions.values()) or Verdict.UNKNOWN in verdicts
    joint = next((one for one in (Verdict.TRUE, None, Verdict.UNKNOWN) if one in verdicts), Verdict.FALSE)
    word = next(iter(protocols.values())).word(joint, going_on=going_on)
    errors = {found.get("error") for _, found, _ in answers.values()}
    wrong: dict[str, Json] = {"error": errors.pop()} if not event and len(errors) == 1 and None not in errors else {}
    return {**event, **wrong, "trees": trees, "verdict": word}
