"""The LaTeX tables."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from cross_check.benchmark import Outcome, Row
from cross_check.benchmark.tables import Width, latex_text
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics
from tests.comparison.rows import ROW, UNABLE, growing, unable
from tests.tex import document, needs_tex, unsound

NASTY = 'a_b\\c{d}$e&f#g%h~i^j"k<l>m\nn.rvaft'
CELL = re.compile(r"(?<!\\)&")
DOCUMENT = r"""\documentclass[a4paper,twocolumn]{article}
\usepackage[T1]{fontenc}
\usepackage[margin=%s]{geometry}
\usepackage{textcomp,booktabs}
\begin{document}
%s
\end{document}
"""


def full(language: str, tree: str, gate: Gate | None = None) -> Row:
    """A row with all the numbers, as large as they come."""
    sizes = {"symbols": 233442, "states": 4098, "edges": 32769}
    seconds = {"seconds": 0.00123, "events_per_second": 876_543.0}
    own = {"edges": None} if language != "automaton" else {}
    return replace(ROW, tree=tree, gate=gate, language=language, **{**sizes, **seconds, **own})  # type: ignore[arg-type]


def test_every_line_fills_the_table() -> None:
    rows = [*growing("rml"), *(replace(row, subformulas=3) for row in growing("ltlf"))]
    for table in latex_text(rows).split(r"\begin{tabular}")[1:]:
        (layout,) = re.findall(r"^\{@\{\}(l?r*)@\{\}\}", table)
        lines = [line for line in table.splitlines() if line.endswith(r"\\")]
        assert len(lines) > 20
        for line in lines:
            spans = sum(int(span) - 1 for span in re.findall(r"\\multicolumn\{(\d+)\}", line))
            assert len(CELL.findall(line)) + 1 + spans == len(layout), line


def test_the_three_words_and_the_numbers() -> None:
    text = latex_text([ROW, *(replace(unable(outcome), tree=str(outcome)) for outcome in UNABLE)])
    assert "and 3 & 15 & 1.2 & 12 \\\\" in text
    for outcome in UNABLE:
        assert rf"{outcome} & \multicolumn{{3}}{{c}}{{\emph{{{outcome}}}}} \\" in text


def test_a_text_that_did_not_run_says_so() -> None:
    assert "& timeout \\\\" in latex_text([ROW, replace(ROW, tree="x", run=Outcome.TIMEOUT, events_per_second=None)])


def test_a_table_for_each_semantics() -> None:
    text = latex_text([ROW, replace(ROW, semantics=Semantics.SCATTERED)])
    assert text.count(r"\begin{table*}") == text.count(r"\end{table*}") == 2
    assert "the semantics strict" in text
    assert "the semantics scattered" in text


def test_names_keep_no_special_meaning() -> None:
    lines = latex_text([replace(ROW, tree=NASTY, language="l_1%")]).splitlines()
    in_table, below = (line for line in lines if "rvaft" in line)
    for name in in_table.split(" & ")[0], below:
        assert not re.search(r"(?<!\\)[$#%_&^~]", name)
        assert "\\n" not in name.replace(r"\textbackslash{}n", "")
    assert r"a\_\allowbreak{}b\textbackslash{}\allowbreak{}c\{\allowbreak{}d\}" in below


def test_a_name_is_no_argument_of_the_line_before() -> None:
    for name, written in ("[1cm]", "{[1cm]}"), ("*", "{*}"):
        assert f"\n{written} & " in latex_text([ROW, replace(ROW, tree=name)])


def test_it_is_sound() -> None:
    rows = [*growing("rml"), *growing("l_1%"), *(replace(ROW, tree=name) for name in (NASTY, "[x]"))]
    assert unsound(latex_text(rows), allowed="&") is None


def test_a_text_with_other_verdicts_is_marked() -> None:
    """It must not look like a good one: its size has a mark, and how many traces differ is said; the meaning stands below the table."""
    text = latex_text([ROW, replace(ROW, tree="x", differing=12, walks=40)])
    assert r"and 3 & 15 & 1.2 & 12 &  \\" in text
    assert r"x & {\textdagger}15 & 1.2 & 12 & 12/40 \\" in text
    assert r"{\textdagger}: a text that does not say what the tree says" in text
    assert "textdagger" not in latex_text([ROW])


def test_headings_are_explained_in_print() -> None:
    (note,) = (line for line in latex_text([ROW]).splitlines() if line.startswith("symb.: "))
    assert [part.split(":")[0] for part in note.split("; ")] == ["symb.", "ms", "kev/s"]


def test_long_names_are_numbered() -> None:
    text = latex_text([replace(ROW, tree=f"{'folder/' * 20}{end}.rvaft") for end in ("one", "two")])
    for number, end in (1, "one"), (2, "two"):
        assert re.search(rf"^\({number}\) .*{end}\.rvaft & 15 & ", text, re.MULTILINE)
        assert re.search(rf"^\({number}\)\\ folder/.*{end}\.\\allowbreak{{}}rvaft\\par$", text, re.MULTILINE)


def test_trees_of_one_name_have_a_line_each() -> None:
    assert latex_text([ROW, replace(ROW, digest="x")]).count("\nand 3 & ") == 2


def test_languages_that_do_not_fit_stand_below() -> None:
    rows = [full(language, "x") for language in ("automaton", "a", "b", "c")]
    blocks = [re.findall(r"\{c\}\{(\w+)\}", part) for part in latex_text(rows, Width.COLUMN).split("{tabular}")]
    assert [block for block in blocks if block] == [["automaton", "a"], ["b", "c"]]
    blocks = [re.findall(r"\{c\}\{(\w+)\}", part) for part in latex_text([*rows, full("d", "x")]).split("{tabular}")]
    assert [block for block in blocks if block] == [["automaton", "a"], ["b", "c", "d"]]


@needs_tex
@pytest.mark.parametrize("width", Width)
def test_it_compiles_and_fits(tmp_path: Path, width: Width) -> None:
    """No wider than the text and no longer than a page, in a document of two columns; a page's tables have 16 cm."""
    languages = ("automaton", "ltlf", "rml", "rml-paper", "l_1%")
    gates = [replace(row, differing=3) for language in languages for row in growing(language, 9)]
    large = [full(language, f"sand_rl {n}", Gate.SAND_RL) for language in languages for n in range(12)]
    long = [full(language, f"/{'some_folder/' * n}{'x' * 99}.rvaft") for language in languages for n in range(9)]
    nasty = [replace(ROW, tree=name, semantics=Semantics.SCATTERED) for name in (NASTY, "[x]")]
    tables = latex_text([*gates, *large, *long, *nasty], width)
    said = document(DOCUMENT % ("2.5cm" if width is Width.PAGE else "1.8cm", tables), tmp_path, "-draftmode")
    assert "Overfull" not in said
    assert "too large" not in said
