"""Whatever the text, only `LanguageError` and `TreeError` come out."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rvaft.errors import LanguageError, TreeError
from rvaft.language.parser import parse, parse_guard, parse_pattern
from rvaft.language.printer import dumps
from rvaft.model.expressions import RESERVED

TOKENS = [
    *sorted(RESERVED), "true", "false", "null", "a", "b", "X", "_", "_x", "2of3", "0of0", "vot2", "1", "-1", "1.5e3", "007",
    '"s"', '"a b"', '"', "'", ";", ";", ";", ",", ":", "=", "(", ")", "{", "}", "[", "]", "+", "-", "*", "/", "==", "<", "!=",
    "//", "#", "/*", "*/", "\n", "\t", "\\", "&&", "||", "!", "é", "“", "lambda=0.1", "\0", "\ufeff", "\x85", "\u2028", "\r", "$",
]  # fmt: skip
EXAMPLE = """\
event move(wp, t) = { topic: "/command", name: "move", waypoint: wp, time: [t, _, -1.5] };
causality bottom_up; param x; prune d; ignore move(V, "x") when not V < 250 and (V == 1 or true);
toplevel a; a 2of3 b c "d e" on move(Way, _) when -Way + 3 * 2 >= 1 fault label "text"; // comment
b sand d f; /* more */ c or f g lambda=0.1 dorm=x;
"""


def only_own_errors(text: str) -> None:
    with contextlib.suppress(LanguageError, TreeError):
        dumps(parse(text).build())
    for parse_one in (parse_guard, parse_pattern):
        with contextlib.suppress(LanguageError):
            parse_one(text)


@settings(deadline=None)
@given(st.lists(st.sampled_from(TOKENS), max_size=25), st.sampled_from(["", " "]))
def test_token_soup(tokens: list[str], between: str) -> None:
    only_own_errors(between.join(tokens))


@settings(deadline=None)
@given(st.text(max_size=30))
def test_any_characters(text: str) -> None:
    only_own_errors(text)


@settings(deadline=None)
@given(st.data())
def test_a_text_with_something_changed(data: st.DataObject) -> None:
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
