"""The notebook `papers/tour.ipynb`: whole, without outputs or places of a machine, and every cell does what it says."""

import ast
import base64
import html
import io
import re
import shutil
import sys
from pathlib import Path
from typing import Any, Final

import pytest

nbformat = pytest.importorskip("nbformat", reason="needs nbformat")
NOTEBOOK: Final = Path(__file__).parents[2] / "papers" / "tour.ipynb"


def cells(kind: str) -> list[Any]:
    """The cells of one kind in turn."""
    return [cell for cell in nbformat.read(NOTEBOOK, as_version=4).cells if cell.cell_type == kind]


def test_the_notebook_is_valid_and_has_ten_cells_each_with_its_heading() -> None:
    nbformat.validate(nbformat.read(NOTEBOOK, as_version=4))
    assert len(cells("code")) == 10
    headings = [re.findall(r"^## (\d+)\. ", cell.source, re.MULTILINE) for cell in cells("markdown")]
    assert headings == [[str(number)] for number in range(1, 11)]


def test_nothing_of_a_run_or_a_machine_is_kept() -> None:
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert all(not cell.outputs and cell.execution_count is None for cell in cells("code"))
    assert not re.search(r"/(?:home|Users|work|tmp|usr)/|[A-Z]:\\\\", text)
    assert set(nbformat.read(NOTEBOOK, as_version=4).metadata) == {"kernelspec", "language_info"}


@pytest.mark.ci
@pytest.mark.usefixtures("quick")
def test_every_cell_does_what_it_says(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """One test, since one run serves all questions. The cells run here, one after the other, as a kernel runs them."""
    for module, package in (("spot", "spottl"), ("matplotlib", "rvaft[papers]")):
        pytest.importorskip(module, reason=f"needs {package}")
    formatters = pytest.importorskip("IPython.core.formatters", reason="needs ipykernel")
    monkeypatch.chdir(NOTEBOOK.parent)
    outputs, values, space = [""], list[list[Any]]([[]]), dict[str, Any]()
    for cell in cells("code"):
        values.append([])
        monkeypatch.setattr(sys, "displayhook", values[-1].append)
        exec(compile(ast.Interactive(ast.parse(cell.source).body), cell.id, "single"), space)
        written = capsys.readouterr()
        assert not written.err
        outputs.append(written.out)

    def shown(cell: int, form: str) -> Any:
        return formatters.DisplayFormatter().format(values[cell][-1])[0][form]

    def words(cell: int) -> str:
        """The text in the picture that a cell shows, in one line."""
        texts = re.findall(r"<text[^>]*>(.*?)</text>", shown(cell, "image/svg+xml"), re.DOTALL)
        return " ".join(" ".join(html.unescape(text) for text in texts).split())

    # the tree, its property
    assert "toplevel damaged;" in outputs[1]
    assert all(text in words(2) for text in ("Robot damaged by radiation", "Waypoint was altered"))
    assert 'class="gate sand"' in shown(2, "image/svg+xml")
    sound, unsound = outputs[3].splitlines()
    assert sound == "pruned: no error"
    assert re.fullmatch(r"listing: .*\[unbound-variable\]", unsound)
    assert "branch 4: result(Waypoint, " in outputs[4]
    tex = shown(4, "text/latex")
    assert tex.startswith("\\begin{align*}\n\\varphi_{1} &= ")
    assert "\n\\varphi &= (" in tex
    # a monitor
    assert [line[0] for line in outputs[5].splitlines()[:5]] == [*"????⊤"]
    assert "branch 3, attack; " in outputs[5]
    assert all(text in words(5) for text in ("event 5", "time 22.405", "branch 3: attack", "MBGoal = 2"))
    # languages
    assert re.findall(r"^(\w+): \d+ symbols, last verdict (.)$", outputs[6], re.MULTILINE) == [
        (name, "⊤") for name in ("rml", "ltlf", "automaton")
    ]
    said = dict(line.split(": ", 1) for line in outputs[7].splitlines())
    assert said["reference"] == "baseline"
    assert all(said[name].startswith(("tested", "proved")) for name in ("engine", "rml", "ltlf", "automaton"))
    assert said["rml-paper"].startswith("differs")
    # tables and a figure
    assert "branches exercised 2 of 4 (50%)" in outputs[8]
    first, *lines = outputs[9].splitlines()
    assert first.startswith("TREE ")
    rows = [line.split() for line in lines if line]
    assert {row[3] for row in rows} >= {"rml", "rml-paper", "ltlf", "automaton"}
    assert {("and", "3"), ("vot", "2/3")} <= {(row[0], row[1]) for row in rows}
    files = [Path(line) for line in outputs[10].splitlines()]
    assert {file.suffix for file in files} == {".pdf", ".png"}
    assert all(file.stat().st_size > 5_000 for file in files)
    shutil.rmtree(files[0].parent)
    from PIL import Image

    with Image.open(io.BytesIO(base64.b64decode(shown(10, "image/png")))) as figure:
        assert min(figure.size) > 500
        assert figure.convert("L").getextrema() == (0, 255)
