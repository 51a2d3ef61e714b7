"""What single findings say, and where."""

from pathlib import Path

import pytest

from rvaft.api import loads
from rvaft.errors import TreeError
from rvaft.language.parser import parse, parse_file
from rvaft.model.guards import Operation, Operator
from rvaft.model.nodes import EventType, Gate, Ignore, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.tree import RVAFT
from rvaft.rules import check, check_tree, require_valid
from tests.tables import rows

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
    tree = loads(
        READING
        + "top and "
        + " ".join(f"a{i}" for i in range(30))
        + ";\n"
        + "".join(f"a{i} on alarm();\n" for i in range(30))
        + "ignore reading(_);\n"
    )
    found = [finding for finding in check_tree(tree) if finding.code == "ambiguous-event"]
    assert len(found) == 51
    assert found[-1].message.startswith("more than 50") or any("more than 50" in f.message for f in found)
