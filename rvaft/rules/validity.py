"""What a valid tree satisfies, the rules whose findings are errors; and valid trees from texts and files."""

import os
from collections.abc import Iterable
from operator import attrgetter
from typing import Any, Final, Unpack
from weakref import WeakKeyDictionary

from rvaft.core.feasibility import ScenarioSpace
from rvaft.core.restriction import alternatives, restrict
from rvaft.errors import TreeError, expect, one_of
from rvaft.language.draft import Draft
from rvaft.language.parser import TreeOptions, parse, parse_file
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.rules import absences, scenarios, structure, times
from rvaft.rules.rule import Finding, Rule, Severity
from rvaft.support.budget import Undecided
from rvaft.support.collector import no_collections

DRAFT_RULES: Final = (
    Rule("duplicate-setting", Severity.ERROR, structure.duplicate_setting),
    Rule("gate-without-children", Severity.ERROR, structure.gate_without_children),
    Rule("duplicate-child", Severity.ERROR, structure.duplicate_child),
    Rule("threshold", Severity.ERROR, structure.threshold),
    # Only trees built in code break this rule: in a text an undeclared child becomes a leaf.
    Rule("unknown-child", Severity.ERROR, lambda _: ()),
    Rule("times", Severity.ERROR, structure.times),
    Rule("own-values", Severity.ERROR, structure.own_values),
    Rule("within", Severity.ERROR, structure.within),
    Rule("without", Severity.ERROR, absences.without),
    Rule("unbound-time", Severity.ERROR, structure.unknown_time),
    Rule("no-root", Severity.ERROR, structure.no_root),
    Rule("cycle", Severity.ERROR, structure.cycle),
    Rule("prune", Severity.ERROR, structure.prune),
    Rule("duplicate-event", Severity.ERROR, structure.duplicate_event),
    Rule("unused-parameter", Severity.ERROR, structure.unused_parameter),
    Rule("unknown-event", Severity.ERROR, structure.unknown_event),
    Rule("event-arity", Severity.ERROR, structure.event_arity),
    Rule("ignore-variable", Severity.ERROR, structure.ignore_variable),
    Rule("shown-variable", Severity.ERROR, structure.shown_variable),
    Rule("duplicate-topic", Severity.ERROR, structure.duplicate_topic),
    Rule("malformed-topic", Severity.ERROR, structure.malformed_topic),
    Rule("no-time", Severity.ERROR, structure.no_time),
    Rule("dynamic-gate", Severity.INFORMATION, structure.dynamic_gate),
    Rule("number", Severity.WARNING, structure.number),
    Rule("other-format", Severity.INFORMATION, structure.other_format),
)
"""The rules that a draft must satisfy to be a tree."""

TREE_ERRORS: Final = (
    # The constructor of a tree does not check this rule.
    Rule("ignore-variable", Severity.ERROR, lambda space: structure.ignore_variable(space.tree)),
    Rule("no-scenario", Severity.ERROR, scenarios.no_scenario),
    Rule("silent-scenario", Severity.ERROR, scenarios.silent_scenario),
    Rule("unbound-variable", Severity.ERROR, scenarios.unbound_variable),
    Rule("unbound-absence", Severity.ERROR, absences.unbound_absence),
    Rule("no-time", Severity.ERROR, times.no_time),
    Rule("unbound-time", Severity.ERROR, times.unbound_time),
)
"""The rules about trees and their scenarios that make a tree unusable."""

UNDECIDED: Final = Rule("undecided", Severity.WARNING, lambda _: ())

ORDER: Final = attrgetter("place", "severity", "code")


def check_draft(draft: Draft) -> list[Finding]:
    """Return the findings on the structure of a draft; without errors, `draft.build()` succeeds."""
    return findings(DRAFT_RULES, draft)


_checked: "WeakKeyDictionary[RVAFT, Finding | None]" = WeakKeyDictionary()


