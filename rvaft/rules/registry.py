"""All rules: one table, what every code means, and the checks that everything else relies on."""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from typing import Any, Final
from weakref import WeakKeyDictionary

from rvaft.analysis.scenarios import ScenarioSpace
from rvaft.errors import RvaftError, TreeError
from rvaft.language.draft import Draft
from rvaft.model.tree import RVAFT
from rvaft.rules import guards, scenarios, structure
from rvaft.rules.rule import Finding, Rule, RuleReport, Severity
from rvaft.support.budget import DEFAULT_LIMIT, Undecided

DRAFT_RULES: Final = (
    Rule("duplicate-setting", Severity.ERROR, structure.duplicate_setting),
    Rule("gate-without-children", Severity.ERROR, structure.gate_without_children),
    Rule("duplicate-child", Severity.ERROR, structure.duplicate_child),
    Rule("threshold", Severity.ERROR, structure.threshold),
    Rule("unknown-child", Severity.ERROR, structure.unknown_child),
    Rule("no-root", Severity.ERROR, structure.no_root),
    Rule("cycle", Severity.ERROR, structure.cycle),
    Rule("prune", Severity.ERROR, structure.prune),
    Rule("duplicate-event", Severity.ERROR, structure.duplicate_event),
    Rule("unused-parameter", Severity.ERROR, structure.unused_parameter),
    Rule("unknown-event", Severity.ERROR, structure.unknown_event),
    Rule("event-arity", Severity.ERROR, structure.event_arity),
    Rule("ignore-variable", Severity.ERROR, structure.ignore_variable),
    Rule("duplicate-topic", Severity.ERROR, structure.duplicate_topic),
    Rule("malformed-topic", Severity.ERROR, structure.malformed_topic),
)
"""The rules that a draft must keep to be a tree."""

TREE_RULES: Final = (
    # The constructor of a tree does not ask this, so a tree built in code is asked again.
    Rule("ignore-variable", Severity.ERROR, structure.ignore_variable_of_tree),
    Rule("no-scenario", Severity.ERROR, scenarios.no_scenario),
    Rule("silent-scenario", Severity.ERROR, scenarios.silent_scenario),
    Rule("infeasible-scenario", Severity.WARNING, scenarios.infeasible_scenario),
    Rule("unbound-variable", Severity.ERROR, guards.unbound_variable),
    Rule("variable-once", Severity.WARNING, guards.variable_once),
    Rule("ambiguous-event", Severity.WARNING, scenarios.ambiguous_event),
    Rule("shared-under-order", Severity.WARNING, scenarios.shared_under_order),
    Rule("contradictory-guards", Severity.WARNING, guards.contradictory_guards),
    Rule("undeclared", Severity.WARNING, structure.undeclared),
    Rule("unreachable", Severity.WARNING, structure.unreachable),
    Rule("unused-event", Severity.WARNING, structure.unused_event),
    Rule("root-event", Severity.WARNING, structure.root_event),
    Rule("unused-topic", Severity.WARNING, structure.unused_topic),
)
"""The rules about trees and their scenarios."""

UNDECIDED: Final = Rule("undecided", Severity.WARNING, lambda _: ())

RULES: Final[dict[str, Rule]] = {rule.code: rule for rule in (*DRAFT_RULES, *TREE_RULES, UNDECIDED)}

SYNTAX: Final = "syntax"
"""The code under which `check --format json` reports a text that is no tree."""
CODES: Final = (SYNTAX, "no-branch")
"""The codes of errors that are no findings on a tree."""


# Running the rules.


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


_checked: "WeakKeyDictionary[RVAFT, Finding | None]" = WeakKeyDictionary()


