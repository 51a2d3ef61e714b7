"""Saved cases run again."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from cross_check.against import Handwritten
from cross_check.cases import Case
from cross_check.participants import REFERENCE, Absent, verdicts_of
from cross_check.results import Difference, Job, Result, Status
from cross_check.roster import Roster
from rvaft.backend import all_backends
from rvaft.errors import RvaftError
from rvaft.verdict import Verdict


@dataclass(frozen=True, slots=True)
class Replay:
    """What one participant of a case says now; `before` is what it said when the case was saved, if it did."""

    result: Result
    before: tuple[Verdict, ...] | None
    now: tuple[Verdict, ...] | None


def asked(case: Case, roster: Roster) -> Roster:
    """The roster, with those that took part when the case was saved: backends, and texts that are kept with it."""
    named = tuple(name for name in case.verdicts if name in all_backends())
    kept = (Handwritten(name, text.language, text.text) for name, text in case.specifications.items())
    against = tuple(text for text in kept if text.path not in all_backends())
    if roster.backends is None and (named or against):
        roster = replace(roster, backends=named)
    return replace(roster, against=(*roster.against, *against))


def replay(case: Case, roster: Roster) -> Iterator[Replay]:
    """What the participants say on the trace of a case: those of the roster, and those that the case has verdicts of."""
    job = Job(case.name, case.semantics, case.branch, case.kind)
    baseline: tuple[Verdict, ...] | None = None
    for name, enlist in asked(case, roster).candidates(case.tree, job):
        found = verdicts_of(enlist(), case.trace)
        if isinstance(found, RvaftError):
            status = Status(Absent(name, found).status)
            yield Replay(Result(job, name, status, why=str(found)), case.verdicts.get(name), None)
            continue
        status = Status.BASELINE if baseline is None else Status.TESTED if found == baseline else Status.DIFFERS
        baseline = found if baseline is None else baseline
        difference = Difference(case.trace, REFERENCE, baseline, found) if status is Status.DIFFERS else None
        length = len(found)
        result = Result(job, name, status, verdicts=length, traces=1, longest=length, difference=difference)
        yield Replay(result, case.verdicts.get(name), found)
