"""Every rule: its code, its words, its examples, its page."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from rvaft.errors import RvaftError, TreeError
from rvaft.language.parser import parse
from rvaft.model import nodes, tree
from rvaft.rules import RULES, UnknownRule, check, check_draft, explain
from rvaft.rules.registry import page
from rvaft.rules.rule import CODES, Severity

DOCS = Path(__file__).parents[2] / "docs" / "rules.md"

EXPECTED = {
    "error": {
        "cycle",
        "duplicate-setting",
        "duplicate-event",
        "duplicate-child",
        "threshold",
        "unbound-variable",
        "no-scenario",
        "silent-scenario",
        "event-arity",
        "unknown-event",
        "unused-parameter",
        "ignore-variable",
        "duplicate-topic",
        "malformed-topic",
        "gate-without-children",
        "unknown-child",
        "no-root",
        "prune",
    },
    "warning": {
        "undeclared",
        "unreachable",
        "unused-event",
        "unused-topic",
        "root-event",
        "ambiguous-event",
        "shared-under-order",
        "infeasible-scenario",
        "contradictory-guards",
        "variable-once",
        "undecided",
    },
}


def test_the_table_of_rules_is_complete() -> None:
    found = {severity: {code for code, rule in RULES.items() if rule.severity == severity} for severity in EXPECTED}
    assert found == EXPECTED
    assert len({rule.check for rule in RULES.values()}) == len(RULES)


@pytest.mark.parametrize("code", [code for code, rule in RULES.items() if not rule.python])
def test_the_bad_tree_of_a_rule_breaks_exactly_that_rule(code: str) -> None:
    findings = check(parse(RULES[code].bad))
    assert {finding.code for finding in findings} == {code}
    assert {finding.severity for finding in findings} == {RULES[code].severity}
    assert all(finding.place.file == "<text>" and "\n" not in finding.message for finding in findings)


@pytest.mark.parametrize("code", [code for code, rule in RULES.items() if not rule.python])
def test_the_mended_tree_of_a_rule_is_flawless(code: str) -> None:
    assert check(parse(RULES[code].mended)) == []


@pytest.mark.parametrize("code", [code for code, rule in RULES.items() if rule.python])
def test_the_code_of_a_rule_that_no_text_breaks(code: str) -> None:
    names = {"RVAFT": tree.RVAFT, "Node": nodes.Node, "Gate": nodes.Gate}
    with pytest.raises(TreeError) as caught:
        eval(RULES[code].bad, names)
    assert caught.value.rule == code
    assert isinstance(eval(RULES[code].mended, names), tree.RVAFT)


def codes_in(source: str) -> set[str]:
    """The codes that a source gives to errors and rules, where it writes them out."""
    found: set[str] = set()
    for call in ast.walk(ast.parse(source)):
        if isinstance(call, ast.Call):
            given = [keyword.value for keyword in call.keywords if keyword.arg == "rule"]
            if isinstance(call.func, ast.Name) and call.func.id == "Rule":
                given += call.args[:1]
            found |= {str(code.value) for code in given if isinstance(code, ast.Constant)}
    return found


def test_every_code_in_the_source_is_explained() -> None:
    root = Path(__file__).parents[2]
    sources = [path for package in ("rvaft", "backends", "cross_check") for path in (root / package).rglob("*.py")]
    found = {code for path in sources for code in codes_in(path.read_text(encoding="utf-8"))}
    assert found >= {"no-branch", "cycle", "unbound-variable"}
    assert found <= {*RULES, *CODES}
    assert not {*RULES} & {*CODES}


@pytest.mark.parametrize("code", CODES)
def test_explanations_of_other_codes(code: str) -> None:
    said = explain(code)
    assert said.startswith(f"{code} (error): {CODES[code].title}\n\n{CODES[code].explanation}")
    assert code in page()


def test_the_page_is_what_the_rules_say() -> None:
    """`python -m rvaft.rules.page > docs/rules.md` mends a failure."""
    assert DOCS.read_text(encoding="utf-8") == page()


@pytest.mark.parametrize("code", RULES)
def test_explanations(code: str) -> None:
    said = explain(code)
    assert said.startswith(f"{code} ({RULES[code].severity})")
    for part in (RULES[code].explanation, *RULES[code].bad.split("\n"), *RULES[code].mended.split("\n")):
        assert part in said


def test_an_unknown_code_is_answered_with_a_guess() -> None:
    with pytest.raises(UnknownRule, match="did you mean unbound-variable"):
        explain("unbound-variabel")
    assert issubclass(UnknownRule, RvaftError)
    assert issubclass(UnknownRule, KeyError)


@pytest.mark.parametrize("code", [code for code, rule in RULES.items() if not rule.python])
def test_a_draft_without_errors_can_be_built(code: str) -> None:
    draft = parse(RULES[code].bad)
    if not any(finding.severity is Severity.ERROR for finding in check_draft(draft)):
        draft.build()


def test_checking_an_ordinary_tree_imports_no_algebra() -> None:
    text = RULES["contradictory-guards"].bad
    program = (
        "import sys; from rvaft.language.parser import parse; from rvaft.rules import check; "
        f"print([f.code for f in check(parse({text!r}))]); print('sympy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "['contradictory-guards']\nFalse\n"
