"""What people are told when a text is not in the language: where, what, and how to mend it; and
nothing else ever comes out.
"""

import contextlib
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rvaft import LanguageError, TreeError, dumps, loads
from rvaft.language.parser import parse, parse_guard, parse_pattern
from rvaft.model.expressions import RESERVED
from rvaft.model.guards import FUNCTIONS, OPERATORS, Operator
from tests.tables import rows

FUNCTION_NAMES = ", ".join(OPERATORS[one].sign for one in Operator if one in FUNCTIONS)
"""What stands for `<functions>` in a message, so that a function that is added needs no edit here."""

SLIPS = [
    *rows(__file__, "slips.txt"),
    (f"a when X > {'1' * 400};", 1, 12, "too large for a double"),
    (f"a on e(-{'1' * 400});", 1, 9, "too large for a double"),
    (f"a when X > {'1' * 5000};", 1, 12, "a number of 5000 digits is too long"),
    (f"a when X > {'1' * 5000}.5;", 1, 12, "too large for a double"),
    (f'a when like(X, "{"*" * 10_000}");', 1, 8, "a string in quotes, of at most 1000 characters"),
    (f"a times {'1' * 5000};", 1, 9, "a number of 5000 digits is too long"),
    (f"a or b within {'1' * 5000} s;", 1, 15, "it is too long"),
    (f"a {'1' * 5000}of3 b c d;", 1, 3, "a number of 5000 digits is too long"),
]


@pytest.mark.parametrize(("text", "line", "column", "message"), SLIPS)
def test_a_slip_is_named_at_its_place(text: str, line: int, column: int, message: str) -> None:
    with pytest.raises(LanguageError) as caught:
        parse(text, "some.rvaft")
    error = caught.value
    assert message.replace("<functions>", FUNCTION_NAMES) in error.message
    assert (error.file, error.line, error.column) == ("some.rvaft", line, column)
    assert "\n" not in error.message
    assert str(error).startswith(f"some.rvaft:{line}:{column}: {error.message}")


@pytest.mark.parametrize(("text", "rule", "place", "culprit"), rows(__file__, "broken.txt"))
def test_a_broken_rule_is_named(text: str, rule: str, place: str, culprit: str) -> None:
    with pytest.raises(TreeError) as caught:
        loads(text, "f.rvaft")
    error = caught.value
    assert error.rule == rule
    assert error.message.startswith(f"f.rvaft:{place}")
    assert not culprit or culprit in error.nodes
    assert "\n" not in str(error)


def test_the_caret_stands_below_the_slip() -> None:
    with pytest.raises(LanguageError) as caught:
        parse("a;\r\nb\twhen x > 3;\r\n")
    assert caught.value.caret == "b\twhen x > 3;\n \t     ^"
    for text in ("a or " + "b " * 10_000 + "!;", "a \x1b[2Jb;"):  # a long line and control characters are not shown
        with pytest.raises(LanguageError) as caught:
            parse(text)
        assert len(str(caught.value)) < 300
        assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize(
    ("parse_one", "text", "column", "message"),
    [
        (parse_guard, "X >", 4, "expected a value"),
        (parse_guard, "x", 1, "is not a variable"),
        *(
            (parse_pattern, text, column, None)
            for text, column in (("{ a: }", 6), ("", 1), ("[1, 2", 6), ("{a: 1} b", 8))
        ),
    ],
)
def test_guards_and_patterns_alone(
    parse_one: Callable[[str], object], text: str, column: int, message: str | None
) -> None:
    with pytest.raises(LanguageError, match=message) as caught:
        parse_one(text)
    assert (caught.value.line, caught.value.column) == (1, column)


