"""CSV and back; LaTeX; figures."""

import io
import re
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from cross_check.benchmark.measurement import Measurement, Outcome
from cross_check.benchmark.plots import figures, plots
from cross_check.benchmark.tables import COLUMNS, Width, csv_text, latex_text, read_rows
from rvaft.errors import LanguageError
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

ROW = Measurement(
    tree="and 3", gate=Gate.AND, children=3, threshold=None, semantics=Semantics.STRICT, language="rml", result=Outcome.OK,
    symbols=15, characters=120, seconds=0.0012, run=Outcome.OK, read_seconds=0.001, events=240, events_per_second=12340.0,
    again_per_second=300000.0, walks=40, differing=0, timeout=60.0, digest="0123456789ab", version="0.1.0", first_events=40,
    memory=4096,
)  # fmt: skip

UNABLE = (Outcome.NOT_EXPRESSIBLE, Outcome.TOO_LARGE, Outcome.TIMEOUT)


def unable(outcome: Outcome, language: str) -> Measurement:
    """A row without numbers."""
    known = ("tree", "gate", "children", "threshold", "semantics", "timeout", "digest", "version", "memory")
    return Measurement(**{name: getattr(ROW, name) for name in known}, language=language, result=outcome, reason="why")


def growing(language: str, most: int = 6) -> list[Measurement]:
    """AND and VOT with up to so many children; the last ones end in each of the three words."""
    found = []
    for gate in (Gate.AND, Gate.VOT):
        for n in range(1, most + 1):
            for k in range(1, n + 1) if gate is Gate.VOT else (None,):
                name = f"{gate} {n}" if k is None else f"{gate} {k}/{n}"
                whole = replace(ROW, language=language) if n <= most - 3 else unable(UNABLE[n - most + 2], language)
                symbols = 3**n if whole.symbols is not None else None
                found.append(replace(whole, tree=name, gate=gate, children=n, threshold=k, symbols=symbols))
    return found


texts = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1)
words = st.text(st.characters(exclude_categories=["Cs", "Cc"]))
counts = st.none() | st.integers(0, 10**9)
numbers = st.none() | st.floats(0, 1e12).map(lambda number: float(f"{number:.4g}"))


COUNTS = (
    "children threshold symbols subformulas states edges characters events first_events walks differing limit memory"
)
NUMBERS = "seconds read_seconds events_per_second again_per_second"
rows = st.builds(
    Measurement,
    gate=st.none() | st.sampled_from(Gate),
    semantics=st.sampled_from(Semantics),
    result=st.sampled_from(Outcome),
    run=st.none() | st.sampled_from(Outcome),
    timeout=st.floats(0.001, 1e6),
    seed=st.integers(),
    **dict.fromkeys(COUNTS.split(), counts),
    **dict.fromkeys(NUMBERS.split(), numbers),
    **dict.fromkeys(("reason", "run_reason", "digest", "version"), words),
    **dict.fromkeys(("tree", "language"), texts),
)


@given(st.lists(rows, max_size=4))
def test_what_is_written_is_read(found: list[Measurement]) -> None:
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


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("a,b\n1,2\n", 1, "no comparison of languages"),
        (csv_text([ROW]) + "x,y\n", 3, "not 29 columns"),
        (csv_text([ROW]).replace("and 3,and", "and 3,xand"), 2, "gate"),
        (csv_text([ROW]).replace("and 3,and", ",and"), 2, "tree"),
        (csv_text([ROW]).replace(",ok,,15", ",ok,,many"), 2, "symbols"),
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


# -- for papers -----------------------------------------------------------------------------------------------------

ROWS = [*growing("rml"), *growing("automaton")]
TREES = [
    replace(ROW, tree=tree, gate=None, children=None, semantics=semantics)
    for tree in ("a_$x$_{1}.rvaft", "樹/木\n.rvaft", "trees/" + "long" * 40 + ".rvaft")
    for semantics in Semantics
]


@pytest.mark.parametrize("width", Width)
def test_latex_tables_have_a_row_for_each_tree_and_fit_a_page(width: Width) -> None:
    pytest.importorskip("pandas")
    text = latex_text([*ROWS, *TREES, replace(ROW, tree="wrong", differing=2)], width)
    tables = text.split(r"\begin{table")[1:]
    assert len({re.search(r"label\{(.*?)}", table)[1] for table in tables}) == len(tables)  # type: ignore[index]
    assert all(table.count(r"\\") < 60 for table in tables)
    assert {"and 1", "vot 6/6", r"a\_\$x\$\_\{1\}.rvaft"} <= {line.split(" &")[0] for line in text.splitlines()}
    assert r"\textdagger{}15" in text
    assert "not expressible" in text
    assert "木\n" not in text


def test_panels() -> None:
    names = [figure.name for figure in figures([*ROWS, *TREES])]
    assert names == [
        *("gates-symbols-strict", "trees-symbols", "gates-seconds-strict", "trees-seconds"),
        *("gates-speed-strict", "trees-speed", "gates-speed-again-strict", "trees-speed-again"),
    ]
    figure = next(figures(ROWS))
    assert [panel.title for panel in figure.panels] == ["AND", "VOT ⌈n/2⌉ of n", "VOT k of 6"]
    points = [(x, row.symbols) for x, row in figure.panels[0].points if row.language == "rml"]
    assert points == [(1, 3), (2, 9), (3, 27), (4, None), (5, None), (6, None)]


@pytest.mark.parametrize("width", Width)
def test_pictures(width: Width) -> None:
    """The same picture each time, as wide as it should be, with something in it but not full of it."""
    image = pytest.importorskip("matplotlib.image")
    few = ROWS if width is Width.COLUMN else TREES
    name = "gates-symbols-strict" if width is Width.COLUMN else "trees-symbols"
    files = dict(islice(plots(few, width), 2))
    assert files == dict(islice(plots(few, width), 2))
    assert files[f"{name}.pdf"].startswith(b"%PDF-")
    pixels = image.imread(io.BytesIO(files[f"{name}.png"]), format="png")
    assert abs(pixels.shape[1] - (17.4 if width is Width.PAGE else 8.5) / 2.54 * 300) <= 1
    assert 0.005 < (pixels[:, :, :3].min(axis=2) < 0.5).mean() < 0.2


def test_many_panels_are_several_figures() -> None:
    pytest.importorskip("matplotlib")
    many = [replace(ROW, tree=str(number), gate=None) for number in range(14)]
    assert [name for name, _ in islice(plots(many), 3)][::2] == ["trees-symbols-1.pdf", "trees-symbols-2.pdf"]
