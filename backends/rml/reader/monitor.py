"""A monitor that runs an RML text."""

from collections.abc import Hashable
from functools import lru_cache
from typing import Final

from backends.rml.reader.static_checks import checked
from backends.rml.reader.terms import RmlTerm, mark
from backends.rml.reader.transitions import Transitions
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

_REMEMBERED: Final = 1024


def read(text: str) -> Monitor:
    """A fresh monitor of the specification; raises `LanguageError`, and `TooLarge` where event types nest too deep.

    Monitors of one text share its terms, so that their states can be compared. A step raises `TooLarge` where equations
    unfold into each other without end, which the static check cannot always see.

    >>> [str(verdict) for verdict in read("a matches {e: 'a'}; Main = a a all;").run([{"e": "a"}, {"e": "a"}])]
    ['unknown', 'true']
    """
    return RmlMonitor(_rules(text))


@lru_cache(maxsize=256)
def _rules(text: str) -> "RmlRules":
    return RmlRules(text)


class RmlRules:
    """The rules for one specification, which remember the steps that were taken last."""

    def __init__(self, text: str) -> None:
        self._transitions = Transitions(checked(text))
        self._taken: dict[tuple[RmlTerm, Hashable], RmlTerm | None] = {}
        self.start: Final = self._transitions.terms.body("Main")
        self.may_halt: Final = self._transitions.may_halt

    def step(self, term: RmlTerm, event: Json) -> RmlTerm | None:
        """The term after an event, or None where no rule applies."""
        asked = term, mark(event)
        try:
            return self._taken[asked]
        except KeyError:
            if len(self._taken) >= _REMEMBERED:
                self._taken.clear()
            self._taken[asked] = after = self._transitions.step(term, event)
            return after


class RmlMonitor(Monitor):
    """⊤ from the first prefix whose state may halt, ⊥ when no rule applies any more, else ?; ? before any event."""

    def __init__(self, rules: RmlRules) -> None:
        super().__init__()
        self._rules = rules
        self._term: RmlTerm | None = rules.start

    @property
    def state(self) -> Hashable:
        """The verdict and the term."""
        return self.verdict, self._term

    def _advance(self, event: Json) -> Verdict:
        assert self._term is not None
        if not self._rules.may_halt(self._term):  # it may only before the first event: what was ⊤ there stays ⊤
            self._term = self._rules.step(self._term, event)
        if self._term is None:
            return Verdict.FALSE
        if self._rules.may_halt(self._term):
            self._term = None
            return Verdict.TRUE
        return Verdict.UNKNOWN
