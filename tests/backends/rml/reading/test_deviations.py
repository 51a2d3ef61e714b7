"""Each deviation shown by texts and traces: what the published tools say and what this reader says."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from backends.rml.reader.deviations import DEVIATIONS, touching
from rvaft.model.values import Json
from tests.backends.rml.published.runner import compiled, needs_published, verdicts
from tests.backends.rml.reading.cases import CASES, events
from tests.backends.rml.reading.letters import letters
from tests.tables import rows


@dataclass
class Shown:
    number: int
    text: str
    trace: list[Json]
    published: str
    reader: str


SHOWN = [Shown(*row) for row in rows(__file__, "deviations.txt")]


@pytest.mark.parametrize("row", SHOWN, ids=lambda row: f"{row.number}: {row.text.splitlines()[0]}")
def test_the_reader_says_otherwise_and_the_row_is_touched(row: Shown) -> None:
    assert letters(row.text, row.trace) == row.reader
    assert row.number in [deviation.number for deviation in touching(row.text, row.trace)]


def test_every_row_is_shown_to_differ() -> None:
    differing = {row.number for row in SHOWN if row.published != row.reader}
    assert differing == {deviation.number for deviation in DEVIATIONS}


@pytest.mark.published
@needs_published
def test_the_published_tools_say_so(tmp_path: Path) -> None:
    specifications = compiled([row.text for row in SHOWN], tmp_path)
    jobs = [(Path(path), [row.trace]) for path, row in zip(specifications, SHOWN, strict=True)]
    found = [run[1:] for (run,) in verdicts(jobs)]
    assert found == [row.published for row in SHOWN]


UNTOUCHED = (
    ("a matches {e:'a'};\nMain = a all;", [{"e": "a", "v": 1.0}]),
    ("g(x) matches {v:x} with x > 1;\nMain = g(x) all;", [{"e": "a", "v": 2}]),
    ("a(x) matches {v:x};\nMain = {let x; a(x) a(x) all};", [{"v": [1, "b"]}, {"v": None}]),
    ("a matches {e:'a'};\nb matches {e:'b'};\nMain = (a | b) all;", [{"e": "a"}]),
    ("a(n) matches {v:n};\nMain = G<2>;\nG<n> = if (n > 0) a(n) G<n-1> else all;", [{"v": 2}, {"v": 1}]),
)


@pytest.mark.parametrize(("text", "trace"), UNTOUCHED)
def test_the_predicates_are_not_always_true(text: str, trace: list[Json]) -> None:
    assert touching(text, trace) == []


def test_most_observed_cases_are_untouched() -> None:
    runs = [(case.whole, events(trace)) for case in CASES for trace in case.runs]
    assert sum(not touching(*run) for run in runs) > 0.8 * len(runs)
