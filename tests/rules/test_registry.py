"""Every rule: its code, its words, its examples, its page."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from rvaft.errors import RvaftError, TreeError
from rvaft.language.parser import parse
from rvaft.model import nodes, tree
from rvaft.rules import RULES, UnknownRule, check, check_draft, explain, meanings
from rvaft.rules.registry import CODES, page
from rvaft.rules.rule import Severity

ROOT = Path(__file__).parents[2]
OF_TEXTS = [code for code in RULES if not meanings()[code].python]


def test_every_code_has_its_words() -> None:
    assert [*meanings()] == [*RULES, *CODES]
    assert sum(rule.severity is Severity.ERROR for rule in RULES.values()) == 18
    assert len(RULES) == 29


@pytest.mark.parametrize("code", OF_TEXTS)
def test_the_bad_tree_of_a_rule_breaks_exactly_that_rule_and_the_mended_one_none(code: str) -> None:
    draft = parse(meanings()[code].bad)
    findings = check(draft)
    assert {finding.code for finding in findings} == {code}
    assert {finding.severity for finding in findings} == {RULES[code].severity}
    assert all(finding.place.file == "<text>" and "\n" not in finding.message for finding in findings)
    assert check(parse(meanings()[code].mended)) == []
    if not any(finding.severity is Severity.ERROR for finding in check_draft(draft)):
        draft.build()


@pytest.mark.parametrize("code", [code for code in RULES if code not in OF_TEXTS])
def test_the_code_of_a_rule_that_no_text_breaks(code: str) -> None:
    names = {"RVAFT": tree.RVAFT, "Node": nodes.Node, "Gate": nodes.Gate}
    with pytest.raises(TreeError) as caught:
        eval(meanings()[code].bad, names)
    assert caught.value.rule == code
    assert isinstance(eval(meanings()[code].mended, names), tree.RVAFT)


def codes_in(source: str) -> set[str]:
    """The codes that a source gives to errors, where it writes them out."""
    calls = (call for call in ast.walk(ast.parse(source)) if isinstance(call, ast.Call))
    given = (keyword.value for call in calls for keyword in call.keywords if keyword.arg == "rule")
    return {str(code.value) for code in given if isinstance(code, ast.Constant)}


def test_every_code_in_the_source_is_explained() -> None:
    sources = [path for package in ("rvaft", "backends", "cross_check") for path in (ROOT / package).rglob("*.py")]
    found = {code for path in sources for code in codes_in(path.read_text(encoding="utf-8"))}
    assert {"no-branch", "cycle", "unbound-variable"} <= found <= {*meanings()}


@pytest.mark.parametrize("code", meanings())
def test_explanations(code: str) -> None:
    said, words = explain(code), meanings()[code]
    severity = RULES[code].severity if code in RULES else "error"
    assert said.startswith(f"{code} ({severity}): {words.title}\n\n{words.explanation}")
    assert all(part in said for part in (*words.bad.split("\n"), *words.mended.split("\n")))


def test_the_page_is_what_the_rules_say() -> None:
    """`python -m rvaft.rules.registry > docs/rules.md` mends a failure."""
    assert (ROOT / "docs" / "rules.md").read_text(encoding="utf-8") == page()


def test_an_unknown_code_is_answered_with_a_guess() -> None:
    with pytest.raises(UnknownRule, match="did you mean unbound-variable"):
        explain("unbound-variabel")
    assert issubclass(UnknownRule, RvaftError)
    assert issubclass(UnknownRule, KeyError)


def test_checking_an_ordinary_tree_imports_no_algebra() -> None:
    program = (
        "import sys; from rvaft.language.parser import parse; from rvaft.rules import check; "
        f"print([f.code for f in check(parse({meanings()['contradictory-guards'].bad!r}))]); print('sympy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "['contradictory-guards']\nFalse\n"
