"""What people are told when a text is not in the language: where, what, and how to mend it."""

import pytest

from rvaft.errors import LanguageError
from rvaft.language.parser import parse, parse_guard, parse_pattern

# text, line, column, a piece of the message
SLIPS = [
    # missing semicolons
    ("toplevel a", 1, 11, "a `;` is missing after `a`"),
    ("toplevel a\na or b c;", 1, 11, "a `;` is missing after `a`"),
    ("a or b c\nd and e f;", 1, 9, "a `;` is missing after `c`"),
    ('"a" or "b" "c"\n"d" or "e" "f";', 1, 15, 'a `;` is missing after `"c"`'),
    ("a\nb;", 1, 2, "a `;` is missing after `a`"),
    ("a when X > 3\nb;", 1, 13, "a `;` is missing after `3`"),
    ("event e() = {}\ntoplevel a;", 1, 15, "a `;` is missing after `}`"),
    ('a or b on f() fault label "x"\nd and e f;', 1, 30, 'a `;` is missing after `"x"`'),
    ('"a" or "b"\n"c" wsp "d";', 1, 11, 'a `;` is missing after `"b"`'),
    ("a or b c and d;", 1, 10, "a node has one gate: end the statement before `c` with `;`"),
    ("a or b on e() and d;", 1, 15, "a node has one gate, and this one has one already"),
    # gates
    ("a 2 of 3 b c d;", 1, 3, "without spaces, as in 2of3"),
    ("a 3of 4 b c d e;", 1, 3, "without spaces, as in 3of4"),
    ("a 2/3 b c d;", 1, 3, "without spaces, as in 2of3"),
    ("a xor b c;", 1, 3, "the gate `xor` of `a` has no meaning here yet"),
    ('"A" wsp "B" "C";', 1, 5, "the gate `wsp` of `A` has no meaning here yet"),
    ('"A" pand-incl "B" "C";', 1, 5, "the gate `pand` of `A` has no meaning here yet"),
    ('a;\n"P" pdep=0.2 "A" "S";', 2, 5, "the gate `pdep` of `P` has no meaning here yet"),
    ('"F" fdep "T" "A" ; "A";', 1, 5, "the gate `fdep` of `F` has no meaning here yet"),
    ("a OR b c;", 1, 3, "unknown gate `OR`: did you mean or?"),
    ("a adn b c;", 1, 3, "unknown gate `adn`: did you mean and?"),
    ("a sand_lr b c;", 1, 3, "unknown gate `sand_lr`: did you mean sand_rl?"),
    ("a maybe b c;", 1, 3, "unknown gate `maybe`: the gates are or, and, sand, sand_rl and KofN"),
    ("a on move(X) or b c;", 1, 14, "the gate stands right after the name"),
    ("a and;", 1, 6, "expected a name"),
    ("a or b, c;", 1, 7, "separated by blanks"),
    ("a lambda 0.1;", 1, 3, "an attribute has an equals sign"),
    # words
    ('topleve "A";', 1, 1, "unknown statement `topleve`: did you mean toplevel?"),
    ("evnt e(x) = { a: x };", 1, 1, "unknown statement `evnt`: did you mean event?"),
    ("a or b c whn X > 3;", 1, 10, "unknown word `whn`: did you mean when?"),
    ("a or b c onn move(X);", 1, 10, "unknown word `onn`: did you mean on?"),
    ("a wen X > 3;", 1, 3, "unknown word `wen`: did you mean when?"),
    ("a\n  whn X > 3;\nb;", 2, 3, "unknown word `whn`: did you mean when?"),
    ('a lable "x";', 1, 3, "unknown word `lable`: did you mean label?"),
    ("a falt;", 1, 3, "unknown word `falt`: did you mean fault?"),
    ("causality bottomup;", 1, 11, "did you mean bottom_up?"),
    ("causality up;", 1, 11, "expected top_down or bottom_up"),
    ("ignore f(V) whn V < 3;", 1, 13, "did you mean when?"),
    ("toplevel event;", 1, 10, 'a node named event is written "event"'),
    ("a or spare b;", 1, 6, 'a node named spare is written "spare"'),
    ("B-1 or c d;", 1, 1, 'is quoted: "B-1"'),
    ("a or B-1 d;", 1, 6, 'is quoted: "B-1"'),
    ("9a or c d;", 1, 1, 'is quoted: "9a"'),
    ("Überdruck or c;", 1, 1, 'is quoted: "Überdruck"'),
    # calls
    ("a on move(wp);", 1, 11, '`wp` is no variable, which starts with a capital: Wp; for text write "wp"'),
    ("a on move(_w);", 1, 11, "`_w` is no variable"),
    ("a on move;", 1, 10, "an event type has parentheses: move(…), or move() without arguments"),
    ("a on move(X\nb;", 2, 1, "expected `,` or `)`"),
    ("a on move(X, );", 1, 12, "no comma stands before `)`"),
    ("a on e(1.);", 1, 8, "a number is written as in JSON"),
    # guards
    ("a when X = 3;", 1, 10, "`=` is written == here"),
    ("a when X === 3;", 1, 10, "equality is written =="),
    ("a when X > 3 && Y < 2;", 1, 14, "`&&` is written and here"),
    ("a when X > 3 || Y < 2;", 1, 14, "`||` is written or here"),
    ("a when !X;", 1, 8, "`!` is written not here"),
    ("a when X > 3 AND Y < 3;", 1, 14, "did you mean and?"),
    ("a when X > 3\n  AND Y < 3;", 2, 3, "did you mean and?"),
    ("a or b on f()\n  whn X > 3;", 2, 3, "did you mean when?"),
    ("a or b on f()\nandy and X;", 1, 14, "a `;` is missing after `)`"),
    ("a when NOT X;", 1, 8, "`NOT` is written not"),
    ("a when X != 'foo';", 1, 13, "straight double quotes"),
    ("a when 1 < X < 3;", 1, 14, "comparisons do not chain: write `A < B and B < C`"),
    ("a when 1 < X == Y;", 1, 14, "comparisons do not chain"),
    ("a when X == not Y;", 1, 13, "put parentheses around it"),
    ("a when x > 3;", 1, 8, '`x` is no variable, which starts with a capital: X; for text write "x"'),
    ("a when X > 3 Y==4;", 1, 14, "expected"),
    ("a when X.y > 3;", 1, 9, "unexpected `.`: expected"),
    ("a when X >;", 1, 11, "expected a value"),
    ("a when (X > 3;", 1, 14, "expected `)`"),
    ("a when X > .5;", 1, 12, "a number is written as in JSON"),
    ("a when X > 05;", 1, 12, "a number is written as in JSON"),
    ("a when X > 1e400;", 1, 12, "too large for a double"),
    (f"a when X > {'1' * 400};", 1, 12, "too large for a double"),
    (f"a on e(-{'1' * 400});", 1, 9, "too large for a double"),
    (f"a when X > {'1' * 5000};", 1, 12, "a number of 5000 digits is too long"),
    (f"a when X > {'1' * 5000}.5;", 1, 12, "too large for a double"),
    (f"a {'1' * 5000}of3 b c d;", 1, 3, "a number of 5000 digits is too long"),
    # event types
    ("event e = { a: 3 };", 1, 8, "an event type has parentheses: e(…), or e() without arguments"),
    ("event e(x) { a: x };", 1, 12, "expected `=`"),
    ("event e(x) = x;", 1, 14, "expected `{`"),
    ("event e(x, x) = { a: x };", 1, 12, "the parameter `x` stands twice"),
    (
        "event e(X) = { a: X };",
        1,
        9,
        "`X` is no name for a parameter, which starts with a lower-case letter, as in `x`",
    ),
    ("event e(true) = { a: true };", 1, 9, "`true` is no name for a parameter"),
    ("event e(x) = { a: x, b: y };", 1, 25, "`y` is no parameter of `e`"),
    ("event e(x) = { a: x, b: Y };", 1, 25, "`Y` is no parameter of `e`"),
    ("event e(x) = { a: x, a: 3 };", 1, 22, "the field `a` stands twice"),
    ('event e(x) = { a: x, "a": 3 };', 1, 22, "the field `a` stands twice"),
    ("event e(x) = { a: x, };", 1, 20, "no comma stands before `}`"),
    ("event e(x) = { a x };", 1, 18, "expected `:`"),
    ("event e(x) = { a: 'foo' };", 1, 19, "straight double quotes"),
    ("event e(x) = { a: 1e999 };", 1, 19, "too large for a double"),
    # strings and comments
    ('a label "foo;\nb;', 1, 9, "this string has no end"),
    ("a label foo;", 1, 9, "expected a string in quotes"),
    ("a label “foo”;", 1, 9, "straight double quotes"),
    ('a label "tab\tin";', 1, 9, "is written as an escape"),
    (r'a label "\ud800";', 1, 9, "half of a surrogate pair"),
    (r'a label "\q";', 1, 9, r"a backslash is written \\"),
    ('a label "\ud800";', 1, 10, "half of a surrogate pair"),
    ("/* foo\na;", 1, 1, "this comment has no end"),
    ("a;\n/* foo", 2, 1, "this comment has no end"),
    ("a when X > 3 /* foo;", 1, 14, "this comment has no end"),
    # whatever else
    ("", 1, 1, "there is no tree here"),
    ("// nothing\n", 1, 1, "there is no tree here"),
    ("toplevel a;", 1, 1, "there is no tree here"),
    ("a;\n\0b;", 2, 1, "binary data"),
    ("a;;", 1, 3, "unexpected `;`: expected a statement or the end"),
    ("{}", 1, 1, "unexpected `{`: expected a statement or the end"),
    ("a @ b;", 1, 3, "expected a gate (or, and, sand, sand_rl, 2of3)"),
    ("a lambda=;", 1, 10, "expected a value"),
    ("import robot;", 1, 8, "expected a string in quotes"),
    ('import "no such file.dft";', 1, 8, "cannot import `no such file.dft`: cannot read the file"),
    ("\ufeffa or\r\n  b\r\n  c!;", 3, 4, "unexpected `!`"),
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
