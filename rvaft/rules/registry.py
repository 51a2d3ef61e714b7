"""The table of all rules, the explanation of codes, and the validation of trees."""

from collections.abc import Iterable
from functools import cache
from operator import attrgetter
from pathlib import Path
from textwrap import indent
from typing import Any, Final, NamedTuple
from weakref import WeakKeyDictionary

from rvaft.core.branches import alternatives, restrict
from rvaft.core.scenario_space import ScenarioSpace
from rvaft.errors import RvaftError, TreeError
from rvaft.language.draft import Draft
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.rules import scenarios, structure, times, types
from rvaft.rules.rule import Finding, Rule, Severity
from rvaft.support.budget import DEFAULT_LIMIT, Undecided

DRAFT_RULES: Final = (
    Rule("duplicate-setting", Severity.ERROR, structure.duplicate_setting),
    Rule("gate-without-children", Severity.ERROR, structure.gate_without_children),
    Rule("duplicate-child", Severity.ERROR, structure.duplicate_child),
    Rule("threshold", Severity.ERROR, structure.threshold),
    # Only trees built in code break this rule: in a text an undeclared child becomes a leaf.
    Rule("unknown-child", Severity.ERROR, lambda _: ()),
    Rule("times", Severity.ERROR, structure.times),
    Rule("within", Severity.ERROR, structure.within),
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
)
"""The rules that a draft must satisfy to be a tree."""