def require_valid(tree: RVAFT) -> None:
    """Raise `TreeError` for the first error of `check_tree`; cached per tree.

    A tree restricted to a kind is valid if one of its sub-DAGs is valid.
    """
    if tree not in _checked:
        errors = [_first_error(part) for part in alternatives(tree)]
        _checked[tree] = None if None in errors else errors[0]
    error = _checked[tree]
    if error is not None:
        raise TreeError(error.message, rule=error.code, nodes=error.nodes)


def _first_error(tree: RVAFT) -> Finding | None:
    space = ScenarioSpace(tree)
    found = (finding for rule in TREE_ERRORS for finding in findings([rule], space) if finding.code == rule.code)
    return next(found, None)


def findings(rules: Iterable[Rule], subject: Any) -> list[Finding]:
    """Return the findings of rules on a draft or a scenario space, by position."""
    found: list[Finding] = []
    for rule in rules:
        try:
            for place, message, nodes, undecided in rule.check(subject):
                code, severity, _ = UNDECIDED if undecided else rule
                found.append(Finding(place, severity, code, message, nodes))
        except Undecided:
            root, within = subject.tree.nodes[subject.tree.root], f"was not decided within {subject.limit} steps"
            message = f"{rule.code} {within}; share fewer nodes, or check parts of the tree"
            found.append(Finding(root.place(), UNDECIDED.severity, UNDECIDED.code, message, (root.name,)))
    return sorted(found, key=ORDER)


def valid_part(tree: RVAFT, branch: int | None = None, kind: Kind | str | None = None) -> RVAFT:
    """Return the tree, or its restriction to a branch or kind; raises `TreeError`, and `OptionError` for
    another word than a kind.
    """
    require_valid(tree)
    part = restrict(tree, branch=branch, kind=None if kind is None else one_of(Kind, kind))
    try:
        require_valid(part)
    except TreeError as error:
        if error.rule != "no-scenario":
            raise
        name = f"branch {branch}" if branch is not None else f"the part of kind {kind}"
        message = f"{name} has no feasible scenario: nothing can be detected there"
        raise TreeError(message, rule=error.rule, nodes=error.nodes) from error
    return part


@no_collections()
def loads(text: str, file: str = "<text>", **reading: Unpack[TreeOptions]) -> RVAFT:
    """Return the tree in a text; imports are relative to the folder of `file`.

    `confine_imports` refuses imports from outside that folder. `strict_galileo` refuses the dynamic
    gates of Galileo, which are otherwise read as observed failures. `year` is for a format of times
    that has none. Raises `LanguageError` for
    invalid text and `TreeError` for a broken rule.

    >>> loads("top sand a b;")
    <RVAFT top: 3 nodes>
    """
    expect("the text of a tree", text, str, "a str")
    return valid_tree(parse(text, file, **reading))


@no_collections()
def load(path: os.PathLike[str] | str, **reading: Unpack[TreeOptions]) -> RVAFT:
    """Return the tree in a file, also in Galileo's format; raises `OSError` and the errors of
    `loads`.

    >>> load("trees/gates/and.rvaft")
    <RVAFT top: 4 nodes>
    """
    expect("the path of a tree", path, str | os.PathLike, "a str or a path")
    return valid_tree(parse_file(path, **reading))


def valid_tree(draft: Draft) -> RVAFT:
    """Return the tree of a draft; raises `TreeError` for a broken rule."""
    _raise_first(check_draft(draft))
    tree = draft.build()
    try:
        require_valid(tree)  # caches the result
    except TreeError:
        _raise_first(findings(TREE_ERRORS, ScenarioSpace(tree)))
        raise
    return tree


def _raise_first(findings: Iterable[Finding]) -> None:
    for finding in findings:
        if finding.severity is Severity.ERROR:
            raise TreeError(f"{finding.place}: {finding.message}", rule=finding.code, nodes=finding.nodes)
