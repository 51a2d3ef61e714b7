"""Lexemes of texts with and without errors, the table of words, and the layout of texts."""

import re
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rvaft
from rvaft.errors import RvaftError
from rvaft.language.formatting import NotFormatted, formatted
from rvaft.language.lexemes import accepted, lexemes, patterns, statements, words_of
from rvaft.language.parser import SUFFIXES
from rvaft.language.words import WORDS, Sort
from rvaft.model.event_time import TimeFormat
from rvaft.model.expressions import GATES, RESERVED
from rvaft.model.guards import FUNCTIONS, POINTS

ROOT: Final = Path(__file__).parents[2]
TREES: Final = sorted(
    file
    for folder in ("trees", "docs/first", "docs/logs", "docs/findings")
    for file in (ROOT / folder).rglob("*")
    if file.suffix in SUFFIXES
)
TEXTS: Final = {str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in TREES}
PAGE: Final = " ".join((ROOT / "docs" / "reference" / "language.md").read_text(encoding="utf-8").split())
PIECES: Final = st.lists(
    st.sampled_from(
        [
            *("top", " ", "\n", "\r\n", ";", "or", "a", "on", "event", "(", ")", "{", "}", "=", ":", '"', '"x y"'),
            *("/*", "*/", "// c", "#", "10 min", "2of3", "@", "\ufeff", "é", "😀", "when", "<", "\\", "time"),
            *("as", "iso8601", "'"),
        ]
    ),
    max_size=25,
).map("".join)


def significant(text: str) -> list[str]:
    """The lexemes of a text but blanks; comments without the blanks at their end."""
    return [one.text.rstrip() for one in lexemes(text) if one.sort is not Sort.BLANK]


@pytest.mark.parametrize("name", TEXTS)
def test_a_tree_is_its_lexemes_and_has_no_error(name: str) -> None:
    text = TEXTS[name]
    found = list(lexemes(text))
    assert "".join(one.text for one in found) == text
    assert [one for one in found if one.sort is Sort.ERROR] == []
    assert all(one.complete for one in statements(text))


@given(PIECES)
def test_any_text_is_its_lexemes(text: str) -> None:
    position = 0
    for one in lexemes(text):
        assert one.start == position
        position = one.end
    assert "".join(one.text for one in lexemes(text)) == text


@pytest.mark.parametrize("part", ["a on ); ", "topic /*", '"', "pdep = 1", "/*/", ");", '"a\\'])
def test_a_text_with_many_errors_is_read(part: str) -> None:
    text = part * 5_000
    assert "".join(one.text for one in lexemes(text)) == text


def test_what_follows_an_error_is_read() -> None:
    text = "top or a b\nevent e(x) = { x: x };\na on ) e(X);\nb fault; c or 'd"
    found = {one.text: one for one in reversed(list(lexemes(text)))}
    assert [one.lexemes[0].text for one in statements(text)] == ["top", "event", "a", "b", "c"]
    assert [one.complete for one in statements(text)] == [False, True, False, True, False]
    assert (found["e"].sort, found["b"].sort, found["fault"].sort) == (Sort.EVENT, Sort.NODE, Sort.CLAUSE)
    assert found["'"].sort is Sort.ERROR


def test_the_sorts_of_names_are_those_of_their_places() -> None:
    text = (
        'time time as iso8601; event time(or: text) = { "when": or, on: [_, 1] }; "or" or time; '
        'time on time(X) when X or at(time) > at("or");'
    )
    found = [(one.text, one.sort.value) for one in lexemes(text) if one.sort not in (Sort.BLANK, Sort.SIGN)]
    assert found == [
        *(("time", "statement"), ("time", "field"), ("as", "clause"), ("iso8601", "choice")),
        *(("event", "statement"), ("time", "event"), ("or", "parameter"), ("text", "choice")),
        *(('"when"', "field"), ("or", "parameter"), ("on", "field"), ("_", "constant"), ("1", "number")),
        *(('"or"', "node"), ("or", "gate"), ("time", "node")),
        *(("time", "node"), ("on", "clause"), ("time", "event"), ("X", "variable"), ("when", "clause")),
        *(("X", "variable"), ("or", "operator"), ("at", "function"), ("time", "node"), (">", "operator")),
        *(("at", "function"), ('"or"', "node")),
    ]


