"""CSV and back."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cross_check.benchmark import Outcome, Row
from cross_check.benchmark.tables import COLUMNS, csv_text, read_rows
from rvaft.errors import LanguageError
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from tests.comparison.rows import ROW

texts = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1)
words = st.text(st.characters(exclude_categories=["Cs", "Cc"]))
counts = st.none() | st.integers(0, 10**9)
numbers = st.none() | st.floats(0, 1e12).map(lambda number: float(f"{number:.4g}"))


@st.composite
def rows(draw: st.DrawFn) -> Row:
    some: dict[str, Any] = {
        **{name: draw(counts) for name in ("children", "threshold", "symbols", "subformulas", "states", "edges")},
        **{
            name: draw(counts)
            for name in ("characters", "events", "first_events", "walks", "differing", "limit", "memory")
        },
        **{name: draw(numbers) for name in ("seconds", "read_seconds", "events_per_second", "again_per_second")},
        **{name: draw(words) for name in ("reason", "run_reason", "digest", "version")},
        **{name: draw(texts) for name in ("tree", "language")},
    }
    return Row(
        gate=draw(st.none() | st.sampled_from(Gate)),
        semantics=draw(st.sampled_from(Semantics)),
        result=draw(st.sampled_from(Outcome)),
        run=draw(st.none() | st.sampled_from(Outcome)),
        timeout=draw(st.floats(0.001, 1e6)),
        seed=draw(st.integers()),
        **some,
    )


@given(st.lists(rows(), max_size=4))
def test_what_is_written_is_read(found: list[Row]) -> None:
    text = csv_text(found)
    assert text.splitlines()[0] == ",".join(COLUMNS)
    assert list(read_rows(text)) == found


def test_a_name_with_everything_in_it() -> None:
    row = replace(ROW, tree='a "b", c\nd; é 木.rvaft', reason="x,\ny")
    assert list(read_rows(csv_text([row]))) == [row]


def test_a_line_that_was_only_begun_is_left_out() -> None:
    text = csv_text([ROW, replace(ROW, tree="and 4")])
    for cut in range(text.rindex("and 4"), len(text)):
        assert list(read_rows(text[:cut])) == [ROW]
    assert list(read_rows("")) == []
    assert list(read_rows("tree,ga")) == []
    with pytest.raises(LanguageError, match="no comparison of languages"):
        list(read_rows("precious"))


def test_columns_that_are_not_there_are_empty() -> None:
    lines = [line.split(",") for line in csv_text([ROW]).splitlines()]
    few = "".join(",".join(line[:3] + line[4:-2]) + "\n" for line in lines)
    (row,) = read_rows(few)
    assert row == replace(ROW, threshold=None, first_events=None, memory=None)
    assert not row.serves(replace(ROW, result=None, run=None))


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("a,b\n1,2\n", 1, "no comparison of languages"),
        (csv_text([ROW]) + "x,y\n", 3, "2 columns instead of"),
        (csv_text([ROW]).replace("and 3,and", "and 3,xand"), 2, "column gate: 'xand' is not what belongs there"),
        (csv_text([ROW]).replace(",ok,,15", ",,,15"), 2, "column result is empty"),
        (csv_text([ROW]).replace(",ok,,15", ",ok,,many"), 2, "column symbols: 'many'"),
    ],
)
def test_what_is_no_comparison(text: str, line: int, said: str) -> None:
    with pytest.raises(LanguageError, match=said) as raised:
        list(read_rows(text, "x.csv"))
    assert (raised.value.file, raised.value.line) == ("x.csv", line)


def test_which_rows_answer_for_which() -> None:
    wanted = replace(ROW, result=None, run=None)
    assert ROW.serves(wanted)
    assert not wanted.serves(wanted)
    assert not replace(ROW, run=None).serves(wanted)
    for other in ({"digest": "x"}, {"limit": 3}, {"seed": 1}, {"version": "9"}, {"language": "ltlf"}, {"tree": "or 3"}):
        assert not replace(ROW, **other).serves(wanted)
    late = replace(ROW, result=Outcome.TIMEOUT, run=None, timeout=5.0)
    assert late.serves(replace(wanted, timeout=5.0))
    assert not late.serves(replace(wanted, timeout=6.0))
    assert ROW.serves(replace(wanted, timeout=999.0, memory=9999))
    large = replace(ROW, run=Outcome.TOO_LARGE)
    assert large.serves(wanted)
    assert not large.serves(replace(wanted, memory=8192))
    for missing in (Outcome.TOOL_MISSING, Outcome.FAILED):
        assert not replace(ROW, result=missing).serves(wanted)
        assert not replace(ROW, run=missing).serves(wanted)
