"""Every text that is not RML, or that cannot run, is a `LanguageError` with its place."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends.rml.prolog import prolog
from backends.rml.reader.monitor import read
from rvaft.errors import LanguageError, TooLarge

A = "a matches {e:'a'};\n"

ERRORS = (
    # text, line, column, words of the message
    ("", 1, 1, "too early"),
    ("   \n ", 2, 2, "too early"),
    (A, 1, 19, "too early; expected"),
    (A + "Main = a", 2, 9, "too early"),
    (A + "Main = (a b;", 2, 12, "unexpected ';'"),
    (A + "Main = a b);", 2, 11, "unexpected ')'; expected"),
    (A + "Main = a /\\ ;", 2, 13, "unexpected ';'"),
    (A + "Main = a # b;", 2, 10, "unexpected character '#'"),
    ("a matches {e:'a};\nMain = a;", 1, 14, 'unexpected character "\'"'),
    ("a matches {e:'\\x'};\nMain = a;", 1, 14, 'unexpected character "\'"'),
    ("a matches {v:-1};\nMain = a;", 1, 14, "unexpected '-'"),
    ("a matches {v:1e5};\nMain = a;", 1, 15, "unexpected 'e5'"),
    ("a matches {Topic:1};\nMain = a;", 1, 12, "unexpected 'Topic'"),
    ("a matches {_x:1};\nMain = a;", 1, 12, "unexpected '_'"),
    ("a matches {v:1, v:2};\nMain = a;", 1, 17, "the field 'v' is given twice"),
    ("a(1) matches {v:1};\nMain = a;", 1, 1, "must be names"),
    ("a matches b(1) | {v:1};\nMain = a;", 1, 11, "cannot stand beside a pattern"),
    ("a(x) matches {v:x};\nb matches a({v:1|2});\nMain = b;", 2, 11, "no `|` inside an argument"),
    ("a(x) matches {v:x} with abs(x, 1) > 0;\nMain = a(x);", 1, 25, "abs has the wrong number of arguments"),
    ("a(x) matches {v:x} with max(x) > 0;\nMain = a(x);", 1, 25, "max has the wrong number of arguments"),
    ("a matches a;\nMain = a;", 1, 11, "derived from itself"),
    ("a matches b;\nb not matches a;\nMain = a;", 1, 11, "derived from itself"),
    ("min matches {v:1};\nMain = min;", 1, 1, "unexpected 'min'"),
    (A + "Main = a{x};", 2, 10, "unexpected 'x'; expected"),
    (A + "Main = a{1.5};", 2, 10, "unexpected '1.5'"),
    (A + "Main = a('x');", 2, 8, "no argument in an expression"),
    (A + "Main = a(_);", 2, 8, "no argument in an expression"),
    (A + "Main = a({v:1});", 2, 8, "no argument in an expression"),
    (A + "Main = a([]) >> a;", 2, 8, "no argument in an expression"),
    (A + "Main = a (b | c);", 2, 13, "unexpected '|'"),
    (A + "Main = a;\nMain = a;", 3, 1, "Main is defined twice"),
    (A + "Other = a;", 1, 1, "no equation Main"),
    (A + "Main = a Other;", 2, 10, "undefined equation Other"),
    (A + "Main = Main;", 2, 1, "not contractive"),
    (A + "Main = a Loop;\nLoop = a* Loop;", 3, 1, "not contractive"),
    (A + "Main = One;\nOne = Two \\/ a;\nTwo = a? One;", 3, 1, "not contractive"),
    (A + "Main = {let X; a};", 2, 13, "unexpected 'X'; expected"),
    (A + "Main = if (1 < 2) a;", 2, 20, "unexpected ';'"),
    (A + "S<n>= a;\nMain = S<1>;", 2, 4, "unexpected '>='"),
    ("\x00\x01\x02", 1, 1, "unexpected character"),
    ("a matches {e:'a'};\x00Main = a;", 1, 19, "unexpected character"),
    ("PK\x03\x04\ufffd", 1, 3, "unexpected character"),
    (f"a matches {{v:{'9' * 5000}}};\nMain = a;", 1, 14, "too many digits"),
    (f"a matches {{v:{'9' * 400}.0}};\nMain = a;", 1, 14, "too large"),
)


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