def test_every_keyword_has_a_meaning() -> None:
    keywords = {word for terminal in patterns() for word in words_of(terminal)}
    known = {word for words in WORDS.values() for word in words}
    assert keywords <= known
    assert {*GATES, *FUNCTIONS, *POINTS, *TimeFormat} <= known
    assert RESERVED - known == {"xor", "nor", "nand", "pxor", "inhibit", "rdep"}  # refused gates
    assert known - keywords == {"2of3", "pdep", *TimeFormat}


def test_the_meanings_are_the_words_of_the_page() -> None:
    for words in WORDS.values():
        for word, (usage, meaning) in words.items():
            assert f"`{usage}`" in PAGE, word
            assert meaning in PAGE, word


@pytest.mark.parametrize(
    ("text", "terminals"),
    [
        ("a on ", "STRING WORD"),
        ("a on e() times 2 distinct ", "VARIABLE"),
        ("toplevel ", "NAME STRING"),
        ("a without e() for ", "DURATION"),
        ("a on )", ""),
    ],
)
def test_the_grammar_says_what_can_follow(text: str, terminals: str) -> None:
    assert accepted(text) == {*terminals.split()}


def test_a_first_word_can_be_read_as_a_keyword() -> None:
    assert "ON" in accepted("semantics ")
    assert accepted("semantics ", "SEMANTICS") == {"WORD"}


# Layout


@pytest.mark.parametrize("name", TEXTS)
def test_the_layout_keeps_the_lexemes_and_the_tree(name: str) -> None:
    text = TEXTS[name]
    laid_out = formatted(text)
    assert significant(laid_out) == significant(text)
    assert formatted(laid_out) == laid_out
    try:
        tree = rvaft.loads(text, str(ROOT / name))
    except RvaftError:
        return
    assert rvaft.loads(laid_out, str(ROOT / name)) == tree
    assert formatted(rvaft.dumps(tree)) == rvaft.dumps(tree)


@given(PIECES)
def test_the_layout_of_any_text_keeps_its_lexemes(text: str) -> None:
    try:
        laid_out = formatted(text)
    except NotFormatted:
        return
    assert significant(laid_out) == significant(text)
    assert formatted(laid_out) == laid_out


@given(st.sampled_from(TREES), st.data())
def test_the_layout_does_not_depend_on_the_blanks_of_a_line(tree: Path, data: st.DataObject) -> None:
    """More blanks where there are some give the same layout."""
    text = TEXTS[str(tree.relative_to(ROOT))]
    more = data.draw(st.integers(1, 3))
    wider = "".join(
        re.sub(r" +", " " * more, one.text) if one.sort is Sort.BLANK and "\n" not in one.text else one.text
        for one in lexemes(text)
    )
    assert formatted(wider) == formatted(text)


def test_lines_are_indented_and_aligned() -> None:
    text = (
        "/* two\n   lines */\n\n\n\nevent  e(x) = {\n  x: x,\n        y: [\n 1\n   ]\n};   \n"
        'top or a long ;// one\na fault ;  // two\n  // between\nlong\non e(X)   label  "x  y" ;'
    )
    assert formatted(text) == (
        "/* two\n   lines */\n\nevent e(x) = {\n  x: x,\n  y: [\n    1\n  ]\n};\n"
        'top or a long;        // one\na             fault;  // two\n// between\nlong\n  on e(X) label "x  y";\n'
    )


def test_the_layout_keeps_the_line_breaks_of_windows() -> None:
    assert formatted("top   or a b;\r\na fault; // x\r\n") == "top or a b;\r\na          fault;  // x\r\n"


@pytest.mark.parametrize("text", ["top or a", "top or a b; a on ;", "top @;", '"a', "/* a"])
def test_a_text_with_an_error_has_no_layout(text: str) -> None:
    with pytest.raises(NotFormatted):
        formatted(text)
