"""CSV and back; LaTeX; figures."""

import io
import re
from collections.abc import Iterator
from itertools import islice, product
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from cross_check.results import DETECTIONS_ONLY
from papers.languages.measurement import ONLY_EMITTED, Measurement, Outcome, default_languages
from papers.languages.plots import _STYLES, figures, plots
from papers.languages.tables import COLUMNS, Width, csv_text, latex_text, read_rows, text_lines, unable
from rvaft import Gate, LanguageError, Semantics
from rvaft.errors import Cause

ROW = Measurement(
    tree="and 3",
    gate=Gate.AND,
    children=3,
    threshold=None,
    semantics=Semantics.STRICT,
    language="rml",
    result=Outcome.OK,
    symbols=15,
    characters=120,
    seconds=0.0012,
    run=Outcome.OK,
    read_seconds=0.001,
    events=240,
    events_per_second=12340.0,
    again_per_second=300000.0,
    walks=40,
    differing=0,
    timeout=60.0,
    digest="0123456789ab",
    version="0.1.0",
    first_events=40,
    memory=4096,
)

UNABLE = (Outcome.NOT_EXPRESSIBLE, Outcome.TOO_LARGE, Outcome.TIMEOUT)
SIZED = ("symbols", "characters", "seconds", "read_seconds", "events", "events_per_second", "again_per_second", "walks")


def growing(language: str, most: int = 6) -> Iterator[Measurement]:
    """AND and VOT with up to so many children; the last ones end in each of the three words, without numbers."""
    for gate, n in product((Gate.AND, Gate.VOT), range(1, most + 1)):
        for k in range(1, n + 1) if gate is Gate.VOT else (None,):
            name = f"{gate} {n}" if k is None else f"{gate} {k}/{n}"
            row = replace(ROW, tree=name, gate=gate, children=n, threshold=k, language=language, symbols=3**n)
            if n > most - 3:
                row = replace(row, **dict.fromkeys(SIZED), run=None, result=UNABLE[n - most + 2], reason="why")
            yield row


texts = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1)
words = st.text(st.characters(exclude_categories=["Cs", "Cc"]))
counts = st.none() | st.integers(0, 10**9)
numbers = st.none() | st.floats(0, 1e12).map(lambda number: float(f"{number:.4g}"))


COUNTS = (
    "children threshold symbols subformulas states edges characters events first_events walks differing limit memory"
)
NUMBERS = "seconds read_seconds events_per_second again_per_second seconds_spread again_spread"
rows = st.builds(
    Measurement,
    gate=st.none() | st.sampled_from(Gate),
    semantics=st.sampled_from(Semantics),
    result=st.sampled_from(Outcome),
    run=st.none() | st.sampled_from(Outcome),
    cause=st.none() | st.sampled_from(Cause),
    timeout=st.floats(0.001, 1e6),
    seed=st.integers(),
    **dict.fromkeys(COUNTS.split(), counts),
    **dict.fromkeys(NUMBERS.split(), numbers),
    **dict.fromkeys(("reason", "run_reason", "digest", "version", "extension"), words),
    **dict.fromkeys(("tree", "language"), texts),
)


@given(st.lists(rows, max_size=4))
@example([replace(ROW, tree='a "b", c\nd; é 木.rvaft', reason="x,\ny")])
def test_what_is_written_is_read(found: list[Measurement]) -> None:
    text = csv_text(found)
    assert text.splitlines()[0] == ",".join(COLUMNS)
    assert list(read_rows(text)) == found


def test_a_line_that_was_only_begun_is_left_out() -> None:
    text = csv_text([ROW, replace(ROW, tree="and 4")])
    for cut in range(text.rindex("and 4"), len(text)):
        assert list(read_rows(text[:cut])) == [ROW]
    assert list(read_rows("")) == []
    assert list(read_rows("tree,ga")) == []


def test_columns_that_are_not_there_are_empty() -> None:
    lines = [line.split(",") for line in csv_text([ROW]).splitlines()]
    few = "".join(",".join(line[:3] + line[4:-6]) + "\n" for line in lines)
    assert list(read_rows(few)) == [replace(ROW, threshold=None, first_events=None, memory=None)]


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("precious", 1, "not a comparison of languages"),
        ("a,b\n1,2\n", 1, "not a comparison of languages"),
        (csv_text([ROW]) + "x,y\n", 3, "not 33 columns"),
        (csv_text([ROW]).replace("and 3,and", "and 3,xand"), 2, "gate"),
        (csv_text([ROW]).replace("and 3,and", ",and"), 2, "tree"),
        (csv_text([ROW]).replace(",ok,,15", ",ok,,many"), 2, "symbols"),
    ],
)
def test_what_is_no_comparison(text: str, line: int, said: str) -> None:
    with pytest.raises(LanguageError, match=said) as raised:
        list(read_rows(text, "x.csv"))
    assert (raised.value.file, raised.value.line) == ("x.csv", line)


