"""What a comparison says of each participant. Its words are never blurred: proved is not tested, and neither is absence."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from enum import StrEnum

from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing
from rvaft.model.nodes import Kind
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict


class Status(StrEnum):
    """How it ended for one participant."""

    BASELINE = "baseline"
    """The others are compared with it."""
    PROVED = "proved"
    """It agrees with the first participant on all traces."""
    TESTED = "tested"
    """It agrees on the traces that were tried."""
    DIFFERS = "differs"
    NOT_EXPRESSIBLE = "not expressible"
    TOO_LARGE = "too large"
    TIMEOUT = "timeout"
    TOOL_MISSING = "tool missing"
    COULD_NOT_RUN = "could not run"

    @classmethod
    def of(cls, error: RvaftError) -> "Status":
        """What an error comes to for the one whom it kept from taking part; never agreement."""
        match error:
            case NotExpressible():
                return cls.NOT_EXPRESSIBLE
            case TooLarge():
                return cls.TOO_LARGE
            case ToolMissing():
                return cls.TOOL_MISSING
            case _:
                return cls.COULD_NOT_RUN

    @property
    def agrees(self) -> bool:
        """Whether verdicts were compared and all were equal."""
        return self in (Status.PROVED, Status.TESTED)


@dataclass(frozen=True, slots=True)
class Difference:
    """A trace on which a participant and the first one give different verdicts, and what each says after every prefix."""

    trace: tuple[Json, ...]
    baseline: str
    expected: tuple[Verdict, ...]
    got: tuple[Verdict, ...]


@dataclass(frozen=True, slots=True)
class Job:
    """What is compared: a tree or a part of it under one semantics. `name` says which tree in reports."""

    name: str
    semantics: Semantics
    branch: int | None = None
    kind: Kind | None = None

    @property
    def title(self) -> str:
        """The name, with the part."""
        if self.branch is not None:
            return f"{self.name} branch {self.branch}"
        return self.name if self.kind is None else f"{self.name} {self.kind}s"


@dataclass(frozen=True, slots=True)
class Result:
    """One participant in one comparison.

    `seconds` is the time of the translation and the first reading, `verdicts` how many were compared, `symbols` and `states` the
    sizes of its text. `why` explains what is neither proved nor tested, or why it is only tested. `masked` counts traces
    on which it differs as its tool is known to, `masks` says in which ways.
    """

    job: Job
    participant: str
    status: Status
    seconds: float = 0.0
    symbols: int | None = None
    states: int | None = None
    verdicts: int = 0
    traces: int = 0
    longest: int = 0
    why: str = ""
    difference: Difference | None = None
    masked: int = 0
    masks: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The result in one line."""
        match self.status:
            case Status.PROVED | Status.BASELINE:
                return str(self.status)
            case Status.TESTED:
                because = f" ({self.why})" if self.why else ""
                masked = f", {self.masked} masked ({', '.join(self.masks)})" if self.masked else ""
                traces = "trace" if self.traces == 1 else "traces"
                return f"tested: {self.traces} {traces} up to length {self.longest}{masked}{because}"
            case Status.DIFFERS:
                length = len(self.difference.trace) if self.difference is not None else 0
                return f"differs after {length} event{'' if length == 1 else 's'}"
            case _:
                return f"{self.status}: {self.why}" if self.why else str(self.status)


def exit_status(results: Iterable[Result], *, failing: Collection[Status] = ()) -> int:
    """0 where all that ran agree, 1 where some differ, 2 where something could not run or nothing was compared; 2 wins.

    `failing` has further statuses that count as what could not run.
    """
    every = list(results)
    failed = {Status.COULD_NOT_RUN, Status.TOOL_MISSING, *failing}
    compared = {result.job for result in every if result.status.agrees or result.status is Status.DIFFERS}
    if any(result.status in failed or result.job not in compared for result in every):
        return 2
    return 1 if any(result.status is Status.DIFFERS for result in every) else 0