def require_valid(tree: RVAFT) -> None:
    """Raise `TreeError` for the first error that `check_tree` finds; warnings are no matter. Remembered per tree."""
    if tree not in _checked:
        space = ScenarioSpace(tree)
        errors = (rule for rule in TREE_RULES if rule.severity is Severity.ERROR)
        found = (finding for rule in errors for finding in _findings(rule, space) if finding.code == rule.code)
        _checked[tree] = next(found, None)
    error = _checked[tree]
    if error is not None:
        raise TreeError(error.message, rule=error.code, nodes=error.nodes)


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
        found.append(UNDECIDED.finding(RuleReport(root.place(), message, (root.name,))))
    return found


def _sorted(findings: Iterable[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: (finding.place, finding.severity, finding.code))


# What the codes mean.


@dataclass(frozen=True, slots=True)
class CodeMeaning:
    """The words that explain a code.

    `bad` is a smallest text that breaks the rule and `mended` the same text put right; with `python` both are code that builds a tree,
    since no text leads there.
    """

    title: str
    explanation: str
    bad: str = ""
    mended: str = ""
    python: bool = False


@cache
def meanings() -> dict[str, CodeMeaning]:
    """What every code means."""
    text = files("rvaft.rules").joinpath("rules.toml").read_text(encoding="utf-8")
    return {code: CodeMeaning(**words) for code, words in tomllib.loads(text).items()}


class UnknownRule(RvaftError, KeyError):
    """There is no rule of that code."""

    def __init__(self, code: str) -> None:
        self.code = code
        close = get_close_matches(code.lower(), [*RULES, *CODES], n=1)
        guess = f"; did you mean {close[0]}?" if close else f"; the rules are {', '.join(sorted(RULES))}"
        super().__init__(f"there is no rule {code}{guess}")

    def __str__(self) -> str:
        return str(self.args[0])


def explain(code: str) -> str:
    """What this code means, for a finding with a tree that has it and the tree mended; raises `UnknownRule`.

    >>> print(explain("no-scenario").splitlines()[0])
    no-scenario (error): no feasible scenario
    """
    if code not in meanings():
        raise UnknownRule(code)
    found = meanings()[code]
    severity = RULES[code].severity if code in RULES else Severity.ERROR
    said = f"{code} ({severity}): {found.title}\n\n{found.explanation}\n"
    return f"{said}\nNot so:\n\n{_indented(found.bad)}\n\nBut so:\n\n{_indented(found.mended)}\n" if found.bad else said


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" for line in text.rstrip("\n").split("\n"))


# The reference page of the rules; `python -m rvaft.rules.registry > docs/rules.md` writes it.

_PAGE: Final = """# What `rvaft check` looks for

Every finding ends with the code of its rule, as in `robot.rvaft:7:6: error: unknown event type radiaton; did you mean
radiation? [unknown-event]`. `rvaft explain CODE` prints what is written here. An error makes a tree unusable, a warning does not.
The rules about scenarios are asked only where the structure has no error. None of them enumerates branches.

| code | severity | finding |
| --- | --- | --- |
{table}{sections}
## Other codes

These are the codes of errors that stop the work; no finding on a tree has them.

{others}"""


def page() -> str:
    """The page in Markdown: a table of all rules, each with a tree that breaks it and the tree mended, then the other codes."""
    said = meanings()
    table = "".join(f"| [`{code}`](#{code}) | {rule.severity} | {said[code].title} |\n" for code, rule in RULES.items())
    sections = "".join(_section(rule, said[code]) for code, rule in RULES.items())
    others = "".join(f"- `{code}`: {said[code].title}. {said[code].explanation}\n" for code in CODES)
    return _PAGE.format(table=table, sections=sections, others=others)


def _section(rule: Rule, said: CodeMeaning) -> str:
    language = "python" if said.python else "rvaft"
    return (
        f"\n## {rule.code}\n\n*{rule.severity}: {said.title}.* {said.explanation}\n\n"
        f"Not so:\n\n```{language}\n{said.bad.strip()}\n```\n\nBut so:\n\n```{language}\n{said.mended.strip()}\n```\n"
    )


if __name__ == "__main__":
    print(page(), end="")
