"""One comparison: a tree, or a part of it, under one semantics, between everybody who takes part.

What can be proved is proved, on all traces; then everybody, proved or not, also runs the same traces, and the verdict after every
prefix is compared with that of the first participant: the reference, or where that is absent the next one.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Final

from cross_check.participants import (
    ENGINE,
    REFERENCE,
    Absent,
    Handwritten,
    Outside,
    Participant,
    engine_of,
    faithful_backends,
    mona_of,
    reference_of,
    translated,
)
from cross_check.participants import NAME as MONA
from cross_check.product import explore
from cross_check.published_monitor import NAME as PUBLISHED
from cross_check.published_monitor import published_of
from cross_check.results import Difference, Job, Result, Status
from cross_check.traces import Effort, Trace, Trials, letters_of
from rvaft.analysis.branches import restrict
from rvaft.backend import Observed
from rvaft.errors import NotExpressible, RvaftError, TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.support.budget import Expired, within

Enlist = Callable[[], Participant | Outside | Absent]


@dataclass(slots=True)
class _Row:
    """What is known of one participant so far."""

    name: str
    seconds: float
    participant: Participant | None = None
    outside: Outside | None = None
    status: Status | None = None
    why: str = ""
    verdicts: int = 0
    difference: tuple[tuple[Json, ...], tuple[Verdict, ...]] | None = None
    masked: int = 0
    masks: Counter[str] = field(default_factory=Counter)
    runs: int = 0
    longest: int = 0

    @property
    def observed(self) -> tuple[Observed, ...] | None:
        """What it asks of events, if that is known."""
        return None if self.participant is None else self.participant.observed

    def differs(self, trace: Trace, got: Sequence[Verdict]) -> None:
        """It says something else than it should; the shortest trace is kept."""
        self.status = Status.DIFFERS
        if self.difference is None or len(trace) < len(self.difference[0]):
            self.difference = tuple(trace), tuple(got)

    def fail(self, error: RvaftError) -> None:
        """It stopped with an error."""
        self.status, self.why = Status(Absent(self.name, error).status), _reason(error)


_EXPIRED: Final = "no result within the time limit"


@dataclass(slots=True)
class Comparison:
    """The steps of one comparison; `run` takes them all."""

    tree: RVAFT
    job: Job
    effort: Effort
    rows: list[_Row] = field(default_factory=list)

    def run(self, candidates: Iterable[tuple[str, Enlist]]) -> list[Result]:
        """Compare; `candidates` are named before they are made, since making one can take too long."""
        for name, enlist in candidates:
            self._enlist(name, enlist)
        if len(self._present) > 1:
            self._prove()
        while self._comparable and not self._test():
            pass
        met = any(row.status is Status.DIFFERS or (row.status and row.status.agrees) for row in self.rows)
        baseline = self._present[0] if met and self._present else None
        if baseline is not None:
            baseline.status, baseline.why = Status.BASELINE, ""
        return [self._result(row, baseline) for row in self.rows]

    def _enlist(self, name: str, enlist: Enlist) -> None:
        started = perf_counter()
        found: Participant | Outside | Absent
        try:
            with within(self.effort.seconds):
                found = enlist()
        except Exception as error:  # noqa: BLE001 (a backend of somebody else may fail in any way; that is no agreement)
            found = Absent(name, raised(error))
        except Expired:
            self.rows.append(_Row(name, perf_counter() - started, status=Status.TIMEOUT, why=_EXPIRED))
            return
        row = _Row(name, perf_counter() - started)
        if isinstance(found, Absent):
            row.fail(found.error)
        elif isinstance(found, Outside):
            row.outside = found
        else:
            row.participant = found
        self.rows.append(row)

    @property
    def _present(self) -> list[_Row]:
        """Those that can be compared; the others are compared with the first."""
        return [row for row in self.rows if row.participant is not None and row.status in (None, Status.PROVED)]

    @property
    def _comparable(self) -> bool:
        return len(self._present) + any(row.outside is not None and row.status is None for row in self.rows) > 1

    # -- proof --------------------------------------------------------------------------------------------------

    def _prove(self) -> None:
        """Prove what can be proved; the rest gets the reason why it is only tested."""
        if not self.effort.states:
            for row in self._present:
                row.why = "no proof was asked for"
            return
        present = self._present
        gaps = self._gaps(present)
        for row, gap in zip(present, gaps, strict=True):
            # whatever the others are, there is nothing to prove them against where the first has a gap
            row.why = gap or gaps[0]
        able = [row for row in present if not row.why]
        if len(able) > 1:
            self._explore(able)

    def _gaps(self, present: list[_Row]) -> list[str]:
        """For each why nothing can be proved about it; empty where something can."""
        known = [row.observed for row in present if row.observed is not None]
        unknown = "what it observes is not known"
        try:
            with within(self.effort.seconds):
                if not letters_of(known).gap:
                    return ["" if row.observed is not None else unknown for row in present]
                return [unknown if row.observed is None else letters_of([row.observed]).gap for row in present]
        except Expired:
            return ["no letters within the time limit"] * len(present)
        except TooLarge as error:
            return [f"no letters: {_reason(error)}"] * len(present)

    def _explore(self, able: list[_Row]) -> None:
        participants = [row.participant for row in able if row.participant is not None]
        try:
            with within(self.effort.seconds):
                alphabet = letters_of(row.observed or () for row in able)
                found = explore(participants, alphabet.events, limit=self.effort.states)
        except (Expired, TooLarge) as stopped:
            why = (
                "no proof within the time limit" if isinstance(stopped, Expired) else f"no letters: {_reason(stopped)}"
            )
            for row in able:
                row.why = why
            return
        for number, row in enumerate(able):
            row.verdicts += found.verdicts if number else 0
            if number in found.failed:
                row.fail(raised(found.failed[number]))
            elif number in found.differ:
                assert row.participant is not None
                row.differs(found.differ[number], list(row.participant.start().run(found.differ[number])))
            elif number and found.complete:
                row.status = Status.PROVED
            elif number:
                row.why = f"{able[0].name} failed" if 0 in found.failed else f"state limit {self.effort.states} reached"

    # -- tests --------------------------------------------------------------------------------------------------

    def _test(self) -> bool:
        """Run the traces; False where the one that the others are compared with fails."""
        baseline, *others = self._present
        outside = [row for row in self.rows if row.outside is not None]
        unproved = bool(outside) or any(row.status is None for row in others)
        traces = list(self._trials().traces(words=unproved)) if unproved or self.effort.recheck else []
        expected = self._runs(baseline, traces)
        if expected is None:
            return False
        if traces and not any(Verdict.TRUE in wanted for wanted in expected):
            for row in (*others, *outside):
                row.why = "; ".join(filter(None, [row.why, "none of them is a detection"]))
        if not traces and any(row.status is None for row in (*others, *outside)):
            for row in (*others, *outside):
                row.status = row.status or Status.COULD_NOT_RUN
                row.why = row.why if row.status is Status.PROVED else "there was no trace to try"
            return True
        for row in others:
            for trace, wanted, got in zip(traces, expected, self._runs(row, traces) or [], strict=False):
                self._compare(row, trace, wanted, got)
            self._shorten(row, baseline)
            row.status = row.status or Status.TESTED
        for row in outside:
            self._ask(row, traces, expected)
            row.status = row.status or Status.TESTED
        return True

    def _shorten(self, row: _Row, baseline: _Row) -> None:
        """Leave out the events of a difference that it does not need."""
        assert row.participant is not None
        assert baseline.participant is not None
        position = 0
        with suppress(Exception, Expired), within(self.effort.seconds):
            while row.difference is not None and position < len(row.difference[0]):
                trace = row.difference[0]
                fewer = trace[:position] + trace[position + 1 :]
                wanted = list(baseline.participant.start().run(fewer))
                before = len(trace)
                self._compare(row, fewer, wanted, list(row.participant.start().run(fewer)))
                position += len(row.difference[0]) == before

    @staticmethod
    def _compare(row: _Row, trace: Trace, wanted: list[Verdict], got: list[Verdict]) -> None:
        if wanted != got:
            length = next(i for i, (one, other) in enumerate(zip(wanted, got, strict=True), 1) if one is not other)
            row.differs(trace[:length], got[:length])

    def _ask(self, row: _Row, traces: Sequence[Trace], expected: Sequence[list[Verdict]]) -> None:
        """Compare what a program of others answers; where it is known to deviate, that is only counted."""
        assert row.outside is not None
        try:
            answers = row.outside.answers(traces)
        except RvaftError as error:
            row.fail(error)
            return
        row.why = "its states are not known"
        for trace, wanted, answer in zip(traces, expected, answers, strict=True):
            got = None if answer.verdicts is None else list(answer.verdicts)
            if got != wanted and answer.deviations and not answer.expired:
                row.masks.update(answer.deviations)
                row.masked += 1
            elif got is None:
                row.status, row.why = Status.TIMEOUT if answer.expired else Status.COULD_NOT_RUN, answer.error
                return
            else:
                self._compare(row, trace, wanted, got)
                row.runs, row.longest = row.runs + 1, max(row.longest, len(trace))
                row.verdicts += len(got)
        if not row.runs:
            row.status, row.why = Status.COULD_NOT_RUN, f"all traces are masked: {', '.join(row.masks)}"

    def _trials(self) -> Trials:
        part = restrict(self.tree, branch=self.job.branch, kind=self.job.kind)
        participants = [row.participant for row in self._present if row.participant is not None]
        return Trials(part, self.job, self.effort, participants)

    def _runs(self, row: _Row, traces: Sequence[Trace]) -> list[list[Verdict]] | None:
        """The verdicts after every prefix of every trace, or None where the participant fails."""
        assert row.participant is not None
        try:
            with within(self.effort.seconds):
                found = [list(row.participant.start().run(trace)) for trace in traces]
        except Expired:
            row.status, row.why = Status.TIMEOUT, _EXPIRED
            return None
        except Exception as error:  # noqa: BLE001 (see above)
            row.fail(raised(error))
            return None
        row.runs, row.longest = len(traces), max(map(len, traces), default=0)
        row.verdicts += sum(map(len, traces))
        return found

    # -- results ------------------------------------------------------------------------------------------------

    def _result(self, row: _Row, baseline: _Row | None) -> Result:
        source = row.participant or row.outside
        specification = None if source is None else source.specification
        metrics = None if specification is None else specification.metrics
        alone = Status.COULD_NOT_RUN, "there is nobody to compare it with"
        status, why = (row.status, row.why) if row.status is not None else alone
        return Result(
            self.job,
            row.name,
            status,
            seconds=row.seconds,
            symbols=None if metrics is None else metrics.symbols,
            states=None if metrics is None else metrics.states,
            verdicts=row.verdicts,
            traces=row.runs,
            longest=row.longest,
            why=why,
            difference=_difference(row, baseline),
            masked=row.masked,
            masks=tuple(sorted(row.masks)),
        )


def raised(error: Exception) -> RvaftError:
    """What somebody raised, as an error of this project."""
    if isinstance(error, RvaftError):
        return error
    return RvaftError(f"{type(error).__name__}: {' '.join(str(error).split())}")


def _reason(error: RvaftError) -> str:
    """Why, beside a status that says the rest."""
    match error:
        case NotExpressible():
            return error.reason
        case TooLarge():
            return f"{error.what} (limit {error.limit})"
        case _:
            return str(error).splitlines()[0]


def _difference(row: _Row, baseline: _Row | None) -> Difference | None:
    if row.difference is None or baseline is None or baseline.participant is None:
        return None
    trace, got = row.difference
    return Difference(trace, baseline.name, tuple(baseline.participant.start().run(trace)), got)


# Who is asked to take part, before anybody is made.

PATIENCE: Final = 60.0
"""Seconds for all traces of one comparison."""


@dataclass(frozen=True, slots=True)
class Roster:
    """The participants of every comparison.

    `backends` names backends; None is all faithful ones, unless there are texts to hold `against` the tree, which are then
    compared with the reference alone. `rml_monitor` is a checkout of the published RML monitor, to take part as `rml-published`, and
    with `mona` MONA takes part as `ltlf-mona`. `patience` bounds the seconds of a program of others, `limit` the
    size of a translation in the unit of the backend.
    """

    backends: tuple[str, ...] | None = None
    against: tuple[Handwritten, ...] = ()
    rml_monitor: Path | None = None
    mona: bool = False
    patience: float = PATIENCE
    limit: int | None = None

    def candidates(self, tree: RVAFT, job: Job) -> Iterator[tuple[str, Enlist]]:
        """The name of each participant, every name once, and what makes it; the reference first."""
        taken: set[str] = set()
        for name, enlist in self._candidates(tree, job):
            number = 1
            while (unique := name if number == 1 else f"{name} ({number})") in taken:
                number += 1
            taken.add(unique)
            yield unique, enlist

    def _candidates(self, tree: RVAFT, job: Job) -> Iterator[tuple[str, Enlist]]:
        part = restrict(tree, branch=job.branch, kind=job.kind)
        yield REFERENCE, partial(reference_of, tree, job.semantics, branch=job.branch, kind=job.kind)
        names = self.backends
        if names is None:
            names = () if self.against else faithful_backends()
        if not self.against:
            yield ENGINE, partial(engine_of, part, job.semantics)
        for name in names:
            yield name, partial(translated, name, part, job.semantics, limit=self.limit)
        if self.rml_monitor is not None:
            checkout, seconds = self.rml_monitor, self.patience
            yield PUBLISHED, partial(published_of, part, job.semantics, checkout, timeout=seconds)
        if self.mona:
            yield MONA, partial(mona_of, part, job.semantics)
        for text in self.against:
            yield text.path, partial(text.enlist, tree, job.semantics)
