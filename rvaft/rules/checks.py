"""Running the rules: on a draft, on a tree, and the check that everything else relies on."""

from collections.abc import Iterable
from typing import Any
from weakref import WeakKeyDictionary

from rvaft.analysis.scenarios import ScenarioSpace
from rvaft.errors import TreeError
from rvaft.language.draft import Draft
from rvaft.model.tree import RVAFT
from rvaft.rules.registry import DRAFT_RULES, TREE_RULES, UNDECIDED
from rvaft.rules.rule import Finding, Report, Rule, Severity
from rvaft.support.budget import DEFAULT_LIMIT, Undecided


def check(draft: Draft, *, limit: int = DEFAULT_LIMIT) -> list[Finding]:
    """All findings on a draft, in the order of their places; the rules about scenarios are asked only where it is a tree."""
    found = check_draft(draft)
    if not any(finding.severity is Severity.ERROR for finding in found):
        found = _sorted(found + check_tree(draft.build(), limit=limit))
    return found


def check_draft(draft: Draft) -> list[Finding]:
    """The findings on the structure of a draft; without errors among them, `draft.build()` succeeds."""
    return _sorted(finding for rule in DRAFT_RULES for finding in _findings(rule, draft))


def check_tree(tree: RVAFT, *, limit: int = DEFAULT_LIMIT) -> list[Finding]:
    """The findings on a tree and its scenarios; each rule may spend `limit` steps before it says `undecided`."""
    space = ScenarioSpace(tree, limit)
    return _sorted(finding for rule in TREE_RULES for finding in _findings(rule, space))


_checked: "WeakKeyDictionary[_Identity, TreeError | None]" = WeakKeyDictionary()
_Identity = RVAFT


def require_valid(tree: RVAFT) -> None:
    """Raise `TreeError` for the first error that `check_tree` finds; warnings are no matter. Remembered per tree."""
    if tree not in _checked:
        _checked[tree] = _first_error(tree)
    error = _checked[tree]
    if error is not None:
        raise TreeError(error.message, rule=error.rule, nodes=error.nodes)


def _first_error(tree: RVAFT) -> TreeError | None:
    space = ScenarioSpace(tree)
    for rule in TREE_RULES:
        if rule.severity is Severity.ERROR:
            for finding in _findings(rule, space):
                if finding.code == rule.code:
                    return TreeError(finding.message, rule=finding.code, nodes=finding.nodes)
    return None


def _findings(rule: Rule, subject: Any) -> list[Finding]:
    found: list[Finding] = []
    try:
        for report in rule.check(subject):
            found.append((UNDECIDED if report.undecided else rule).finding(report))  # noqa: PERF401  (what came before is kept)
    except Undecided:
        root = subject.tree.nodes[subject.tree.root]
        message = (
            f"{rule.code} was not decided within {subject.limit} steps; share fewer nodes, or check parts of the tree"
        )
        found.append(UNDECIDED.finding(Report(root.place(), message, (root.name,))))
    return found


def _sorted(findings: Iterable[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: (finding.place, finding.severity, finding.code))
