"""The section about proofs, and its figures."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from papers.proofs import __main__ as section
from tests.proofs.test_definition import names
from tests.tex import needs_tex

FOLDER = section.FOLDER
TEXT = (FOLDER / "section.tex").read_text(encoding="utf-8")
compiled = pytest.mark.skipif(
    shutil.which("coqwc") is None or bool(section.missing()), reason="the proofs are not compiled (make proofs)"
)


def test_its_theorems_are_there() -> None:
    named = {name.replace("\\", "") for name in re.findall(r"\\texttt\{(\w+(?:\\_\w+)+)\}", TEXT)}
    assert len(named) > 12
    assert named <= names()


def test_it_uses_the_figures_that_are_written() -> None:
    written = set(re.findall(r"newcommand\{\\(\w+)\}", (FOLDER / "figures.tex").read_text(encoding="utf-8")))
    assert set(re.findall(r"\\(proof[A-Z]\w*)", TEXT)) <= written


@compiled
def test_the_figures_are_those_of_the_proofs() -> None:
    assert (FOLDER / "figures.tex").read_text(encoding="utf-8") == section.text(section.figures())


@needs_tex
def test_it_compiles(tmp_path: Path) -> None:
    for name in ("section.tex", "figures.tex"):
        shutil.copy(FOLDER / name, tmp_path)
    (tmp_path / "paper.tex").write_text(
        "\\documentclass{article}\\usepackage{amsmath,amsthm}\\newtheorem{theorem}{Theorem}"
        "\\begin{document}\\input{figures}\\input{section}\\end{document}",
        encoding="utf-8",
    )
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout
