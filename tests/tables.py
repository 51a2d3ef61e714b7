"""Tables of data beside the tests that read them: each line is a row in JSON, or a comment after `#`."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet


def rows(test: str, name: str) -> list[Any]:
    """The rows of the table of that name in the folder of a test."""
    lines = Path(test).with_name(name).read_text(encoding="utf-8").split("\n")
    return [json.loads(line) for line in lines if line and not line.startswith("#")]


def sampled(
    cases: Iterable[Any], one_in: int, mark: pytest.MarkDecorator = pytest.mark.ci, *, ci: int = 1
) -> list[ParameterSet]:
    """All cases as parameters; `make test` runs one in so many, and `.ci/run` the others too.

    A case is one value, or a tuple or row with a value for each argument; values may be parameters with
    marks of their own. With `ci`, `.ci/run` runs
    one in so many of the others, and `make slow` the rest; with the mark `slow`, it runs them all.
    """
    found, other = list[ParameterSet](), 0
    for number, case in enumerate(cases):
        values, marks = list[Any](), list[Any]()
        for one in [case] if isinstance(case, ParameterSet) or not isinstance(case, (tuple, list)) else case:
            values += one.values if isinstance(one, ParameterSet) else [one]
            marks += one.marks if isinstance(one, ParameterSet) else []
        if number % one_in:
            marks.append(mark if other % ci == 0 else pytest.mark.slow)
            other += 1
        found.append(pytest.param(*values, marks=marks))
    return found


def spelled(text: str | list[str | list[Any]]) -> bytes:
    """The bytes of a text, each a character: a list holds its pieces, and pairs of a piece and how
    often it stands there.
    """
    pieces = [text] if isinstance(text, str) else [one if isinstance(one, str) else one[0] * one[1] for one in text]
    return "".join(pieces).encode("latin-1")


def part_and_whole(part: Any, whole: Any) -> list[ParameterSet]:
    """A parameter for `make test`, and one for `.ci/run`, whose check contains the other."""
    return [pytest.param(part, marks=pytest.mark.sample), pytest.param(whole, marks=pytest.mark.ci)]
