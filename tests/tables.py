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
    cases: Iterable[tuple[Any, ...]], one_in: int, mark: pytest.MarkDecorator = pytest.mark.ci
) -> list[ParameterSet]:
    """All cases as parameters; `make test` runs one in so many, and `.ci/run` the others too.

    With the mark `slow`, the others run by hand only.
    """
    others = [mark]
    return [pytest.param(*case, marks=others if number % one_in else []) for number, case in enumerate(cases)]


def spelled(text: str | list[str | list[Any]]) -> bytes:
    """The bytes of a text, each a character: a list holds its pieces, and pairs of a piece and how
    often it stands there.
    """
    pieces = [text] if isinstance(text, str) else [one if isinstance(one, str) else one[0] * one[1] for one in text]
    return "".join(pieces).encode("latin-1")