@pytest.mark.parametrize("step", ["not ", "- ", "1 + ", "X * ", "[ ]", "{ b: }"])
def test_nesting_has_a_limit(step: str) -> None:
    is_pattern = step[0] in "[{"
    least = 99 if is_pattern else 100  # the braces of the event type count

    def text(depth: int) -> str:
        if is_pattern:
            return f"event e() = {{ a: {step[:-1] * depth}1{step[-1] * depth} }}; a;"
        return f"a when {step * depth}X;"

    parse(text(least))
    for depth in (least + 1, 20_000):
        with pytest.raises(
            LanguageError, match=f"this {'pattern' if is_pattern else 'guard'} is nested deeper than 100"
        ):
            parse(text(depth))
    guard = "(" * 2000 + "X" + ")" * 2000 + " and X" * 2000  # parentheses and long junctions are no nesting
    assert len(getattr(parse_guard(guard), "operands")) == 2001  # noqa: B009 - any guard has them here


TOKENS = [
    *sorted(RESERVED),
    "true",
    "false",
    "null",
    "a",
    "b",
    "X",
    "_",
    "_x",
    "2of3",
    "0of0",
    "vot2",
    "1",
    "-1",
    "1.5e3",
    "007",
    '"s"',
    '"a b"',
    '"',
    "'",
    ";",
    ";",
    ";",
    ",",
    ":",
    "=",
    "(",
    ")",
    "{",
    "}",
    "[",
    "]",
    "+",
    "-",
    "*",
    "/",
    "==",
    "<",
    "!=",
    "time",
    "as",
    "s",
    "late",
    "5 s",
    "semantics",
    "strict",
    "in",
    "at(",
    "end",
    "like",
    "min",
    ".",
    "//",
    "#",
    "/*",
    "*/",
    "\n",
    "\t",
    "\\",
    "&&",
    "||",
    "!",
    "é",
    "“",
    "lambda=0.1",
    "\0",
    "\ufeff",
    "\x85",
    "\u2028",
    "\r",
    "$",
]
EXAMPLE = """\
event move(wp, t) = { topic: "/command", name: "move", waypoint: wp, time: [t, _, -1.5] };
causality bottom_up; param x; prune d; ignore move(V, "x") when not V < 250 and (V == 1 or true);
toplevel a; a 2of3 b c "d e" on move(Way, _) when -Way + 3 * 2 >= 1 fault label "text"; // comment
b sand d f within 1.5 h; /* more */ c or f g lambda=0.1 dorm=x; f times 3; semantics scattered;
time "@t".x as iso8601 late 5 s; d when at(a) - end("d e") <= 5 min and like(lower(V), "*.exe") and not V in (1, "a");
"""


def only_own_errors(text: str) -> None:
    with contextlib.suppress(LanguageError, TreeError):
        dumps(parse(text).build())
    for parse_one in (parse_guard, parse_pattern):
        with contextlib.suppress(LanguageError):
            parse_one(text)


@given(st.lists(st.sampled_from(TOKENS), max_size=25), st.sampled_from(["", " "]), st.text(max_size=30), st.data())
def test_whatever_the_text(tokens: list[str], between: str, wild: str, data: st.DataObject) -> None:
    only_own_errors(between.join(tokens))
    only_own_errors(wild)
    start = data.draw(st.integers(0, len(EXAMPLE)))
    end = data.draw(st.integers(start, min(start + 12, len(EXAMPLE))))
    only_own_errors(EXAMPLE[:start] + data.draw(st.sampled_from(["", *TOKENS])) + EXAMPLE[end:])


def test_every_beginning_of_a_text() -> None:
    parse(EXAMPLE)
    for end in range(len(EXAMPLE)):
        only_own_errors(EXAMPLE[:end])


@pytest.mark.parametrize("open_", ["(", "[", "{", "{ a: ", "/*", '"', "not ", "-", "a or (", "when "])
def test_a_long_way_in_and_never_out(open_: str) -> None:
    for before in ("", "a when ", "event e() = { a: "):
        with pytest.raises(LanguageError):
            parse(before + open_ * 20_000)
