"""The types of rules and their reports."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from rvaft.core.precedence import node_of
from rvaft.core.property import AtLeast, Kept, One
from rvaft.model.nodes import Place
from rvaft.support.wording import listing


class Severity(StrEnum):
    """An error makes the tree unusable, a warning does not; an information states an
    interpretation.

    >>> Severity.ERROR.value
    'error'
    """

    ERROR = "error"
    WARNING = "warning"
    INFORMATION = "information"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding; `code` is the code for `rvaft explain`, `nodes` are the nodes concerned.

    >>> print(Finding(Place("t.rvaft", 2, 1), Severity.WARNING, "undeclared", "b is not declared", ("b",)))
    t.rvaft:2:1: warning: b is not declared [undeclared]
    """

    place: Place
    severity: Severity
    code: str
    message: str
    nodes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.place}: {self.severity}: {self.message} [{self.code}]"


class RuleReport(NamedTuple):
    """What is wrong and how to correct it; `undecided` if the rule could not decide."""

    place: Place
    message: str
    nodes: tuple[str, ...] = ()
    undecided: bool = False


class Rule(NamedTuple):
    """A rule; `check` takes a draft or the scenario space of a tree."""

    code: str
    severity: Severity
    check: Callable[[Any], Iterable[RuleReport]]


def branch_of(kept: Kept) -> str:
    """Return the choices of a scenario as text: those at each `or`, and the children at each
    `KofN`.
    """
    gates = [part for part in kept if len(part.parts) > 1]
    choices = [f"{node_of(kept[gate][0])} at {node_of(gate)}" for gate in gates if isinstance(gate, One)]
    keeping = [(gate, " ".join(map(node_of, kept[gate]))) for gate in gates if isinstance(gate, AtLeast)]
    votes = [f"{node_of(gate)} keeps {children}" for gate, children in keeping]
    branch = f"the branch that chooses {listing(choices)}" if choices else "the only branch"
    return f"{branch}, when {listing(votes)}" if votes else branch
