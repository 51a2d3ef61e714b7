"""All words over some letters."""

from itertools import islice

import pytest

from cross_check.traces import words

A, B, C = {"event": "a"}, {"event": "b"}, {"x": 1}


def test_shorter_before_longer_and_in_the_order_of_the_letters() -> None:
    assert list(words([A, B], 2)) == [(), (A,), (B,), (A, A), (A, B), (B, A), (B, B)]


@pytest.mark.parametrize(("letters", "longest"), [([A], 5), ([A, B], 4), ([A, B, C], 4), ([A, B, C], 0)])
def test_each_word_once(letters: list[dict[str, object]], longest: int) -> None:
    found = [tuple(map(str, word)) for word in words(letters, longest)]
    assert len(found) == len(set(found)) == sum(len(letters) ** length for length in range(longest + 1))
    assert max(map(len, found)) == longest


def test_one_at_a_time() -> None:
    """Of 3^0 + … + 3^1000 words the first ones are there at once; the letters may come from a generator."""
    first = list(islice(words((letter for letter in (A, B, C)), 1_000), 5))
    assert first == [(), (A,), (B,), (C,), (A, A)]


def test_without_letters_there_is_the_empty_word() -> None:
    assert list(words([], 3)) == [()]
