"""What is known of one cell."""

from dataclasses import dataclass, replace
from enum import StrEnum
from importlib.metadata import version
from typing import Self

from rvaft.comparison.plan import Cell, Settings
from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing
from rvaft.model import Gate
from rvaft.verdict import Semantics


class Outcome(StrEnum):
    """How it ended. These words are never blurred: what a language cannot say is not what was too much, or took too long."""

    OK = "ok"
    NOT_EXPRESSIBLE = "not expressible"
    """The language cannot say the tree under this semantics."""
    TOO_LARGE = "too large"
    """It could, but not within the limit, or not in the memory."""
    TIMEOUT = "timeout"
    """The time for the cell was up."""
    TOOL_MISSING = "tool missing"
    FAILED = "could not run"

    @property
    def broken(self) -> bool:
        """Whether it says nothing about the language, only about what is installed here."""
        return self in (Outcome.TOOL_MISSING, Outcome.FAILED)


def outcome_of(error: Exception) -> tuple[Outcome, str]:
    """What an error of a backend means, and why, in one line."""
    match error:
        case NotExpressible():
            return Outcome.NOT_EXPRESSIBLE, error.reason
        case TooLarge():
            return Outcome.TOO_LARGE, f"{error.what} (limit {error.limit})"
        case ToolMissing():
            return Outcome.TOOL_MISSING, str(error)
        case RvaftError():
            return Outcome.FAILED, str(error).splitlines()[0]
        case _:
            return Outcome.FAILED, " ".join(f"{type(error).__name__}: {error}".split())


@dataclass(frozen=True, slots=True)
class Row:
    """One cell and what was measured; the columns of the CSV file are these fields.

    `tree` is a gate with its children (`and 3`, `vot 2/3`) or the path of a tree; `gate`, `children` and `threshold` are those of a
    gate over leaves. `result` says how the translation ended, and `reason` why; it is None while that is not over. The sizes are those
    of `Metrics`; `characters` is the length of the text, header and all; `seconds` the median time of a translation.

    `run` and `run_reason` say the same of reading the text and running events by the language's own reader: `read_seconds` is the time to
    read it, `events` how many were run, in `walks` traces, and `differing` how many of the traces got other verdicts than the tree demands.
    `events_per_second` is the speed of readers that have met nothing: each reads the text and runs one trace, in a process of its own, and
    `first_events` is how many events these are, of some of the traces. `again_per_second` is the median speed when one reader runs all the traces
    again and knows them.
    """

    tree: str
    gate: Gate | None
    children: int | None
    threshold: int | None
    semantics: Semantics
    language: str
    result: Outcome | None = None
    reason: str = ""
    symbols: int | None = None
    subformulas: int | None = None
    states: int | None = None
    edges: int | None = None
    characters: int | None = None
    seconds: float | None = None
    run: Outcome | None = None
    run_reason: str = ""
    read_seconds: float | None = None
    events: int | None = None
    events_per_second: float | None = None
    again_per_second: float | None = None
    walks: int | None = None
    differing: int | None = None
    limit: int | None = None
    timeout: float = 0.0
    seed: int = 0
    digest: str = ""
    version: str = ""
    first_events: int | None = None
    memory: int | None = None

    @property
    def key(self) -> tuple[object, ...]:
        """What two measurements share that may stand for each other, but for the time and memory that they may take."""
        named = (self.tree, self.digest, self.semantics, self.language)
        return (*named, self.limit, self.seed, self.version)

    @property
    def over(self) -> bool:
        """Whether there is nothing left to measure."""
        return self.result is not None and (self.result is not Outcome.OK or self.run is not None)

    def ended(self, outcome: Outcome, reason: str) -> Self:
        """The row where what was under way ended like this."""
        reason = " ".join(reason.split())
        if self.result is None:
            return replace(self, result=outcome, reason=reason)
        return self if self.over else replace(self, run=outcome, run_reason=reason)

    def serves(self, wanted: "Row") -> bool:
        """Whether this row answers for another of the same key: nothing was missing, neither tools nor what the other has more of."""
        ends = [outcome for outcome in (self.result, self.run) if outcome is not None]
        if self.key != wanted.key or not self.over or any(outcome.broken for outcome in ends):
            return False
        if self.memory is None or (Outcome.OK in ends[1:] and self.first_events is None):
            return False  # of a file that lacks columns
        late = Outcome.TIMEOUT in ends and self.timeout < wanted.timeout
        large = Outcome.TOO_LARGE in ends and self.memory < (wanted.memory or 0)
        return not (late or large)


def empty_row(cell: Cell, settings: Settings) -> Row:
    """The row of a cell before anything is measured."""
    subject = cell.subject
    return Row(
        subject.name,
        subject.gate,
        subject.children,
        subject.threshold,
        cell.semantics,
        cell.language,
        limit=settings.limit,
        timeout=settings.timeout,
        seed=settings.seed,
        digest=subject.digest,
        version=version("rvaft"),
        memory=settings.memory,
    )
