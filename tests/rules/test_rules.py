"""Every rule: its code, its words, its examples, its page, and what single findings say, and where."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from rvaft import RVAFT, EventType, Gate, Ignore, Node, On, RvaftError, Severity, TreeError, loads
from rvaft.language.parser import parse, parse_file
from rvaft.model import nodes, tree
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.rules.registry import CODES, RULES, UnknownRule, check, check_tree, explain, meanings, page
from rvaft.rules.validity import check_draft, require_valid
from tests.tables import rows

ROOT = Path(__file__).parents[2]
OF_TEXTS = [code for code in RULES if not meanings()[code].python]


def test_every_code_has_its_words() -> None:
    assert [*meanings()] == [*RULES, *CODES]
    assert sum(rule.severity is Severity.ERROR for rule in RULES.values()) == 26
    assert len(RULES) == 48


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


def test_every_code_in_the_source_is_explained() -> None:
    found = set()
    for path in (path for package in ("rvaft", "backends", "cross_check") for path in (ROOT / package).rglob("*.py")):
        calls = (node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))
        given = (keyword.value for call in calls for keyword in call.keywords if keyword.arg == "rule")
        found |= {str(code.value) for code in given if isinstance(code, ast.Constant)}
    assert {"no-branch", "cycle", "unbound-variable"} <= found <= {*meanings()}


@pytest.mark.parametrize("code", meanings())
def test_explanations(code: str) -> None:
    said, words = explain(code), meanings()[code]
    severity = RULES[code].severity if code in RULES else "error"
    assert said.startswith(f"{code} ({severity}): {words.title}\n\n{words.explanation}")
    assert all(part in said for part in (*words.bad.split("\n"), *words.mended.split("\n")))


def test_the_page_has_every_rule() -> None:
    text = page()
    assert [code for code in RULES if f"## {code}\n" not in text or f"](#{code})" not in text] == []


def test_an_unknown_code_is_answered_with_a_guess() -> None:
    with pytest.raises(UnknownRule, match="did you mean unbound-variable"):
        explain("unbound-variabel")
    assert issubclass(UnknownRule, RvaftError)
    assert issubclass(UnknownRule, KeyError)


def test_checking_an_ordinary_tree_imports_no_algebra() -> None:
    program = (
        "import sys; from rvaft.language.parser import parse; from rvaft.rules.registry import check; "
        f"print([f.code for f in check(parse({meanings()['contradictory-guards'].bad!r}))]); print('sympy' "
        "in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "['contradictory-guards']\nFalse\n"


READING = "event reading(v) = { value: v };\nevent alarm() = { alarm: true };\n"


def lines(text: str) -> list[str]:
    return [str(finding) for finding in check(parse(text))]


@pytest.mark.parametrize(("text", "expected"), rows(__file__, "messages.txt"))
def test_the_message_says_what_and_how_to_mend(text: str, expected: str) -> None:
    assert any(expected in line for line in lines(text)), lines(text)


def test_a_setting_in_an_imported_file_is_named_with_its_place(tmp_path: Path) -> None:
    (tmp_path / "base.rvaft").write_text("top and a b;\na when 1 < 2;\nb;\n")
    (tmp_path / "main.rvaft").write_text('import "base.rvaft";\na when 2 < 3;\n')
    [finding] = check(parse_file(tmp_path / "main.rvaft"))
    assert finding.code == "duplicate-setting"
    assert finding.place.file.endswith("main.rvaft")
    assert "base.rvaft:2:3" in finding.message


def test_a_galileo_tree_has_no_findings() -> None:
    text = 'toplevel "A";\n"A" or "B" "C" "D";\n"B" lambda=0.1 dorm=0;\n"C" lambda=0.2;\n"D" 2of3 "E" "F" "G";\n'
    assert lines(text + '"E" prob=0.1;\n"F" prob=0.1;\n"G" prob=0.1;\n') == []


def test_require_valid_raises_the_first_error_each_time() -> None:
    tree = parse(READING + "top or a b;\na on reading(_);\nb when 1 < 2;\n").build()
    for _ in range(2):
        with pytest.raises(TreeError) as caught:
            require_valid(tree)
        assert caught.value.rule == "silent-scenario"
        assert caught.value.nodes == ("b",)
    require_valid(loads("top and a b;\na;\nb;\nc and d;\nd;\ntoplevel top;\n"))


def test_a_tree_built_in_code_is_asked_about_its_ignores() -> None:
    event = EventType("reading", ("v",), ObjectPattern((("value", Variable("v")),)))
    ignore = Ignore(On("reading", (Variable("V"),)), Operation(Operator.LT, (Variable("W"), Literal(3))))
    tree = RVAFT("top", [Node("top", Gate.AND, ("a",)), Node("a")], [event], ignores=[ignore])
    assert "ignore-variable" in {finding.code for finding in check_tree(tree)}
    with pytest.raises(TreeError, match="ignore-variable"):
        require_valid(tree)


def test_beyond_the_limit_a_rule_says_undecided() -> None:
    text = "top and p q;\np sand x a;\nq sand y b;\nx or s t;\ny or s u;\na or s v;\nb or t s;\n"
    tree = loads(text + "".join(f"{name};\n" for name in "stuv"))
    within = {finding.code for finding in check_tree(tree)}
    assert "undecided" not in within
    assert "infeasible-scenario" in within
    beyond = [finding for finding in check_tree(tree, limit=1) if finding.code == "undecided"]
    assert {finding.message.split()[0] for finding in beyond} >= {"infeasible-scenario", "shared-under-order"}


def test_at_most_fifty_pairs_are_listed() -> None:
    names = [f"a{i}" for i in range(30)]
    declared = "".join(f"{name} on alarm();\n" for name in names)
    tree = loads(f"{READING}top and {' '.join(names)};\n{declared}ignore reading(_);\n")
    found = [finding for finding in check_tree(tree) if finding.code == "ambiguous-event"]
    assert len(found) == 51
    assert any("more than 50" in finding.message for finding in found)
