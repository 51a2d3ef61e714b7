"""The grammar has no conflicts; the words of messages are its words; the examples of the
reference page load.
"""

import logging
import re
from importlib.resources import files
from pathlib import Path

import pytest
from lark import Lark, logger

from rvaft import dumps, load, loads
from rvaft.language.diagnostics import expectation
from rvaft.language.parser import parse
from rvaft.model.expressions import CLAUSES, DYNAMIC, GATES, OPERATOR_WORDS, RESERVED, STATEMENTS, bare_name, name_text

GRAMMAR = files("rvaft.language").joinpath("grammar.lark").read_text(encoding="utf-8")
LARK = Lark(GRAMMAR, parser="lalr", start=["tree", "only_pattern", "only_guard"])
TERMINALS = {terminal.name: terminal for terminal in LARK.terminals}
DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "reference" / "language.md").read_text(encoding="utf-8")
BLOCKS: list[tuple[str, str]] = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
TREES = [text for language, text in BLOCKS if language == "rvaft"]
WORKED = re.findall(
    r"^```\w*\n(// Robot damaged.*?)^```$", (DOCS / "semantics.md").read_text("utf-8"), re.MULTILINE | re.DOTALL
)


def test_it_has_no_conflicts(caplog: pytest.LogCaptureFixture) -> None:
    """Lark settles a conflict of shift and reduce by itself and says so only here."""
    level = logger.level
    try:
        with caplog.at_level(logging.DEBUG, logger.name):
            Lark(GRAMMAR, parser="lalr", start=["tree", "only_pattern", "only_guard"], debug=True)
            Lark('start: a | a "x"\na: "y" | "y" "x"', parser="lalr", debug=True)
    finally:
        logger.setLevel(level)
    said = [record.getMessage() for record in caplog.records if "onflict" in record.getMessage()]
    assert len(said) == 1, said  # of the second grammar, which shows that they would be seen


def test_words_are_those_of_the_grammar() -> None:
    found = re.search(r"\(\?!\(\?:(.*?)\)\(\?!", TERMINALS["NAME"].pattern.value)
    assert found is not None
    assert set(found[1].split("|")) == RESERVED | {"vot[0-9]+"}
    for word in (*STATEMENTS, *GATES, *CLAUSES, *OPERATOR_WORDS):
        assert TERMINALS[word.upper()].pattern.value == rf"{word}(?!\w)"
    assert not DYNAMIC & {*STATEMENTS, *GATES, *CLAUSES}


@pytest.mark.parametrize("word", sorted([*RESERVED, "vot2", "a", "_", "a1", "1a", "a-b", "é", "", "2of3"]))
def test_a_name_is_quoted_where_it_must(word: str) -> None:
    assert bare_name(word) == (name_text(word) == word) == bool(re.fullmatch(TERMINALS["NAME"].pattern.value, word))
    assert list(parse(f"{name_text(word)};").nodes) == [word]


def test_every_state_of_the_parser_has_an_expectation_in_words() -> None:
    states = LARK.parser.parser._parse_table.states.values()
    assert len(states) > 100
    for state in states:
        terminals = frozenset(state.keys() & (TERMINALS.keys() | {"$END"}))
        assert not terminals or expectation(terminals)


def test_the_page_has_examples() -> None:
    assert {language for language, _ in BLOCKS} == {"rvaft"}
    assert len(TREES) >= 8
    assert len(WORKED) == 1


@pytest.mark.parametrize("text", [*TREES, *WORKED], ids=lambda text: text.splitlines()[0])
def test_an_example_loads(text: str, tmp_path: Path) -> None:
    for example in TREES:
        if example.startswith("// file: "):
            (tmp_path / example.split()[2]).write_text(example, encoding="utf-8")
    (path := tmp_path / "example.rvaft").write_text(text, encoding="utf-8")
    tree = load(path)
    assert loads(dumps(tree)) == tree
    drive = load(tmp_path / "drive.rvaft")
    assert (drive.root, set(drive.nodes)) == ("Drive", {"System", "Drive", "Motor", "Wheel"})
