"""The comparison of participants on one tree (or a branch or kind) under one semantics.

All participants run the same test traces, also if agreement is proved. The verdict after every
prefix is compared with that of the baseline: the reference or, without it, the next participant.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, count, islice, zip_longest
from pathlib import Path
from sys import maxsize
from time import perf_counter
from typing import Final, TypeAlias, TypeVar

from cross_check.generate.assumptions import conforming
from cross_check.generate.probes import probes
from cross_check.generate.times import in_order
from cross_check.judges import (
    FLINK,
    MONA,
    MONPOLY,
    R2U2,
    VERIFIED,
    VERIMON,
    flink_of,
    mona_of,
    monpoly_of,
    r2u2_of,
    verified_of,
)
from cross_check.letters import TIMES, VARIABLES
from cross_check.participants import (
    ENGINE,
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
    leaves_open,
    reference_of,
    relied_on,
    reports_detections_only,
    translated,
)
from cross_check.product import Exploration
from cross_check.published.rml_monitor import NAME as PUBLISHED
from cross_check.published.rml_monitor import published_of
from cross_check.results import DETECTIONS_ONLY, NOTHING, Difference, Job, Result, Status, raised, reason
from cross_check.simpler_traces import plainer
from cross_check.traces import Effort, Trace, letters_of, trials
from rvaft.backend import Match
from rvaft.core.restriction import restrict
from rvaft.errors import NoVerdict, TooLarge
from rvaft.model.assumptions import first_violation
from rvaft.model.expressions import assumptions_text
from rvaft.model.nodes import Assumption, Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_finite
from rvaft.model.verdict import Semantics, Verdict
from rvaft.rules.validity import valid_part
from rvaft.semantics import matches
from rvaft.semantics.reference import chosen_scenarios
from rvaft.support.budget import Expired, Undecided, within

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
            yield MONA, partial(mona_of, part, job.semantics)
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
    valid_part(tree, branch, kind)
    roster = Roster(
        None if backends is None else tuple(backends), tuple(handwritten(one, run_c=run_c) for one in against)
    )
    results: list[Result] = []
    for one in map(Semantics, semantics or Semantics):
        job = Job(name, one, branch, None if kind is None else Kind(kind))
        results += Comparison(tree, job, effort or Effort()).run(roster.candidates(tree, job))
    return results


_SHARE: Final = 20
"""The reference may use this share of its steps for one trace."""
_BATCH: Final = 50
"""The number of traces for one answer of a participant."""
_BROKEN: Final = 5
"""One of so many traces may break the assumptions of the tree that `--against` compares with."""
_OUTSIDE: Final = 200
"""Maximum number of traces that break an assumption on which a text that a person wrote is tried."""
_REMEMBERED: Final = 300
"""Maximum number of states of a proof with a participant that remembers all events."""
_REMEMBERS: Final = "the reference remembers all events, where some have to be absent"


def _place(wanted: Sequence[Verdict], got: Sequence[Verdict]) -> int | None:
    """Return the number of events after which verdicts first differ, or None."""
    pairs = enumerate(zip(wanted, got, strict=True), 1)
    return next((number for number, (one, other) in pairs if one is not other), None)


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
    note: str = ""
    """What was compared: detections only, under which assumptions, with which times."""
    whole: tuple[Json, ...] = ()
    """The trace of the difference, before it was cut where the verdicts first differ."""
    outside_assumed: Difference | None = None
    masks: dict[str, None] = field(default_factory=dict)
    masked: int = 0
    matched: int = 0
    match: str = ""
    reason: str = ""
    detected: bool = False
    limited: str = ""
    """How many traces were compared within the steps of the reference, if not all."""
    unfinished: str = ""
    """How many traces were compared within the time limit, if not all."""
    work: int = maxsize
    """The number of steps for the traces; counted only for a reference."""

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

    @contextmanager
    def spending(self, steps: int | None = None) -> Iterator[None]:
        """Limit the steps of a reference in the block, by default to those for all traces."""
        budget = None if self.participant is None else self.participant.budget
        if budget is not None:
            budget.left = self.work if steps is None else steps
        try:
            yield
        finally:
            if budget is not None:
                budget.left = maxsize

    def answers(self, traces: Sequence[Trace]) -> Sequence[Answer] | None:
        """Return the answers for the first traces, or None on an error or without any answer.

        A trace expires that takes a reference more steps than its share, or than are left. The time
        limit ends the row. External programs time themselves.
        """
        if self.outside is not None:
            return self.attempt(partial(self.outside.answers, traces), None)
        found: list[Answer] = []
        start, left, before = perf_counter(), self.work, (self.status, self.why)
        for first in range(0, len(traces), _BATCH):
            rest = None if self.patience is None else self.patience - (perf_counter() - start)
            if rest is not None and rest <= 0:
                break
            answers = self.attempt(partial(self._answered, traces[first : first + _BATCH], left), rest)
            if answers is None and self.status is not Status.TIMEOUT:
                return None
            if answers is None:
                break
            found += answers[0]
            left = answers[1]
        done = sum(not one.expired for one in found)
        if traces and not found:
            self.end(Status.TIMEOUT, "no result within the time limit")
            return None
        if traces and not done:
            self.fail(TooLarge("steps of the reference", limit=self.work))
            return None
        self.end(*before)
        if len(found) < len(traces):
            self.unfinished = f"{done} of {len(traces)} traces within the time limit"
        elif done < len(found):
            self.limited = f"{done} of {len(traces)} traces within {self.work:,} steps of the reference"
        return found

    def aside(self, traces: Sequence[Trace]) -> Sequence[Answer]:
        """Return the answers for the first of further traces, without a mark in the result."""
        before = self.status, self.why, self.limited, self.unfinished
        found = self.answers(traces) or ()
        self.status, self.why, self.limited, self.unfinished = before
        return found

    def _answered(self, traces: Sequence[Trace], left: int) -> tuple[list[Answer], int]:
        """Return the answers, and the number of steps that are left."""
        assert self.participant is not None
        if (budget := self.participant.budget) is None:
            return [*map(Answer, self.participant.answers(traces))], left
        found: list[Answer] = []
        for trace in traces:
            given = min(left, self.work // _SHARE)
            try:
                with self.spending(given):
                    found.append(Answer(self.verdicts_of(trace)))
                    left -= given - budget.left
            except Undecided:
                found.append(Answer(expired=True))
                left -= given
        return found, left

    @property
    def detections_only(self) -> bool:
        one = self.participant or self.outside
        return one is not None and reports_detections_only(one)

    def leaves_open(self, trace: Trace) -> str:
        return leaves_open(self.participant or self.outside, self.tree, trace)

    @property
    def assumes(self) -> frozenset[Assumption]:
        """The assumptions that its text relies on."""
        return relied_on(self.participant or self.outside)

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
        length = _place(detections(wanted) if self.detections_only else wanted, got)
        if length is not None:
            self.status = Status.DIFFERS
            if self.difference is None or length < len(self.difference[0]):
                self.difference, self.whole = (tuple(trace[:length]), tuple(got[:length])), tuple(trace)

    def differing(self, baseline: "_Row", trace: Trace) -> tuple[int | None, tuple[Verdict, ...]]:
        """Return the number of events after which the verdicts on a trace differ, and its own verdicts."""
        wanted, got = baseline.verdicts_of(trace), self.verdicts_of(trace)
        return _place(detections(wanted) if self.detections_only else wanted, got), got

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

    def shorten(self, baseline: "_Row", admits: Callable[[Trace], bool] | None = None) -> None:
        """Cut the differing trace; a text that decides an event by later ones differs on it as a whole."""
        if self.difference is None or self.match:
            return
        admitted = admits or (lambda trace: not self.leaves_open(trace))
        with suppress(Exception, Expired), within(self.patience), baseline.spending(), self.spending():
            trace = self.difference[0]
            place, _ = self.differing(baseline, trace)
            if place is None:
                place, got = self.differing(baseline, trace := self.whole)
                self.difference = trace, got
                self.reason = "its verdict after an event depends on the events after it"
            position = 0
            while position < len(trace):
                fewer = trace[:position] + trace[position + 1 :]
                place, got = self.differing(baseline, fewer) if admitted(fewer) else (None, ())
                if place is None:
                    position += 1
                else:
                    self.difference = (trace := fewer), got

    def simplify(self, baseline: "_Row") -> None:
        """Give the differing trace ordinary times and values."""
        if self.difference is None or self.match:
            return
        with suppress(Exception, Expired), within(self.patience), baseline.spending(), self.spending():
            where, _ = self.differing(baseline, self.difference[0])

            def differs(trace: Trace) -> bool:
                return not self.leaves_open(trace) and self.differing(baseline, trace)[0] == where

            trace, reason = plainer(self.tree, self.difference[0], differs)
            self.reason = self.reason or reason
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
            row = _Row(name, self.tree, self.effort.seconds, work=self.effort.work or maxsize)
            match row.attempt(enlist, self.effort.seconds):
                case Absent(error):
                    row.fail(error)
                case Outside() as outside:
                    row.outside = outside
                    row.why = DETECTIONS_ONLY if outside.detections_only else "its states are unknown"
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
                row.end(Status.VACUOUS, row.limited or NOTHING)
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
        able = []
        for row, gap in zip(present, gaps, strict=True):
            assert row.participant is not None
            assumes = f"assumes {assumptions_text(row.assumes, self.tree.time)}" if row.assumes else ""
            times = f"with the tree's `{row.participant.times}`" if row.participant.times else ""
            only = DETECTIONS_ONLY if row.detections_only else ""
            row.note = "; ".join(filter(None, (only, assumes, times)))
            if only or row.assumes - row.participant.assumes:
                continue
            row.why = TIMES if self.effort.states and row.participant.timed else gap or gaps[0]
            if not row.why:
                able.append(row)
        if len(able) > 1:
            self._explore(able)

    def _explore(self, able: list[_Row]) -> None:
        participants = [row.participant for row in able if row.participant is not None]
        why, most = "", self.effort.states
        if any(one.remembers for one in participants):
            most = min(most, _REMEMBERED)
        try:
            with within(self.effort.seconds), ExitStack() as limits:
                for row in able:
                    limits.enter_context(row.spending())
                letters = letters_of((one.observed or () for one in participants), proof=True)
                found = Exploration(participants, letters, limit=most)
        except (Expired, Undecided, TooLarge) as stopped:
            match stopped:
                case Expired():
                    why = "no proof within the time limit"
                case Undecided():
                    why = f"no proof within {self.effort.work:,} steps of the reference"
                case _:
                    why = f"no letters: {reason(stopped)}"
            for row in able:
                row.why = why
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
                if why := row.leaves_open(trace):
                    row.why, row.whole = f"the proof left out a trace that differs: {why}", trace
                else:
                    row.status, row.difference, row.whole = Status.DIFFERS, (trace, row.verdicts_of(trace)), trace
            elif number and found.complete:
                row.status = Status.PROVED
            elif number:
                limited = f"state limit {most} reached" if most == self.effort.states else _REMEMBERS
                row.why = f"{able[0].name} failed" if 0 in found.failed else limited

    def _test(self) -> bool:
        baseline, *others = self._present
        rest = [*others, *self._outside]
        unproved = any(row.status is None for row in rest)
        more = any(row.status is None and not row.detections_only for row in rest)
        traces: list[Trace] = []
        untried: dict[str, str] = {}
        places: list[int] = []
        if unproved or self.effort.recheck:
            part = restrict(self.tree, branch=self.job.branch, kind=self.job.kind)
            participants = [row.participant for row in self._present if row.participant is not None]
            words = unproved and (more or self.effort.recheck)
            tested: list[list[Trace]] = [[*trials(part, self.job, self.effort, participants, words=words)]]
            for one in participants:
                if one.written and self.effort.traces:
                    seed, most = self.effort.seed, self.effort.traces
                    tried, untried[one.name] = probes(
                        part, self.job.semantics, one.written, one.known, seed=seed, most=most
                    )
                    tested.append([*tried])
            # In turn, so that the steps suffice for some of each; plainer traces are compared first.
            numbered = [[(place, one) for one in some] for place, some in enumerate(tested)]
            turns = [one for some in zip_longest(*numbered) for one in some if one is not None]
            places, traces = [place for place, _ in turns], [trace for _, trace in turns]
            if any(one.assumes for one in participants):  # most traces keep the assumptions, and have a verdict
                traces = [self._mended(rest[0], one, keeping=at % _BROKEN > 0) for at, one in enumerate(traces)]
        expected = baseline.answers(traces)
        if expected is None:
            return False
        found = [one for one in zip(places, zip(traces, expected, strict=False), strict=False) if not one[1][1].expired]
        every = [one for _, one in sorted(found, key=lambda one: one[0])]
        baseline.judge(every, [answer for _, answer in every])
        for row in rest:
            if row.status is Status.PROVED and not self.effort.recheck:
                continue
            if traces:
                self._compare(row, baseline, every)
            elif row.status is None:
                row.end(Status.COULD_NOT_RUN, "there is no trace to test")
            unfinished = row.unfinished or baseline.unfinished
            if row.status is None and unfinished:
                row.end(Status.TIMEOUT, f"not completed: {unfinished}")
            elif row.status is None:
                row.status, row.limited = Status.TESTED, row.limited or baseline.limited
                name = "" if row.participant is None else row.participant.name
                row.why = "; ".join(filter(None, (row.note, row.why, row.limited, untried.get(name, ""))))
        return True

    def _compare(self, row: _Row, baseline: _Row, every: list[tuple[Trace, Answer]]) -> None:
        json_alone = row.participant is None or row.participant.json_alone
        given = [one for one in every if not json_alone or all(map(is_finite, one[0]))]
        judged = self._decidable(row, baseline, given)
        answers = row.answers([trace for trace, _ in judged])
        if answers is not None:
            pairs = [one for one in zip(judged, answers, strict=False) if row.outside or not one[1].expired]
            row.judge([trace for trace, _ in pairs], [answer for _, answer in pairs])
        if baseline.name == REFERENCE and row.lists_matches:  # the reference could enumerate the scenarios
            row.compare_matches(self._matches(judged))
        if row.participant is not None:
            if row.participant.assumes:
                self._look_outside(row, baseline, given)
            row.shorten(baseline)
            row.simplify(baseline)

    def _look_outside(self, row: _Row, baseline: _Row, given: list[tuple[Trace, Answer]]) -> None:
        """Note a trace that breaks an assumption, and on which the text differs."""
        assert row.participant is not None
        open_ = row.participant.left_open or (lambda _: "")
        breaking = partial(first_violation, self.tree, assumptions=row.assumes)
        known = [row.whole] if row.whole and row.difference is None and breaking(row.whole) else []
        judged: list[tuple[Trace, Answer]] = [(trace, Answer(baseline.verdicts_of(trace))) for trace in known]
        judged += [*islice((one for one in given if breaking(one[0]) and not open_(one[0])), _OUTSIDE)]
        other = _Row(row.name, self.tree, self.effort.seconds, row.participant, work=row.work)
        answers = other.aside([trace for trace, _ in judged])
        pairs = [one for one in zip(judged, answers, strict=False) if not one[1].expired]
        other.judge([trace for trace, _ in pairs], [answer for _, answer in pairs])
        if other.difference is not None and not breaking(other.difference[0]):  # the assumption is broken later
            trace, _ = other.difference
            row.compare(trace, baseline.verdicts_of(trace), row.verdicts_of(trace))
            return
        other.shorten(baseline, lambda trace: breaking(trace) is not None and not open_(trace))
        if other.difference is not None and (broken := breaking(other.difference[0])) is not None:
            trace, got = other.difference
            row.outside_assumed = Difference(trace, baseline.name, baseline.verdicts_of(trace), got, reason=str(broken))

    def _decidable(self, row: _Row, baseline: _Row, every: list[tuple[Trace, Answer]]) -> list[tuple[Trace, Answer]]:
        """Return the traces with verdicts in the language; others get increasing times, or are
        masked.
        """
        open_ = [bool(row.leaves_open(trace)) for trace, _ in every]
        kept = [one for one, left in zip(every, open_, strict=True) if not left]
        mended = [self._mended(row, trace) for (trace, _), left in zip(every, open_, strict=True) if left]
        whys = [row.leaves_open(trace) for trace in mended]
        row.masks.update(dict.fromkeys(filter(None, whys)))
        row.masked += sum(map(bool, whys))
        others = [trace for trace, why in zip(mended, whys, strict=True) if not why]
        kept += zip(others, baseline.aside(others), strict=False)
        return [one for one in kept if not one[1].expired]

    def _mended(self, row: _Row, trace: Trace, *, keeping: bool = True) -> Trace:
        """Return the trace with the assumptions kept, unless not `keeping`, and, if necessary,
        increasing times.
        """
        if not row.leaves_open(trace):
            return trace
        kept = conforming(self.tree, trace, row.assumes) if row.assumes and keeping else trace
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
            expected = baseline.verdicts_of(trace)
            difference = Difference(trace, baseline.name, expected, got, row.match, row.reason)
            wanted = detections(expected) if row.detections_only else expected
            if not row.match and _place(wanted, got) is None:
                row.end(Status.COULD_NOT_RUN, "its verdicts on one trace change from one run to the next")
                difference = None
        names = ("seconds", "verdicts", "traces", "longest", "why", "masked", "matched")
        known = {name: getattr(row, name) for name in names}
        if source is not None and source.specification is not None:
            known |= {name: getattr(source.specification.metrics, name) for name in ("symbols", "states")}
        known |= {"masks": tuple(sorted(row.masks)), "detections_only": row.detections_only}
        if row.participant is not None:
            known["unknown_fields"] = row.participant.unknown
        return Result(self.job, row.name, row.status, difference=difference, outside=row.outside_assumed, **known)