@pytest.mark.parametrize(
    ("row", "wanted", "serves"),
    [
        ({}, {}, True),
        ({}, {"timeout": 999.0, "memory": 9999}, True),
        ({"run": None}, {}, False),
        *(({"result": result, "run": None}, {}, False) for result in (None, Outcome.TOOL_MISSING, Outcome.FAILED)),
        *(({"run": run}, {}, False) for run in (Outcome.TOOL_MISSING, Outcome.FAILED)),
        *(({one: "x"}, {}, False) for one in ("tree", "digest", "semantics", "language", "limit", "seed", "version")),
        ({"result": Outcome.TIMEOUT, "run": None, "timeout": 5.0}, {"timeout": 5.0}, True),
        ({"result": Outcome.TIMEOUT, "run": None, "timeout": 5.0}, {"timeout": 6.0}, False),
        ({"run": Outcome.TOO_LARGE}, {}, True),
        ({"run": Outcome.TOO_LARGE}, {"memory": 8192}, False),
    ],
)
def test_which_row_answers_for_which(row: dict[str, Any], wanted: dict[str, Any], serves: bool) -> None:
    assert replace(ROW, **row).serves(replace(ROW, result=None, run=None, **wanted)) == serves


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


MIXED = [
    ROW,
    replace(ROW, language="sql", run_reason=DETECTIONS_ONLY),
    replace(ROW, language="mfotl", run_reason=ONLY_EMITTED.format("MonPoly"), **dict.fromkeys(SIZED[3:])),
    replace(ROW, language="eql", result=Outcome.NOT_EXPRESSIBLE, reason="it skips", run=None, **dict.fromkeys(SIZED)),
]


def test_what_kind_of_language_it_is_stands_in_each_table() -> None:
    pytest.importorskip("pandas")
    text = latex_text(MIXED)
    assert "Detections only: sql. Only emitted: mfotl. Not expressible in eql: it skips." in text
    assert "{eql}" not in text
    assert [line.split("  ")[-1].strip() for line in text_lines(MIXED)[1:]] == [
        "ok",
        "ok: detections only",
        "ok: only emitted: MonPoly was not run",
        "not expressible: it skips",
    ]
    assert unable(MIXED) == {"eql": "it skips"}


def test_what_kind_of_language_it_is_stands_below_each_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = pytest.importorskip("matplotlib.figure")
    said: dict[str, Any] = {}
    monkeypatch.setattr(figure.Figure, "legend", lambda _self, **options: said.update(options))
    assert next(plots(MIXED))
    assert [handle.get_label() for handle in said["handles"]] == ["mfotl", "rml", "sql*", "* detections only"]
    assert said["title"] == "not expressible: eql"


def test_languages_look_different() -> None:
    looks = [tuple(style) for style in _STYLES.values()]
    assert len(set(looks)) == len({look[0] for look in looks}) == len({look[1] for look in looks}) == len(looks)
    assert {*default_languages()} <= {*_STYLES}


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


MANY = [*TREES, *(replace(ROW, tree=f"{number}", gate=None) for number in range(4))]


@pytest.mark.ci
@pytest.mark.parametrize(
    ("few", "width", "centimetres", "names"),
    [
        (ROWS, Width.PAGE, 17.4, ["gates-symbols-strict.pdf", "gates-symbols-strict.png"]),
        pytest.param(
            *(MANY, Width.COLUMN, 8.5, ["trees-symbols-1.pdf", "trees-symbols-1.png", "trees-symbols-2.pdf"]),
            marks=pytest.mark.ci,
        ),
    ],
)
def test_pictures(few: list[Measurement], width: Width, centimetres: float, names: list[str]) -> None:
    """As wide as it should be, with something in it but not full of it."""
    image = pytest.importorskip("matplotlib.image")
    files = dict(islice(plots(few, width), len(names)))
    assert [*files] == names
    pdf, png = list(files.values())[:2]
    assert pdf.startswith(b"%PDF-")
    pixels = image.imread(io.BytesIO(png), format="png")
    assert abs(pixels.shape[1] - centimetres / 2.54 * 300) <= 1
    assert 0.005 < (pixels[:, :, :3].min(axis=2) < 0.5).mean() < 0.2


@pytest.mark.ci
def test_a_picture_is_the_same_each_time() -> None:
    pytest.importorskip("matplotlib")
    assert next(plots(ROWS[:1])) == next(plots(ROWS[:1]))
