"""A monitor that runs an RML text."""

from collections.abc import Hashable
from functools import lru_cache
from typing import Final

from backends.rml.reader.event_types import Types
from backends.rml.reader.parser import parse
from backends.rml.reader.static_checks import check
from backends.rml.reader.syntax import Program
from backends.rml.reader.terms import Term, Terms, mark
from backends.rml.reader.transitions import Transitions
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

_REMEMBERED: Final = 1024


def read(text: str) -> Monitor:
    """A fresh monitor of the specification; raises `LanguageError`, and `TooLarge` where event types nest too deep.

    Monitors of one text share its terms, so that their states can be compared. A step raises `TooLarge` where equations
    unfold into each other without end, which the static check cannot always see.
    """
    return RmlMonitor(_rules(text))


class Rules:
    """The rules for one checked specification, which remember the steps that were taken last."""

    def __init__(self, program: Program) -> None:
        self._transitions = Transitions(Terms(program), Types(program.declarations))
        self._taken: dict[tuple[Term, Hashable], Term | None] = {}
        self.start: Final = self._transitions.terms.body("Main")

    def step(self, term: Term, event: Json) -> Term | None:
        """The term after an event, or None where no rule applies."""
        asked = term, mark(event)
        try:
            return self._taken[asked]
        except KeyError:
            if len(self._taken) >= _REMEMBERED:
                self._taken.clear()
            self._taken[asked] = after = self._transitions.step(term, event)
            return after

    def may_halt(self, term: Term) -> bool:
        """Whether the trace may end here."""
        return self._transitions.may_halt(term)


@lru_cache(maxsize=256)
def _rules(text: str) -> Rules:
    check(program := parse(text))
    return Rules(program)


class RmlMonitor(Monitor):
    """⊤ from the first prefix whose state may halt, ⊥ when no rule applies any more, else ?; ? before any event."""

    def __init__(self, rules: Rules) -> None:
        super().__init__()
        self._rules = rules
        self._term: Term | None = rules.start

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
