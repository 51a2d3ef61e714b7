"""A disagreement made small and kept: tree and trace are reduced together as long as the two still differ."""

from collections.abc import Sequence
from pathlib import Path

from cross_check.cases import Case, Text, case_name, save
from cross_check.participants import Absent, verdicts_of
from cross_check.results import Job, Result
from cross_check.roster import Roster
from cross_check.runs import Task
from cross_check.shrinking import shrink
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Verdict


def shrunk(task: Task, result: Result) -> Case:
    """The smallest case found in which this participant and the one it was compared with still differ.

    A text that was given beside the tree does not follow when the tree changes; then only the trace is reduced.
    """
    assert result.difference is not None
    names = result.difference.baseline, result.participant
    fixed = bool(task.roster.against)

    def disagrees(tree: RVAFT, trace: Sequence[Json]) -> bool:
        if fixed and not _same(tree, task.tree):
            return False
        found = verdicts(task.roster, tree, task.job, trace, names)
        return len(found) == len(names) and len(set(found.values())) > 1

    tree, trace = shrink(task.tree, list(result.difference.trace), disagrees)
    job = task.job
    made = [(name, enlist()) for name, enlist in task.roster.candidates(tree, job) if name in names]
    texts = {text.path: Text(text.language, text.text) for text in task.roster.against if text.path in names}
    for name, one in made:
        if not isinstance(one, Absent) and one.specification is not None:
            texts[name] = Text(one.specification.language, one.specification.text)
    return Case(
        case_name(tree, trace, job.semantics, branch=job.branch, kind=job.kind),
        tree,
        tuple(trace),
        job.semantics,
        job.branch,
        job.kind,
        {name: said for name, one in made if isinstance(said := verdicts_of(one, trace), tuple)},
        texts,
    )


def _same(one: RVAFT, other: RVAFT) -> bool:
    """Whether two trees are equal in all that has a meaning."""
    parts = [(t.root, dict(t.nodes), dict(t.events), t.ignores, t.causality) for t in (one, other)]
    return parts[0] == parts[1]


def verdicts(
    roster: Roster, tree: RVAFT, job: Job, trace: Sequence[Json], names: Sequence[str]
) -> dict[str, tuple[Verdict, ...]]:
    """What each of these participants says after every prefix; those that cannot take part are left out."""
    found: dict[str, tuple[Verdict, ...]] = {}
    for name, enlist in roster.candidates(tree, job):
        if name in names:
            said = verdicts_of(enlist(), trace)
            if isinstance(said, tuple):
                found[name] = said
    return found


def keep(task: Task, result: Result, folder: Path) -> Path:
    """Save the shrunk case of a disagreement below a folder; raises `OSError`."""
    return save(shrunk(task, result), folder)
