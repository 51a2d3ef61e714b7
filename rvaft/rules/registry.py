"""The table of all rules, by code, and what every code means."""

from collections.abc import Iterable
from dataclasses import replace
from difflib import get_close_matches
from typing import Final

from rvaft.analysis.scenarios import ScenarioSpace
from rvaft.errors import RvaftError
from rvaft.rules import guards, scenarios, structure, usage
from rvaft.rules.rule import CODES, Report, Rule, Severity

DRAFT_RULES: Final = (*structure.RULES, *structure.DECLARATIONS_RULES, *structure.TOPICS_RULES)
"""The rules that a draft must keep to be a tree."""


def _foreign_in_ignores(space: ScenarioSpace) -> Iterable[Report]:
    return structure.foreign_variables(space.tree.ignores)


_OF_BOTH: Final = tuple(
    replace(rule, check=_foreign_in_ignores) for rule in DRAFT_RULES if rule.check is structure.ignore_variable
)
"""The constructor of a tree does not ask this, so a tree built in code is asked again."""

TREE_RULES: Final = (
    *_OF_BOTH,
    *scenarios.RULES,
    *guards.RULES,
    *scenarios.SHARING_RULES,
    *guards.CONTRADICTION_RULES,
    *usage.RULES,
    structure.UNUSED,
)
"""The rules about trees and their scenarios."""


def _nothing(_: ScenarioSpace) -> Iterable[Report]:
    return ()


UNDECIDED: Final = Rule(
    "undecided",
    Severity.WARNING,
    "rule not decided",
    _nothing,
    "Some rules ask for a scenario, and finding one is hard in general when nodes are shared; no rule enumerates them. Where a rule "
    "reached its limit, or where guards contradict each other by exact arithmetic but doubles may round, it says so.",
    "event at(t) = { time: t };\ntop sand a b c d;\na on at(T1);\nb on at(T2);\nc when T2 >= T1 + 10;\nd when T2 <= T1;\n",
    "event at(t) = { time: t };\ntop sand a b c d;\na on at(T1);\nb on at(T2);\nc when T2 >= T1 + 10;\nd when T2 >= T1;\n",
)

RULES: Final[dict[str, Rule]] = {rule.code: rule for rule in (*DRAFT_RULES, *TREE_RULES, UNDECIDED)}


class UnknownRule(RvaftError, KeyError):
    """There is no rule of that code."""

    def __init__(self, code: str) -> None:
        self.code = code
        close = get_close_matches(code.lower(), [*RULES, *CODES], n=1)
        guess = f"; did you mean {close[0]}?" if close else f"; the rules are {', '.join(sorted(RULES))}"
        super().__init__(f"there is no rule {code}{guess}")

    def __str__(self) -> str:
        return str(self.args[0])


def rule(code: str) -> Rule:
    """The rule of a code; raises `UnknownRule`."""
    if code not in RULES:
        raise UnknownRule(code)
    return RULES[code]


def explain(code: str) -> str:
    """What this code means, for a finding with a tree that has it and the tree mended; raises `UnknownRule`."""
    if code in CODES:
        return f"{code} (error): {CODES[code].title}\n\n{CODES[code].explanation}\n"
    found = rule(code)
    return (
        f"{found.code} ({found.severity}): {found.title}\n\n{found.explanation}\n\n"
        f"Not so:\n\n{_indented(found.bad)}\n\nBut so:\n\n{_indented(found.mended)}\n"
    )


def _indented(text: str) -> str:
    return "\n".join(f"    {line}" for line in text.rstrip("\n").split("\n"))


# The reference page of the rules; `python -m rvaft.rules.page > docs/rules.md` writes it.

_HEADER = """# What `rvaft check` looks for

Every finding ends with the code of its rule, as in `robot.rvaft:7:6: error: unknown event type radiaton; did you mean
radiation? [unknown-event]`. `rvaft explain CODE` prints what is written here. An error makes a tree unusable, a warning does not.
The rules about scenarios are asked only where the structure has no error. None of them enumerates branches.

| code | severity | finding |
| --- | --- | --- |
"""

_FOOTER = """
## Other codes

These are the codes of errors that stop the work; no finding on a tree has them.

"""


def page() -> str:
    """The page in Markdown: a table of all rules, each with a tree that breaks it and the tree mended, then the other codes."""
    rows = "".join(f"| [`{rule.code}`](#{rule.code}) | {rule.severity} | {rule.title} |\n" for rule in RULES.values())
    others = "".join(f"- `{code.code}`: {code.title}. {code.explanation}\n" for code in CODES.values())
    return _HEADER + rows + "".join(_section(rule) for rule in RULES.values()) + _FOOTER + others


def _section(rule: Rule) -> str:
    language = "python" if rule.python else "rvaft"
    return (
        f"\n## {rule.code}\n\n*{rule.severity}: {rule.title}.* {rule.explanation}\n\n"
        f"Not so:\n\n```{language}\n{rule.bad.strip()}\n```\n\nBut so:\n\n```{language}\n{rule.mended.strip()}\n```\n"
    )


if __name__ == "__main__":
    print(page(), end="")
