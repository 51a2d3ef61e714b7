"""The LaTeX tables."""

import re
import subprocess
from dataclasses import replace
from pathlib import Path

from rvaft.comparison import Outcome
from rvaft.comparison.latex import latex_text
from rvaft.verdict import Semantics
from tests.comparison.rows import ROW, UNABLE, growing, unable
from tests.tex import needs_tex, unsound

NASTY = 'a_b\\c{d}$e&f#g%h~i^j"k<l>m\nn.rvaft'
CELL = re.compile(r"(?<!\\)&")
DOCUMENT = r"""\documentclass{article}
\usepackage[T1]{fontenc}
\usepackage{textcomp,booktabs,longtable}
\begin{document}
%s
\end{document}
"""


def test_every_line_fills_the_table() -> None:
    rows = [*growing("rml"), *(replace(row, subformulas=3) for row in growing("ltlf"))]
    for table in latex_text(rows).split(r"\begin{longtable}")[1:]:
        (layout,) = re.findall(r"^\{@\{\}(l?r*)@\{\}\}", table)
        lines = [line for line in table.splitlines() if line.endswith(r"\\") and "caption" not in line]
        assert len(lines) > 20
        for line in lines:
            spans = sum(int(span) - 1 for span in re.findall(r"\\multicolumn\{(\d+)\}", line))
            assert len(CELL.findall(line)) + 1 + spans == len(layout), line


def test_the_three_words_and_the_numbers() -> None:
    text = latex_text([ROW, *(replace(unable(outcome), tree=str(outcome)) for outcome in UNABLE)])
    assert "and 3 & 15 & 1.2 & 12.3 \\\\" in text
    for outcome in UNABLE:
        assert rf"{outcome} & \multicolumn{{3}}{{c}}{{\emph{{{outcome}}}}} \\" in text


def test_a_text_that_did_not_run_says_so() -> None:
    assert "& timeout \\\\" in latex_text([ROW, replace(ROW, tree="x", run=Outcome.TIMEOUT, events_per_second=None)])


def test_a_table_for_each_semantics() -> None:
    text = latex_text([ROW, replace(ROW, semantics=Semantics.SCATTERED)])
    assert text.count(r"\begin{longtable}") == text.count(r"\end{longtable}") == 2
    assert "the semantics strict" in text
    assert "the semantics scattered" in text


def test_names_keep_no_special_meaning() -> None:
    (line,) = (
        line for line in latex_text([replace(ROW, tree=NASTY, language="l_1%")]).splitlines() if "rvaft &" in line
    )
    name = line.split(" & ")[0]
    assert not re.search(r"(?<!\\)[$#%_&^~]", name)
    assert r"a\_b\textbackslash{}c\{d\}" in name
    assert "\\n" not in name.replace(r"\textbackslash{}n", "")


def test_a_name_is_no_argument_of_the_line_before() -> None:
    for name, written in ("[1cm]", "{[}1cm{]}"), ("*", "{*}"):
        assert f"\n{written} & " in latex_text([ROW, replace(ROW, tree=name)])


def test_it_is_sound() -> None:
    rows = [*growing("rml"), *growing("l_1%"), *(replace(ROW, tree=name) for name in (NASTY, "[x]"))]
    assert unsound(latex_text(rows), allowed="&") is None


@needs_tex
def test_it_compiles(tmp_path: Path) -> None:
    rows = [*growing("rml"), *growing("l_1%"), replace(ROW, tree=NASTY), replace(ROW, tree="[x]")]
    (tmp_path / "x.tex").write_text(DOCUMENT % latex_text(rows))
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-draftmode", "x.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout[-2000:]
