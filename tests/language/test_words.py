"""The words that messages use are those of the grammar."""

import re
from importlib.resources import files

import pytest
from lark import Lark

from rvaft.language.parser import parse
from rvaft.language.diagnostics import expectation
from rvaft.model.expressions import CLAUSES, DYNAMIC, GATES, OPERATOR_WORDS, RESERVED, STATEMENTS, bare_name, name_text

GRAMMAR = files("rvaft.language").joinpath("grammar.lark").read_text(encoding="utf-8")
TERMINALS = {t.name: t for t in Lark(GRAMMAR, parser="lalr", start="tree").terminals}


def test_reserved_words_are_those_of_the_grammar() -> None:
    found = re.search(r"\(\?!\(\?:(.*?)\)\(\?!", TERMINALS["NAME"].pattern.value)
    assert found is not None
    assert set(found[1].split("|")) == RESERVED | {"vot[0-9]+"}


def test_keywords_are_terminals_of_their_own() -> None:
    for word in (*STATEMENTS, *GATES, *CLAUSES, *OPERATOR_WORDS):
        assert TERMINALS[word.upper()].pattern.value == rf"{word}(?!\w)"
    assert not DYNAMIC & {*STATEMENTS, *GATES, *CLAUSES}


@pytest.mark.parametrize("word", sorted([*RESERVED, "vot2", "a", "_", "a1", "1a", "a-b", "é", "", "2of3"]))
def test_a_name_is_quoted_where_it_must(word: str) -> None:
    assert bare_name(word) == (name_text(word) == word) == bool(re.fullmatch(TERMINALS["NAME"].pattern.value, word))
    assert list(parse(f"{name_text(word)};").nodes) == [word]


def test_every_state_of_the_parser_has_an_expectation_in_words() -> None:
    parser = Lark(GRAMMAR, parser="lalr", start=["tree", "only_pattern", "only_guard"])
    states = parser.parser.parser._parse_table.states.values()
    assert len(states) > 100
    for state in states:
        terminals = frozenset(state.keys() & (TERMINALS.keys() | {"$END"}))
        assert not terminals or expectation(terminals)