TREE_RULES: Final = (
    # The constructor of a tree does not check this rule.
    Rule("ignore-variable", Severity.ERROR, lambda space: structure.ignore_variable(space.tree)),
    Rule("no-scenario", Severity.ERROR, scenarios.no_scenario),
    Rule("silent-scenario", Severity.ERROR, scenarios.silent_scenario),
    Rule("infeasible-scenario", Severity.WARNING, scenarios.infeasible_scenario),
    Rule("unbound-variable", Severity.ERROR, scenarios.unbound_variable),
    Rule("no-time", Severity.ERROR, times.no_time),
    Rule("unbound-time", Severity.ERROR, times.unbound_time),
    Rule("variable-once", Severity.WARNING, structure.variable_once),
    Rule("ambiguous-event", Severity.WARNING, scenarios.ambiguous_event),
    Rule("shared-under-order", Severity.WARNING, scenarios.shared_under_order),
    Rule("contradictory-guards", Severity.WARNING, scenarios.contradictory_guards),
    Rule("contradictory-guards", Severity.WARNING, times.contradictory_times),
    Rule("type-mismatch", Severity.WARNING, types.type_mismatch),
    Rule("unused-type", Severity.WARNING, types.unused_type),
    Rule("too-many-events", Severity.WARNING, times.too_many_events),
    Rule("ros-time", Severity.INFORMATION, times.ros_time),
    Rule("unstated-semantics", Severity.WARNING, times.unstated_semantics),
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
"""The code of a syntax error in `check --format json`."""
CODES: Final = (SYNTAX, "no-branch")
"""The codes of errors that are no findings."""

_ORDER: Final = attrgetter("place", "severity", "code")


def check(draft: Draft, *, limit: int = DEFAULT_LIMIT) -> list[Finding]:
    """Return all findings by position; the rules about scenarios require a valid structure."""
    found = check_draft(draft)
    if not any(finding.severity is Severity.ERROR for finding in found):
        found = sorted(found + check_tree(draft.build(), limit=limit), key=_ORDER)
    return found


def check_draft(draft: Draft) -> list[Finding]:
    """Return the findings on the structure of a draft; without errors, `draft.build()` succeeds."""
    return _findings(DRAFT_RULES, draft)


def check_tree(tree: RVAFT, *, limit: int = DEFAULT_LIMIT) -> list[Finding]:
    """Return the findings on a tree; a rule reports `undecided` after `limit` steps."""
    return _findings(TREE_RULES, ScenarioSpace(tree, limit))


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
    errors = (rule for rule in TREE_RULES if rule.severity is Severity.ERROR)
    found = (finding for rule in errors for finding in _findings([rule], space) if finding.code == rule.code)
    return next(found, None)


def _findings(rules: Iterable[Rule], subject: Any) -> list[Finding]:
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
    return sorted(found, key=_ORDER)


class CodeMeaning(NamedTuple):
    """The explanation of a code, with a minimal text that breaks the rule and its correction.

    With `python`, both are code that builds a tree, because no text breaks the rule.
    """

    title: str
    explanation: str
    bad: str = ""
    mended: str = ""
    python: bool = False


@cache
def meanings() -> dict[str, CodeMeaning]:
    """Return the explanations by code."""
    import tomllib  # noqa: PLC0415 -- imported on use

    text = Path(__file__).with_name("rules.toml").read_text(encoding="utf-8")
    return {code: CodeMeaning(**words) for code, words in tomllib.loads(text).items()}


class UnknownRule(RvaftError, KeyError):
    """There is no rule with this code."""

    def __init__(self, code: str) -> None:
        self.code = code
        from difflib import get_close_matches  # noqa: PLC0415 -- imported on use

        close = get_close_matches(code.lower(), [*RULES, *CODES], n=1)
        guess = f"; did you mean {close[0]}?" if close else f"; the rules are {', '.join(sorted(RULES))}"
        super().__init__(f"there is no rule {code}{guess}")

    def __str__(self) -> str:
        return str(self.args[0])


def explain(code: str) -> str:
    """Return the explanation of a code, with its examples; raises `UnknownRule`.

    >>> print(explain("no-scenario").splitlines()[0])
    no-scenario (error): no feasible scenario
    """
    if code not in meanings():
        raise UnknownRule(code)
    title, explanation, *examples, _ = meanings()[code]
    severity = RULES[code].severity if code in RULES else Severity.ERROR
    text = f"{code} ({severity}): {title}\n\n{explanation}\n"
    bad, mended = (indent(text.rstrip("\n"), "    ", lambda _: True) for text in examples)
    return f"{text}\nIncorrect:\n\n{bad}\n\nCorrect:\n\n{mended}\n" if bad.strip() else text


_PAGE: Final = """# The rules of `rvaft check`

Every finding ends with the code of its rule, as in `robot.rvaft:7:6: error: unknown event type radiaton; did you mean
radiation? [unknown-event]`. `rvaft explain CODE` prints the explanations below. An error makes a tree unusable, a
warning does not, and an information describes an interpretation. The rules about scenarios are checked only if the
structure has no error. They do not enumerate branches, except if the parts of a `pand` share nodes
(`infeasible-scenario`).

| code | severity | finding |
| --- | --- | --- |
{table}{sections}
## Other codes

These are the codes of errors that stop the work; no finding on a tree has them.

{others}"""
_SECTION: Final = """
## {code}

*{severity}: {meaning.title}.* {meaning.explanation}

Incorrect:

```{language}
{meaning.bad}```

Correct:

```{language}
{meaning.mended}```
"""


def page() -> str:
    """Return the page of all rules and codes in Markdown."""
    table, sections = "", ""
    for code, (_, severity, _) in RULES.items():
        meaning = meanings()[code]
        table += f"| [`{code}`](#{code}) | {severity} | {meaning.title} |\n"
        language = "python" if meaning.python else "rvaft"
        sections += _SECTION.format(code=code, severity=severity, meaning=meaning, language=language)
    others = "".join(f"- `{code}`: {meanings()[code].title}. {meanings()[code].explanation}\n" for code in CODES)
    return _PAGE.format(table=table, sections=sections, others=others)


def valid_part(tree: RVAFT, branch: int | None = None, kind: Kind | None = None) -> RVAFT:
    """Return the tree, or its restriction to a branch or kind; raises `TreeError`."""
    require_valid(tree)
    part = restrict(tree, branch=branch, kind=kind)
    try:
        require_valid(part)
    except TreeError as error:
        if error.rule != "no-scenario":
            raise
        name = f"branch {branch}" if branch is not None else f"the part of kind {kind}"
        message = f"{name} has no feasible scenario: nothing can be detected there"
        raise TreeError(message, rule=error.rule, nodes=error.nodes) from error
    return part
