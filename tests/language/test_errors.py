"""What people are told when a text is not in the language: where, what, and how to mend it."""

import pytest

from rvaft.errors import LanguageError
from rvaft.language.parser import parse, parse_guard, parse_pattern
from tests.tables import rows

SLIPS = [
    *rows(__file__, "slips.txt"),
    (f"a when X > {'1' * 400};", 1, 12, "too large for a double"),
    (f"a on e(-{'1' * 400});", 1, 9, "too large for a double"),
    (f"a when X > {'1' * 5000};", 1, 12, "a number of 5000 digits is too long"),
    (f"a when X > {'1' * 5000}.5;", 1, 12, "too large for a double"),
    (f"a {'1' * 5000}of3 b c d;", 1, 3, "a number of 5000 digits is too long"),
]


@pytest.mark.parametrize(("text", "line", "column", "message"), SLIPS)
def test_a_slip_is_named_at_its_place(text: str, line: int, column: int, message: str) -> None:
    with pytest.raises(LanguageError) as caught:
        parse(text, "some.rvaft")
    error = caught.value
    assert message in error.message
    assert (error.file, error.line, error.column) == ("some.rvaft", line, column)
    assert "\n" not in error.message
    assert str(error).startswith(f"some.rvaft:{line}:{column}: {error.message}")


def test_the_caret_stands_below_the_slip() -> None:
    with pytest.raises(LanguageError) as caught:
        parse("a;\r\nb\twhen x > 3;\r\n")
    assert caught.value.caret == "b\twhen x > 3;\n \t     ^"


@pytest.mark.parametrize(("text", "column", "message"), [("X >", 4, "expected a value"), ("x", 1, "is no variable")])
def test_guards_alone(text: str, column: int, message: str) -> None:
    with pytest.raises(LanguageError, match=message) as caught:
        parse_guard(text)
    assert (caught.value.line, caught.value.column) == (1, column)


@pytest.mark.parametrize(("text", "column"), [("{ a: }", 6), ("", 1), ("[1, 2", 6), ("{a: 1} b", 8)])
def test_patterns_alone(text: str, column: int) -> None:
    with pytest.raises(LanguageError) as caught:
        parse_pattern(text)
    assert (caught.value.line, caught.value.column) == (1, column)


@pytest.mark.parametrize(
    ("before", "step", "after"),
    [
        ("event e() = { a: ", "[", "]"),
        ("event e() = { a: ", "{ b: ", "}"),
        ("a when ", "not ", ""),
        ("a when ", "- ", ""),
        ("a when ", "1 + ", ""),
        ("a when ", "X * ", ""),
    ],
)
def test_nesting_has_a_limit(before: str, step: str, after: str) -> None:
    kind = "pattern" if "event" in before else "guard"

    def text(depth: int) -> str:
        core = "1" if kind == "pattern" else "X"
        return before + step * depth + core + after * depth + (" }; a;" if kind == "pattern" else ";")

    least = 99 if kind == "pattern" else 100  # the braces of the event type count
    parse(text(least))
    for depth in (least + 1, 20_000):
        with pytest.raises(LanguageError, match=f"this {kind} is nested deeper than 100"):
            parse(text(depth))


def test_parentheses_and_long_junctions_are_no_nesting() -> None:
    guard = "(" * 2000 + "X" + ")" * 2000 + " and X" * 2000
    assert len(getattr(parse_guard(guard), "operands")) == 2001  # noqa: B009 - any guard has them here


def test_a_long_line_is_not_shown() -> None:
    with pytest.raises(LanguageError) as caught:
        parse("a or " + "b " * 100_000 + "!;")
    assert len(str(caught.value)) < 300


def test_control_characters_do_not_reach_the_terminal() -> None:
    with pytest.raises(LanguageError) as caught:
        parse("a \x1b[2Jb;")
    assert "\x1b" not in str(caught.value)
