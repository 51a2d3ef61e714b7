"""Every text that is not RML, or that cannot run, is a `LanguageError` with its place."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends.rml.prolog import prolog
from backends.rml.reader.monitor import read
from rvaft.errors import LanguageError, TooLarge
from tests.tables import rows

A = "a matches {e:'a'};\n"

ERRORS = [
    *rows(__file__, "errors.txt"),
    (f"a matches {{v:{'9' * 5000}}};\nMain = a;", 1, 14, "too many digits"),
    (f"a matches {{v:{'9' * 400}.0}};\nMain = a;", 1, 14, "too large"),
]


@pytest.mark.parametrize(("text", "line", "column", "words"), ERRORS, ids=lambda v: repr(v)[:40])
def test_errors_say_what_and_where(text: str, line: int, column: int, words: str) -> None:
    with pytest.raises(LanguageError) as caught:
        read(text)
    error = caught.value
    assert words in error.message
    assert (error.line, error.column) == (line, column)
    assert "\n" not in error.message
    assert error.__cause__ is None


@pytest.mark.parametrize("text", [error[0] for error in ERRORS[:12]])
def test_the_prolog_form_has_the_same_errors(text: str) -> None:
    with pytest.raises(LanguageError):
        prolog(text)


def test_the_source_line_comes_with_the_error() -> None:
    with pytest.raises(LanguageError) as caught:
        read(A + "Main = a ) b;")
    assert caught.value.caret == "Main = a ) b;\n         ^"


def test_a_long_line_is_not_quoted_whole() -> None:
    with pytest.raises(LanguageError) as caught:
        read(A + "Main = " + "a " * 5000 + ");")
    assert len(str(caught.value)) < 1000


def test_types_derived_from_each_other_have_a_limit() -> None:
    chain = "".join(f"t{i} matches t{i + 1};\n" for i in range(1000))
    with pytest.raises(TooLarge):
        read(chain + "t1000 matches {e:'a'};\nMain = t0;")


NAMES = "a b x S T Main matches not with all empty let var if else any none true false null abs max _ 1 2.5 'x' 'y' //"
SIGNS = "( ) { } [ ] < > << >> >= <= == != = ; : , . ... | || /\\ \\/ & && * + - / ^ ? !"
WORDS = ["\n", *NAMES.split(), *SIGNS.split()]


@settings(deadline=None, max_examples=300)
@given(st.lists(st.sampled_from(WORDS), max_size=30))
def test_any_words_are_read_or_refused(words: list[str]) -> None:
    for text in (" ".join(words), A + "Main = " + " ".join(words) + ";"):
        try:
            monitor = read(text)
        except LanguageError:
            continue
        monitor.step({"e": "a", "v": 1})


@settings(deadline=None, max_examples=100)
@given(st.text(max_size=40))
def test_any_text_is_read_or_refused(text: str) -> None:
    with pytest.raises(LanguageError):
        read(text)
