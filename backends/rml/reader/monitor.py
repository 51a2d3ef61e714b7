"""A monitor that runs an RML text."""

from collections.abc import Hashable
from functools import lru_cache

from backends.rml.reader.static_checks import checked
from backends.rml.reader.terms import RmlTerm
from backends.rml.reader.transitions import Transitions
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor


@lru_cache(maxsize=256)
def rules(text: str) -> Transitions:
    """The rules of a text."""
    return Transitions(checked(text))


def read(text: str) -> Monitor:
    """A fresh monitor of the specification; raises `LanguageError`, and `TooLarge` where event types nest too deep.

    Monitors of one text share its terms, so that their states can be compared. A step raises `TooLarge` where equations
    unfold into each other without end, which the static check cannot always see.

    >>> [str(verdict) for verdict in read("a matches {e: 'a'}; Main = a a all;").run([{"e": "a"}, {"e": "a"}])]
    ['unknown', 'true']
    """
    return RmlMonitor(rules(text))


class RmlMonitor(Monitor):
    """⊤ from the first prefix whose state may halt, ⊥ when no rule applies any more, else ?; ? before any event."""

    def __init__(self, rules: Transitions) -> None:
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
