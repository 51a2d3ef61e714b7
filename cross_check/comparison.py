"""One comparison: a tree, or a part of it, under one semantics, between everybody who takes part.

What can be proved is proved, on all traces; then everybody, proved or not, also runs the same
traces, and the verdict after every prefix is compared with that of the first participant: the
reference, or where that is absent the next one. Where neither detects anything in any trace, equal
verdicts say nothing: that is vacuous, and no agreement.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, count, islice
from pathlib import Path
from time import perf_counter
from typing import Final, TypeAlias, TypeVar

from cross_check.generate.times import in_order
from cross_check.judges import FLINK, MONPOLY, R2U2, VERIMON, flink_of, monpoly_of, r2u2_of
from cross_check.letters import TIMES, VARIABLES
from cross_check.participants import (
    ENGINE,
    MONA,
    REFERENCE,
    Absent,
    Answer,
    Enlisted,
    Handwritten,
    Outside,
    Participant,
    detections,
    engine_of,
    faithful_backends,
    handwritten,
    reference_of,
    tells_detections_only,
    translated,
)
from cross_check.product import Exploration
from cross_check.published_monitor import NAME as PUBLISHED
from cross_check.published_monitor import published_of
from cross_check.results import DETECTIONS_ONLY, Difference, Job, Result, Status, raised, reason
from cross_check.traces import Effort, Trace, letters_of, trials
from rvaft.api import narrowed
from rvaft.backend import Match
from rvaft.core.branches import restrict
from rvaft.errors import TooLarge
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Semantics, Verdict
from rvaft.semantics import matches
from rvaft.semantics.reference import chosen_scenarios
from rvaft.support.budget import Expired, within

T = TypeVar("T")
Enlist: TypeAlias = Callable[[], Enlisted]

MATCHED: Final = 8
"""Of so many traces of a comparison with a detection all matches are compared, at the most."""
TRIED: Final = 2_000
"""So many events are tried for the matches of one of them."""
PATIENCE: Final = 60.0
"""Seconds for all traces of one comparison."""


@dataclass(frozen=True, slots=True)
class Roster:
    """The participants of every comparison.

    `backends` names backends; None is all faithful ones, unless there are texts to hold `against`
    the tree, which are then compared with the reference alone. `rml_monitor` is a checkout of the
    published RML monitor, to take part as `rml-published`, and with `mona` MONA takes part as
    `ltlf-mona`. `monpoly` is the program MonPoly, to take part with its verified kernel as
    `mfotl-monpoly` and `mfotl-verimon`; `r2u2` is a build of R2U2 in its checkout, to take part as
    `mtl-r2u2`; with `flink` Apache Flink takes part as `match-recognize-flink`. `patience` bounds
    the seconds of a program of others, `limit` the size of a translation in the unit of the
    backend.
    """

    backends: tuple[str, ...] | None = None
    against: tuple[Handwritten, ...] = ()
    rml_monitor: Path | None = None
    mona: bool = False
    monpoly: Path | None = None
    r2u2: Path | None = None
    flink: bool = False
    patience: float = PATIENCE
    limit: int | None = None

    def candidates(self, tree: RVAFT, job: Job) -> Iterator[tuple[str, Enlist]]:
        """The name of each participant, every name once, and what makes it; the reference first."""
        taken: set[str] = set()
        for name, enlist in self._candidates(tree, job):
            names = chain([name], (f"{name} ({number})" for number in count(2)))
            taken.add(unique := next(one for one in names if one not in taken))
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
            yield PUBLISHED, partial(published_of, part, job.semantics, self.rml_monitor, timeout=self.patience)
        for name in (MONPOLY, VERIMON) if self.monpoly is not None else ():
            assert self.monpoly is not None
            yield name, partial(monpoly_of, part, job.semantics, self.monpoly, name, timeout=self.patience)
        if self.r2u2 is not None:
            yield R2U2, partial(r2u2_of, part, job.semantics, self.r2u2, timeout=self.patience)
        if self.flink:
            yield FLINK, partial(flink_of, part, job.semantics)
        if self.mona:
            yield MONA, partial(translated, "ltlf", part, job.semantics, tool="mona")
        for text in self.against:
            yield text.path, partial(text.enlist, tree, job.semantics)


def cross_check(
    tree: RVAFT,
    *semantics: Semantics | str,
    backends: Iterable[str] | None = None,
    against: Iterable[str] = (),
    branch: int | None = None,
    kind: Kind | str | None = None,
    name: str = "tree",
    effort: Effort | None = None,
) -> list[Result]:
    """Compare the reference, the engine and backends on a tree or a part of it, under these
    semantics or, without any, under all.

    `backends` names some, else all faithful ones take part; `against` has specifications to hold
    against the tree instead, each as `[LANG:]FILE`. One result says how it ended for one
    participant under one semantics; `name` is what the tree is called there. Raises `OptionError`
    and `LanguageError` for `against`, `TreeError` for a tree that breaks a rule or has no such
    part.

    >>> import rvaft
    >>> [result.text for result in cross_check(rvaft.loads("top and a b;"), "projected", backends=["ltlf"])]
    ['baseline', 'proved', 'proved']
    """
    narrowed(tree, branch, kind)
    roster = Roster(None if backends is None else tuple(backends), tuple(map(handwritten, against)))
    results: list[Result] = []
    for one in map(Semantics, semantics or Semantics):
        job = Job(name, one, branch, None if kind is None else Kind(kind))
        results += Comparison(tree, job, effort or Effort()).run(roster.candidates(tree, job))
    return results


@dataclass(slots=True)
class _Row:
    """What is known of one participant so far."""

    name: str
    patience: float | None
    participant: Participant | None = None
    outside: Outside | None = None
    seconds: float = 0.0
    status: Status | None = None
    why: str = ""
    verdicts: int = 0
    traces: int = 0
    longest: int = 0
    difference: tuple[tuple[Json, ...], tuple[Verdict, ...]] | None = None
    masks: dict[str, None] = field(default_factory=dict)
    masked: int = 0
    matched: int = 0
    match: str = ""
    detected: bool = False
    """Whether this participant, or the one it is compared with, detected something in a trace that both were asked."""

    def end(self, status: Status, why: str = "") -> None:
        """Nothing more is asked of it, for that reason."""
        self.status, self.why = status, why

    def fail(self, error: Exception) -> None:
        """It stopped with an error, that of somebody else perhaps."""
        known = raised(error)
        self.end(Status.of(known), reason(known))

    def attempt(self, step: Callable[[], T], seconds: float | None) -> T | None:
        """What a step of it comes to, or None where it fails or takes too long."""
        try:
            with within(seconds):
                return step()
        except Expired:
            self.end(Status.TIMEOUT, "no result within the time limit")
        except Exception as error:  # noqa: BLE001
            self.fail(error)
        return None

    def verdicts_of(self, trace: Trace) -> tuple[Verdict, ...]:
        """What it says after every prefix."""
        assert self.participant is not None
        return self.participant.answers([trace])[0]

    def answers(self, traces: Sequence[Trace]) -> Sequence[Answer] | None:
        """What it says of every trace, or None where it fails; a program of others counts its seconds itself."""
        if self.outside is not None:
            return self.attempt(partial(self.outside.answers, traces), None)
        assert self.participant is not None
        asked = partial(self.participant.answers, traces)
        said = self.attempt(asked, self.patience)
        return None if said is None else [*map(Answer, said)]

    @property
    def detections_only(self) -> bool:
        """Whether it tells detections alone."""
        one = self.participant or self.outside
        return one is not None and tells_detections_only(one)

    def leaves_open(self, trace: Trace) -> str:
        """Why its language tells nothing of a trace, if that is so."""
        left_open = None if self.participant is None else self.participant.left_open
        return "" if left_open is None else left_open(trace)

    def judge(self, asked: Sequence[tuple[Trace, Answer]], answers: Sequence[Answer]) -> None:
        """Look at what it says of the traces; where a program is known to deviate, that is only counted."""
        for (trace, wanted), answer in zip(asked, answers, strict=True):
            if answer.verdicts != wanted.verdicts and answer.deviations and not answer.expired:
                self.masks.update(dict.fromkeys(answer.deviations))
                self.masked += 1
            elif answer.verdicts is None:
                return self.end(Status.TIMEOUT if answer.expired else Status.COULD_NOT_RUN, answer.error)
            else:
                self.traces, self.longest = self.traces + 1, max(self.longest, len(trace))
                self.verdicts += len(trace)
                self.detected |= Verdict.TRUE in (*(wanted.verdicts or ()), *answer.verdicts)
                self.compare(trace, wanted.verdicts or (), answer.verdicts)
        if self.masked and not self.traces:
            self.end(Status.COULD_NOT_RUN, f"all traces are masked: {', '.join(self.masks)}")
        return None

    def compare(self, trace: Trace, wanted: Sequence[Verdict], got: Sequence[Verdict]) -> None:
        """The shortest trace on which it says something else is kept."""
        if self.detections_only:
            wanted = detections(wanted)
        for length, (one, other) in enumerate(zip(wanted, got, strict=True), 1):
            if one is not other:
                self.status = Status.DIFFERS
                if self.difference is None or length < len(self.difference[0]):
                    self.difference = tuple(trace[:length]), tuple(got[:length])
                return

    @property
    def tells_matches(self) -> bool:
        """Whether all its matches can be compared: it knows them, and no verdict differs."""
        every = None if self.participant is None or self.difference is not None else self.participant.matches
        return every is not None and self.attempt(partial(every, ()), self.patience) is not None

    def compare_matches(self, known: Sequence[tuple[Trace, frozenset[Match]]]) -> None:
        """All matches of traces; of those that differ the first one that is missing or too many is kept."""
        assert self.participant is not None
        assert self.participant.matches is not None
        traces = [trace for trace, _ in known]
        found = self.attempt(partial(self.participant.matches, traces), self.patience) or ()
        for (trace, wanted), got in zip(known, found, strict=bool(found)):
            self.matched += 1
            if differing := sorted(sorted(match, key=lambda pair: pair[1]) for match in wanted ^ got):
                what = "missing" if frozenset(differing[0]) in wanted else "too many"
                self.match = f"a match is {what}: {', '.join(f'{name} {number}' for name, number in differing[0])}"
                self.status, self.difference = Status.DIFFERS, (tuple(trace), self.verdicts_of(trace))
                return

    def shorten(self, baseline: "_Row") -> None:
        """Leave out the events of a difference that it does not need."""
        position = 0
        with suppress(Exception, Expired), within(self.patience):
            while self.difference is not None and position < len(trace := self.difference[0]):
                fewer = trace[:position] + trace[position + 1 :]
                self.compare(fewer, baseline.verdicts_of(fewer), self.verdicts_of(fewer))
                position += len(self.difference[0]) == len(trace)


@dataclass(slots=True)
class Comparison:
    """One comparison, in steps; `run` takes them all."""

    tree: RVAFT
    job: Job
    effort: Effort
    rows: list[_Row] = field(default_factory=list)

    def run(self, candidates: Iterable[tuple[str, Enlist]]) -> list[Result]:
        """Compare; `candidates` are named before they are made, since making one can take too long."""
        for name, enlist in candidates:
            started = perf_counter()
            row = _Row(name, self.effort.seconds)
            match row.attempt(enlist, self.effort.seconds):
                case Absent(error):
                    row.fail(error)
                case Outside() as outside:
                    row.outside, row.why = outside, "its states are not known"
                    if outside.detections_only:
                        row.why = DETECTIONS_ONLY
                case participant:
                    row.participant = participant
            row.seconds = perf_counter() - started
            self.rows.append(row)
        if len(self._present) > 1:
            self._prove()
        while len(self._present) + len(self._outside) > 1 and not self._test():
            pass
        for row in self.rows:
            if row.status is not None and row.status.agrees and not row.detected:
                row.end(Status.VACUOUS, "nothing was detected in any trace")
        met = any(row.status in (Status.PROVED, Status.TESTED, Status.DIFFERS, Status.VACUOUS) for row in self.rows)
        baseline = self._present[0] if met and self._present else None
        if baseline is not None:
            baseline.end(Status.BASELINE)
        return [self._result(row, baseline) for row in self.rows]

    @property
    def _present(self) -> list[_Row]:
        """Those that can be compared; the others are compared with the first, which tells more than
        detections if any does.
        """
        able = [row for row in self.rows if row.participant is not None and row.status in (None, Status.PROVED)]
        return sorted(able, key=lambda row: row.detections_only)

    @property
    def _outside(self) -> list[_Row]:
        return [row for row in self.rows if row.outside is not None and row.status is None]

    def _prove(self) -> None:
        """Prove what can be proved; the rest gets the reason why it is only tested."""
        present = self._present
        gaps = ["no proof was asked for"] * len(present)
        if self.effort.states:
            known = [row.participant.observed for row in present if row.participant is not None]
            unknown = "what it observes is not known"
            try:
                with within(self.effort.seconds):
                    every = letters_of((one for one in known if one is not None), proof=True).gap == ""
                    gaps = ["" if every else letters_of([one or ()], proof=True).gap for one in known]
                gaps = [unknown if one is None else gap for one, gap in zip(known, gaps, strict=True)]
            except Expired:
                gaps = ["no letters within the time limit"] * len(present)
            except TooLarge as error:
                gaps = [f"no letters: {reason(error)}"] * len(present)
        for row, gap in zip(present, gaps, strict=True):
            if row.detections_only:
                row.why = DETECTIONS_ONLY
                continue
            if self.effort.states and row.participant is not None and row.participant.timed:
                row.why = TIMES
                continue
            row.why = gap or gaps[0]  # whatever the others are, there is nothing to prove where the first has a gap
        able = [row for row in present if not row.why]
        if len(able) > 1:
            self._explore(able)

    def _explore(self, able: list[_Row]) -> None:
        participants = [row.participant for row in able if row.participant is not None]
        try:
            with within(self.effort.seconds):
                letters = letters_of((one.observed or () for one in participants), proof=True)
                found = Exploration(participants, letters, limit=self.effort.states)
        except (Expired, TooLarge) as stopped:
            late = isinstance(stopped, Expired)
            for row in able:
                row.why = "no proof within the time limit" if late else f"no letters: {reason(stopped)}"
            return
        for number, row in enumerate(able):
            row.verdicts += found.verdicts if number else 0
            row.detected = number in found.detected
            if number in found.failed:
                row.fail(found.failed[number])
            elif number in found.tied or (number and 0 in found.tied):
                row.why = VARIABLES
            elif number in found.differ:
                trace = found.differ[number]
                row.status, row.difference = Status.DIFFERS, (trace, row.verdicts_of(trace))
            elif number and found.complete:
                row.status = Status.PROVED
            elif number:
                row.why = f"{able[0].name} failed" if 0 in found.failed else f"state limit {self.effort.states} reached"

    def _test(self) -> bool:
        """Run the traces; False where the one that the others are compared with fails."""
        baseline, *others = self._present
        rest = [*others, *self._outside]
        unproved = any(row.status is None for row in rest)
        more = any(row.status is None and not row.detections_only for row in rest)
        traces: list[Trace] = []
        if unproved or self.effort.recheck:
            part = restrict(self.tree, branch=self.job.branch, kind=self.job.kind)
            participants = [row.participant for row in self._present if row.participant is not None]
            traces = list(
                trials(part, self.job, self.effort, participants, words=unproved and (more or self.effort.recheck))
            )
        expected = baseline.answers(traces)
        if expected is None:
            return False
        every = [*zip(traces, expected, strict=True)]
        baseline.judge(every, expected)
        for row in rest:
            if row.status is Status.PROVED and not self.effort.recheck:
                continue
            if traces:
                json_alone = row.participant is None or row.participant.json_alone
                asked = [one for one in every if not json_alone or all(map(is_finite, one[0]))]
                asked = self._told(row, baseline, asked)
                answers = row.answers([trace for trace, _ in asked])
                if answers is not None:
                    row.judge(asked, answers)
                if baseline.name == REFERENCE and row.tells_matches:  # there are not too many scenarios to try
                    row.compare_matches(self._matches(asked))
                if row.participant is not None:
                    row.shorten(baseline)
            elif row.status is None:
                row.end(Status.COULD_NOT_RUN, "there was no trace to try")
            row.status = row.status or Status.TESTED
        return True

    def _told(self, row: _Row, baseline: _Row, asked: list[tuple[Trace, Answer]]) -> list[tuple[Trace, Answer]]:
        """The traces of which the language of a participant tells something, others at times that increase.

        What is left is counted.
        """
        told = [one for one in asked if not row.leaves_open(one[0])]
        if len(told) < len(asked):
            others = [in_order(self.tree, trace) for trace, _ in asked if row.leaves_open(trace)]
            whys = [why for trace in others if (why := row.leaves_open(trace))]
            row.masks.update(dict.fromkeys(whys))
            row.masked += len(whys)
            others = [trace for trace in others if not row.leaves_open(trace)]
            told += zip(others, baseline.answers(others) or (), strict=False)
        return told

    def _matches(self, asked: Iterable[tuple[Trace, Answer]]) -> list[tuple[Trace, frozenset[Match]]]:
        """All matches of some traces that are detections, where these are few."""
        found: dict[str, tuple[Trace, frozenset[Match]]] = {}
        detecting = (trace for trace, answer in asked if Verdict.TRUE in (answer.verdicts or ()))
        scenarios = chosen_scenarios(self.tree, self.job.branch, self.job.kind)
        for trace in islice(detecting, MATCHED):
            with suppress(TooLarge):
                every = matches(self.tree, self.job.semantics, trace, scenarios=scenarios, limit=TRIED)
                found[repr(trace)] = trace, every
        return [*found.values()]

    def _result(self, row: _Row, baseline: _Row | None) -> Result:
        source = row.participant or row.outside
        if row.status is None:
            row.end(Status.COULD_NOT_RUN, "there is nobody to compare it with")
        assert row.status is not None
        difference = None
        if row.difference is not None and baseline is not None:
            trace, got = row.difference
            difference = Difference(trace, baseline.name, baseline.verdicts_of(trace), got, row.match)
        names = ("seconds", "verdicts", "traces", "longest", "why", "masked", "matched")
        known = {name: getattr(row, name) for name in names}
        if source is not None and source.specification is not None:
            known |= {name: getattr(source.specification.metrics, name) for name in ("symbols", "states")}
        known |= {"masks": tuple(sorted(row.masks)), "detections_only": row.detections_only}
        return Result(self.job, row.name, row.status, difference=difference, **known)
