"""The table of all rules, and the explanation of codes."""

from functools import cache
from pathlib import Path
from textwrap import indent
from typing import Final, NamedTuple

from rvaft.core.feasibility import ScenarioSpace
from rvaft.errors import RvaftError
from rvaft.language.draft import Draft
from rvaft.model.tree import RVAFT
from rvaft.rules import absences, ambiguity, contradictions, scenarios, structure, times, types
from rvaft.rules.rule import Finding, Rule, Severity
from rvaft.rules.validity import DRAFT_RULES, ORDER, TREE_ERRORS, UNDECIDED, check_draft, findings
from rvaft.support.budget import DEFAULT_LIMIT

TREE_RULES: Final = (
    *TREE_ERRORS,
    Rule("infeasible-scenario", Severity.WARNING, scenarios.infeasible_scenario),
    Rule("variable-once", Severity.WARNING, structure.variable_once),
    Rule("ambiguous-event", Severity.WARNING, ambiguity.ambiguous_event),
    Rule("shared-under-order", Severity.WARNING, ambiguity.shared_under_order),
    Rule("contradictory-guards", Severity.WARNING, contradictions.contradictory_guards),
    Rule("contradictory-guards", Severity.WARNING, times.contradictory_times),
    Rule("type-mismatch", Severity.WARNING, types.type_mismatch),
    Rule("unused-type", Severity.WARNING, types.unused_type),
    Rule("too-many-events", Severity.WARNING, times.too_many_events),
    Rule("ros-time", Severity.INFORMATION, times.ros_time),
    Rule("unstated-semantics", Severity.WARNING, times.unstated_semantics),
    Rule("tied-values", Severity.WARNING, times.tied_values),
    Rule("repeat-by", Severity.WARNING, structure.repeat_by),
    Rule("void-absence", Severity.WARNING, absences.void_absence),
    Rule("undeclared", Severity.WARNING, structure.undeclared),
    Rule("unreachable", Severity.WARNING, structure.unreachable),
    Rule("unused-event", Severity.WARNING, structure.unused_event),
    Rule("root-event", Severity.WARNING, structure.root_event),
    Rule("unused-topic", Severity.WARNING, structure.unused_topic),
)
"""The rules about trees and their scenarios."""

RULES: Final[dict[str, Rule]] = {rule.code: rule for rule in (*DRAFT_RULES, *TREE_RULES, UNDECIDED)}

SYNTAX: Final = "syntax"
"""The code of a syntax error in `check --format json`."""
CODES: Final = (SYNTAX, "no-branch")
"""The codes of errors that are no findings."""


def check(draft: Draft, *, limit: int = DEFAULT_LIMIT) -> list[Finding]:
    """Return all findings by position; the rules about scenarios require a valid structure."""
    found = check_draft(draft)
    if not any(finding.severity is Severity.ERROR for finding in found):
        found = sorted(found + check_tree(draft.build(), limit=limit), key=ORDER)
    return found


def check_tree(tree: RVAFT, *, limit: int = DEFAULT_LIMIT) -> list[Finding]:
    """Return the findings on a tree; a rule reports `undecided` after `limit` steps."""
    return findings(TREE_RULES, ScenarioSpace(tree, limit))


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
