"""The comparison of participants on one tree (or a branch or kind) under one semantics.

All participants run the same test traces, also if agreement is proved. The verdict after every
prefix is compared with that of the baseline: the reference or, without it, the next participant.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, count, islice
from pathlib import Path
from time import perf_counter
from typing import Final, TypeAlias, TypeVar

from cross_check.generate.assumptions import conforming
from cross_check.generate.times import in_order
from cross_check.judges import FLINK, MONPOLY, R2U2, VERIFIED, VERIMON, flink_of, monpoly_of, r2u2_of, verified_of
from cross_check.letters import TIMES, VARIABLES
from cross_check.participants import (
    ENGINE,
    MONA,
    PATIENCE,
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
    reports_detections_only,
    translated,
)
from cross_check.plain import plainer
from cross_check.product import Exploration
from cross_check.published_monitor import NAME as PUBLISHED
from cross_check.published_monitor import published_of
from cross_check.results import DETECTIONS_ONLY, Difference, Job, Result, Status, raised, reason
from cross_check.traces import Effort, Trace, letters_of, trials
from rvaft.api import narrowed
from rvaft.backend import Match
from rvaft.core.branches import restrict
from rvaft.errors import NoVerdict, TooLarge
from rvaft.model.assumptions import first_violation
from rvaft.model.expressions import assumptions_text
from rvaft.model.nodes import Assumption, Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Semantics, Verdict
from rvaft.semantics import matches
from rvaft.semantics.reference import chosen_scenarios
from rvaft.support.budget import Expired, within

T = TypeVar("T")
Enlist: TypeAlias = Callable[[], Enlisted]

MATCHED: Final = 8
"""Maximum number of traces per comparison of which all matches are compared."""
TRIED: Final = 2_000
"""Maximum number of events tried to find the matches of a trace."""


@dataclass(frozen=True, slots=True)
class Roster:
    """The participants of every comparison.

    - `backends`: names; None means all faithful backends, or none with `against`.
    - `against`: specifications compared with the reference only.
    - `rml_monitor`: a checkout of the published RML monitor (`rml-published`).
    - `mona`: run `ltlf-mona`.
    - `monpoly`: the program for `mfotl-monpoly` and `mfotl-verimon`.
    - `r2u2`: a build of R2U2 in its checkout (`mtl-r2u2`).
    - `flink`: run `match-recognize-flink`.
    - `verified`: the program of the verified monitor (`verified`).
    - `patience`: seconds for an external program.
    - `run_c`: whether texts in C of saved cases may run.
    - `limit`: the size of translations, in the unit of the backend.
    """

    backends: tuple[str, ...] | None = None
    against: tuple[Handwritten, ...] = ()
    rml_monitor: Path | None = None
    mona: bool = False
    monpoly: Path | None = None
    r2u2: Path | None = None
    flink: bool = False
    verified: Path | None = None
    patience: float = PATIENCE
    limit: int | None = None
    run_c: bool = False

    def candidates(self, tree: RVAFT, job: Job) -> Iterator[tuple[str, Enlist]]:
        """Yield a unique name and a factory for each participant; the reference first."""
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
            if self.verified is not None:
                asked = partial(verified_of, tree, job.semantics, self.verified, branch=job.branch, kind=job.kind)
                yield VERIFIED, partial(asked, timeout=self.patience)
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
    run_c: bool = False,
) -> list[Result]:
    """Compare the reference, the engine and backends on a tree under some semantics (default: all).

    `backends` restricts the backends (default: all faithful ones). `against` lists specifications
    `[LANG:]FILE` to compare with the tree instead; they run in a child process, those in C only with
    `run_c`. `name` names the tree in results. Raises `OptionError`, `ToolFailed` and `LanguageError`
    for `against`, `TreeError` for an invalid tree or part.

    >>> import rvaft
    >>> [result.text for result in cross_check(rvaft.loads("top and a b;"), "projected", backends=["ltlf"])]
    ['baseline', 'proved', 'proved']
    """
    narrowed(tree, branch, kind)
    roster = Roster(
        None if backends is None else tuple(backends), tuple(handwritten(one, run_c=run_c) for one in against)
    )
    results: list[Result] = []
    for one in map(Semantics, semantics or Semantics):
        job = Job(name, one, branch, None if kind is None else Kind(kind))
        results += Comparison(tree, job, effort or Effort()).run(roster.candidates(tree, job))
    return results


_SHARE: Final = 20
"""A monitor may use this share of the time limit for one trace."""
_FIRST: Final = 8
"""The size of the first batch of traces for a program that reads whole traces."""


def _batches(traces: Sequence[Trace], size: int, *, double: bool) -> Iterator[Sequence[Trace]]:
    """Yield the traces in batches, with `double` each twice as large as the one before."""
    start = 0
    while start < len(traces):
        yield traces[start : start + size]
        start, size = start + size, size * (2 if double else 1)


@dataclass(slots=True)
class _Row:
    name: str
    tree: RVAFT
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
    reason: str = ""
    detected: bool = False
    limited: str = ""
    """How many traces were compared within the time limit, if not all."""

    def end(self, status: Status | None, why: str = "") -> None:
        self.status, self.why = status, why

    def fail(self, error: Exception) -> None:
        known = raised(error)
        self.end(Status.of(known), reason(known))

    def attempt(self, step: Callable[[], T], seconds: float | None) -> T | None:
        try:
            with within(seconds):
                return step()
        except Expired:
            self.end(Status.TIMEOUT, "no result within the time limit")
        except Exception as error:  # noqa: BLE001
            self.fail(error)
        return None

    def verdicts_of(self, trace: Trace) -> tuple[Verdict, ...]:
        assert self.participant is not None
        return self.participant.answers([trace])[0]

    def answers(self, traces: Sequence[Trace]) -> Sequence[Answer] | None:
        """Return the answers for the first traces, or None on an error.

        With a time limit, a monitor may use a share of it for one trace; other traces expire. At
        the limit, the rest is left out. External programs time themselves.
        """
        if self.outside is not None:
            return self.attempt(partial(self.outside.answers, traces), None)
        assert self.participant is not None
        if self.patience is None:
            every = self.attempt(partial(self.participant.answers, traces), None)
            return None if every is None else [*map(Answer, every)]
        found: list[Answer] = []
        start, single = perf_counter(), self.participant.first_detections is None
        for some in _batches(traces, 1 if single else _FIRST, double=not single):
            left = self.patience - (perf_counter() - start)
            if left <= 0:
                break
            share = min(left, self.patience / _SHARE) if single else left
            answers = self.attempt(partial(self.participant.answers, some), share)
            if answers is not None:
                found += map(Answer, answers)
                continue
            if self.status is not Status.TIMEOUT:
                return None
            self.end(None)
            if not single:
                break
            found.append(Answer(expired=True))
        done = sum(not one.expired for one in found)
        if traces and not done:
            self.end(Status.TIMEOUT, "no result within the time limit")
            return None
        if done < len(traces):
            self.limited = f"{done} of {len(traces)} traces within the time limit"
        return found

    @property
    def detections_only(self) -> bool:
        one = self.participant or self.outside
        return one is not None and reports_detections_only(one)

    def leaves_open(self, trace: Trace) -> str:
        if self.assumes and (broken := first_violation(self.tree, trace, self.assumes)) is not None:
            return f"it breaks the assumption '{broken.assumption}'"
        left_open = None if self.participant is None else self.participant.left_open
        return "" if left_open is None else left_open(trace)

    @property
    def assumes(self) -> frozenset[Assumption]:
        """The assumptions that its text relies on."""
        source = self.participant or self.outside
        known = None if source is None else source.specification
        return frozenset() if known is None else known.assumes

    def judge(self, judged: Sequence[tuple[Trace, Answer]], answers: Sequence[Answer]) -> None:
        for (trace, wanted), answer in zip(judged, answers, strict=True):
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
        if self.detections_only:
            wanted = detections(wanted)
        for length, (one, other) in enumerate(zip(wanted, got, strict=True), 1):
            if one is not other:
                self.status = Status.DIFFERS
                if self.difference is None or length < len(self.difference[0]):
                    self.difference = tuple(trace[:length]), tuple(got[:length])
                return

    @property
    def lists_matches(self) -> bool:
        every = None if self.participant is None or self.difference is not None else self.participant.matches
        return every is not None and self.attempt(partial(every, ()), self.patience) is not None

    def compare_matches(self, known: Sequence[tuple[Trace, frozenset[Match]]]) -> None:
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
        position = 0
        with suppress(Exception, Expired), within(self.patience):
            while self.difference is not None and position < len(trace := self.difference[0]):
                fewer = trace[:position] + trace[position + 1 :]
                if self.leaves_open(fewer):
                    position += 1
                    continue
                self.compare(fewer, baseline.verdicts_of(fewer), self.verdicts_of(fewer))
                position += len(self.difference[0]) == len(trace)

    def simplify(self, baseline: "_Row") -> None:
        """Give the differing trace ordinary times and values."""
        if self.difference is None or self.match:
            return

        def differs(trace: Trace) -> bool:
            if self.leaves_open(trace):
                return False
            wanted, got = baseline.verdicts_of(trace), self.verdicts_of(trace)
            wanted = detections(wanted) if self.detections_only else wanted
            return wanted[:-1] == got[:-1] and wanted[-1:] != got[-1:]

        with suppress(Exception, Expired), within(self.patience):
            trace, self.reason = plainer(self.tree, self.difference[0], differs)
            self.difference = trace, self.verdicts_of(trace)


@dataclass(slots=True)
class Comparison:
    """One comparison, in steps; `run` executes them all."""

    tree: RVAFT
    job: Job
    effort: Effort
    rows: list[_Row] = field(default_factory=list)

    def run(self, candidates: Iterable[tuple[str, Enlist]]) -> list[Result]:
        """Return the results; `candidates` are named before their creation, which may time out."""
        for name, enlist in candidates:
            started = perf_counter()
            row = _Row(name, self.tree, self.effort.seconds)
            match row.attempt(enlist, self.effort.seconds):
                case Absent(error):
                    row.fail(error)
                case Outside() as outside:
                    row.outside, row.why = outside, "its states are unknown"
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
                row.end(Status.VACUOUS, row.limited or "nothing was detected in any trace")
        met = any(row.status in (Status.PROVED, Status.TESTED, Status.DIFFERS, Status.VACUOUS) for row in self.rows)
        baseline = self._present[0] if met and self._present else None
        if baseline is not None:
            baseline.end(Status.BASELINE)
        return [self._result(row, baseline) for row in self.rows]

    @property
    def _present(self) -> list[_Row]:
        """Participants that can be compared, those with full verdicts first; the first is the
        baseline.
        """
        able = [row for row in self.rows if row.participant is not None and row.status in (None, Status.PROVED)]
        return sorted(able, key=lambda row: row.detections_only)

    @property
    def _outside(self) -> list[_Row]:
        return [row for row in self.rows if row.outside is not None and row.status is None]

    def _prove(self) -> None:
        """Prove what is provable; other participants get the reason why they are only tested."""
        present = self._present
        gaps = ["proofs are switched off"] * len(present)
        if self.effort.states:
            known = [row.participant.observed for row in present if row.participant is not None]
            unknown = "its observed patterns are unknown"
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
            if row.assumes:
                row.why = f"assumes {assumptions_text(row.assumes, self.tree.time)}"
            if row.detections_only:
                row.why = "; ".join(filter(None, (DETECTIONS_ONLY, row.why)))
            if row.why:
                continue
            if self.effort.states and row.participant is not None and row.participant.timed:
                row.why = TIMES
                continue
            row.why = gap or gaps[0]  # a gap of the baseline concerns all
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
            if isinstance(error := found.failed.get(number), NoVerdict):
                row.why = f"no verdict for a letter: {error}"
            elif error is not None:
                row.fail(error)
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
        every = [one for one in zip(traces, expected, strict=False) if not one[1].expired]
        expected = [answer for _, answer in every]
        baseline.judge(every, expected)
        for row in rest:
            if row.status is Status.PROVED and not self.effort.recheck:
                continue
            if traces:
                json_alone = row.participant is None or row.participant.json_alone
                judged = [one for one in every if not json_alone or all(map(is_finite, one[0]))]
                judged = self._decidable(row, baseline, judged)
                answers = row.answers([trace for trace, _ in judged])
                if answers is not None:
                    pairs = [one for one in zip(judged, answers, strict=False) if row.outside or not one[1].expired]
                    row.judge([trace for trace, _ in pairs], [answer for _, answer in pairs])
                if baseline.name == REFERENCE and row.lists_matches:  # the reference could enumerate the scenarios
                    row.compare_matches(self._matches(judged))
                if row.participant is not None:
                    row.shorten(baseline)
                    row.simplify(baseline)
            elif row.status is None:
                row.end(Status.COULD_NOT_RUN, "there is no trace to test")
            row.status, row.limited = row.status or Status.TESTED, row.limited or baseline.limited
            row.why = "; ".join(filter(None, (row.why, row.limited)))
        return True

    def _decidable(self, row: _Row, baseline: _Row, every: list[tuple[Trace, Answer]]) -> list[tuple[Trace, Answer]]:
        """Return the traces with verdicts in the language; others get increasing times, or are
        masked.
        """
        kept = [one for one in every if not row.leaves_open(one[0])]
        if len(kept) < len(every):
            others = [self._mended(row, trace) for trace, _ in every if row.leaves_open(trace)]
            whys = [why for trace in others if (why := row.leaves_open(trace))]
            row.masks.update(dict.fromkeys(whys))
            row.masked += len(whys)
            others = [trace for trace in others if not row.leaves_open(trace)]
            kept += zip(others, baseline.answers(others) or (), strict=False)
        return kept

    def _mended(self, row: _Row, trace: Trace) -> Trace:
        """Return the trace with the assumptions kept and, if necessary, increasing times."""
        kept = conforming(self.tree, trace, row.assumes) if row.assumes else trace
        return in_order(self.tree, kept) if row.leaves_open(kept) else kept

    def _matches(self, judged: Iterable[tuple[Trace, Answer]]) -> list[tuple[Trace, frozenset[Match]]]:
        found: dict[str, tuple[Trace, frozenset[Match]]] = {}
        detecting = (trace for trace, answer in judged if Verdict.TRUE in (answer.verdicts or ()))
        scenarios = chosen_scenarios(self.tree, self.job.branch, self.job.kind)
        for trace in islice(detecting, MATCHED):
            with suppress(TooLarge):
                every = matches(self.tree, self.job.semantics, trace, scenarios=scenarios, limit=TRIED)
                found[repr(trace)] = trace, every
        return [*found.values()]

    def _result(self, row: _Row, baseline: _Row | None) -> Result:
        source = row.participant or row.outside
        if row.status is None:
            row.end(Status.COULD_NOT_RUN, "there is no other participant")
        assert row.status is not None
        difference = None
        if row.difference is not None and baseline is not None:
            trace, got = row.difference
            difference = Difference(trace, baseline.name, baseline.verdicts_of(trace), got, row.match, row.reason)
        names = ("seconds", "verdicts", "traces", "longest", "why", "masked", "matched")
        known = {name: getattr(row, name) for name in names}
        if source is not None and source.specification is not None:
            known |= {name: getattr(source.specification.metrics, name) for name in ("symbols", "states")}
        known |= {"masks": tuple(sorted(row.masks)), "detections_only": row.detections_only}
        return Result(self.job, row.name, row.status, difference=difference, **known)
