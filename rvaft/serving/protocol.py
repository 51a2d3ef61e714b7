"""What a message is answered: the protocol between a monitor of ROSMonitoring and its oracle.

A message is one JSON event. The reply is that event with the field `verdict`, which ROSMonitoring publishes and reads: `false` and
`currently_false` as violations, `true` and `false` as definitive. A reply without it would count as a definitive `true`, so a
message that is no event gets an error with the verdict so far.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from rvaft.monitoring.told import explained, matched_events
from rvaft.reads import Scope, reads_of
from rvaft.serving.names import Names
from rvaft.serving.session import Session
from rvaft.traces import BOM, decode
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Verdict

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
    names: Names
    tree: RVAFT
    polarity: Polarity = Polarity.PROPERTY
    vocabulary: Vocabulary = Vocabulary.RML
    longest: int = MAX_MESSAGE

    def reply(self, message: str | bytes, session: Session) -> dict[str, Json]:
        """The answer to a message; an event is read by the session, anything else leaves it as it was."""
        try:
            event = self._event(message)
        except ValueError as error:
            return {"error": _OF_LINES.sub("", str(error)), **self._verdicts(session)}
        session.read(self.names.as_written(event), event)
        return {**event, **self._found(session), **self._verdicts(session)}

    def word(self, verdict: Verdict | None) -> str | bool:
        """A verdict as ROSMonitoring's word for it; None is that of a monitor that gave up."""
        if verdict is None:
            return _GAVE_UP
        word = _WORDS[self.polarity][verdict]
        return _DEFINITIVE.get(word, word) if self.vocabulary is Vocabulary.RML else word

    def _event(self, message: str | bytes) -> dict[str, Json]:
        line = message.encode() if isinstance(message, str) else message
        if len(line) > self.longest:
            raise ValueError(f"a message of {len(line)} bytes; the longest that is read has {self.longest}")
        if line.startswith(BOM):
            raise ValueError("a byte order mark before the event; send the event alone")
        return decode(line, reads=self.reads, finite=True)

    def _verdicts(self, session: Session) -> dict[str, Json]:
        said: dict[str, Json] = {"verdict": self.word(session.whole.verdict)}
        parts = {label: self.word(part.verdict) for label, part in session.parts.items()}
        return said | {"verdicts": parts} if parts else said

    def _found(self, session: Session) -> dict[str, Json]:
        """What there is to say beside the verdict: how the tree was detected, or why there is no verdict."""
        if session.whole.failure is not None:
            return {"error": session.whole.failure}
        explanation = session.whole.explanation
        if explanation is None:
            return {}
        return explained(explanation, self.tree, session.recall.events(matched_events([explanation])))


def protocol(
    tree: RVAFT,
    *,
    polarity: Polarity = Polarity.PROPERTY,
    vocabulary: Vocabulary = Vocabulary.RML,
    longest: int = MAX_MESSAGE,
) -> Protocol:
    """The protocol for a tree, or for the part of one."""
    return Protocol(reads_of(tree), Names.of(tree), tree, polarity, vocabulary, longest)


def encoded(reply: Mapping[str, Json]) -> str:
    """A reply as the text of a message."""
    return json.dumps(reply)
