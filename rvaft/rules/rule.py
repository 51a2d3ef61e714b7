"""What a rule is: a code, a severity, a function that reports, and the words that explain it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

from rvaft.errors import RvaftError
from rvaft.findings import Finding, Severity
from rvaft.model import Place

DEFAULT_LIMIT: Final = 500_000
"""Elementary steps that one rule may spend on questions that are hard in general."""


@dataclass(frozen=True, slots=True)
class Report:
    """What a rule found, in one line that says what is wrong and how to mend it.

    With `undecided` the rule could not tell whether it is broken.
    """

    place: Place
    message: str
    nodes: tuple[str, ...] = ()
    undecided: bool = False


class Undecided(RvaftError):
    """A question about the scenarios was not decided within the limit."""


@dataclass(slots=True)
class Budget:
    """Steps that are left; `spend` raises `Undecided` when there are none."""

    left: int = DEFAULT_LIMIT

    def spend(self, steps: int) -> None:
        """Take steps from the budget."""
        self.left -= steps
        if self.left < 0:
            raise Undecided("the limit of steps is reached")


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule: `check` takes a draft or the context of a tree and reports what breaks the rule.

    `bad` is a smallest text that breaks it and `mended` the same text put right; with `python` both are code that
    builds a tree, since no text leads there.
    """

    code: str
    severity: Severity
    title: str
    check: Callable[[Any], Iterable[Report]]
    explanation: str
    bad: str
    mended: str
    python: bool = False

    def finding(self, report: Report) -> Finding:
        """A report under this rule's code."""
        return Finding(report.place, self.severity, self.code, report.message, report.nodes)
