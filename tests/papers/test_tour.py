"""The notebook `papers/tour.ipynb`: whole, without outputs or places of a machine, and every cell does what it says."""

import base64
import html
import io
import re
import shutil
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Run:
    """The cells of code after a run, counted from 1."""

    cells: list[Any]

    def printed(self, number: int) -> str:
        """What a cell prints."""
        outputs = self.cells[number - 1].outputs
        return "".join(output.text for output in outputs if output.output_type == "stream")

    def shown(self, number: int, form: str) -> str:
        """What a cell shows last, in that format."""
        data: str = self.cells[number - 1].outputs[-1].data[form]
        return data

    def words(self, number: int) -> str:
        """The text in the picture that a cell shows, in one line."""
        texts = re.findall(r"<text[^>]*>(.*?)</text>", self.shown(number, "image/svg+xml"), re.DOTALL)
        return " ".join(" ".join(html.unescape(text) for text in texts).split())


# Libraries of the notebook's machinery warn of their own future.
@pytest.mark.filterwarnings("default")
@pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
def test_every_cell_does_what_it_says() -> None:
    """One test, since one run serves all questions."""
    for module, package in (("spot", "spottl"), ("matplotlib", "rvaft[papers]"), ("ipykernel", "ipykernel")):
        pytest.importorskip(module, reason=f"needs {package}")
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    place = {"metadata": {"path": str(NOTEBOOK.parent)}}
    nbclient.NotebookClient(notebook, timeout=100, kernel_name="python3", resources=place).execute()
    run = Run([cell for cell in notebook.cells if cell.cell_type == "code"])
    for cell in run.cells:
        assert all(output.output_type in ("stream", "execute_result") for output in cell.outputs), cell.source
    for check in (tree_cells, property_cell, monitor_cell, language_cells, table_cells, figure_cell):
        check(run)


def tree_cells(run: Run) -> None:
    assert "toplevel damaged;" in run.printed(1)
    for text in ("Robot damaged by radiation", "Waypoint was altered", "SAND"):
        assert text in run.words(2)
    sound, unsound = run.printed(3).splitlines()
    assert sound == "pruned: no error"
    assert unsound.startswith("listing: ")
    assert unsound.endswith("[unbound-variable]")


def property_cell(run: Run) -> None:
    assert "branch 4: result(Waypoint, " in run.printed(4)
    tex = run.shown(4, "text/latex")
    assert tex.startswith("\\begin{align*}\n\\varphi_{1} &= ")
    assert "\n\\varphi &= (" in tex


def monitor_cell(run: Run) -> None:
    assert [line[0] for line in run.printed(5).splitlines()[:5]] == ["?", "?", "?", "?", "⊤"]
    assert "branch 3, attack; " in run.printed(5)
    for text in ("event 5", "time 22.405", "branch 3: attack", "MBGoal = 2"):
        assert text in run.words(5)


def language_cells(run: Run) -> None:
    assert re.findall(r"^(\w+): \d+ symbols, last verdict (.)$", run.printed(6), re.MULTILINE) == [
        ("rml", "⊤"),
        ("ltlf", "⊤"),
        ("automaton", "⊤"),
    ]
    said = dict(line.split(": ", 1) for line in run.printed(7).splitlines())
    assert said["reference"] == "baseline"
    assert all(said[name].startswith(("tested", "proved")) for name in ("engine", "rml", "ltlf", "automaton"))
    assert said["rml-paper"].startswith("differs")


def table_cells(run: Run) -> None:
    assert "branches exercised 2 of 4 (50%)" in run.printed(8)
    first, *lines = run.printed(9).splitlines()
    assert first.startswith("TREE ")
    rows = [line.split() for line in lines if line]
    assert {row[3] for row in rows} == {"rml", "rml-paper", "ltlf", "automaton"}
    assert {("and", "3"), ("vot", "2/3")} <= {(row[0], row[1]) for row in rows}


def figure_cell(run: Run) -> None:
    from PIL import Image

    written = [Path(line) for line in run.printed(10).splitlines()]
    assert {file.suffix for file in written} == {".pdf", ".png"}
    assert all(file.stat().st_size > 5_000 for file in written)
    shutil.rmtree(written[0].parent)
    with Image.open(io.BytesIO(base64.b64decode(run.shown(10, "image/png")))) as figure:
        assert min(figure.size) > 500
        assert figure.convert("L").getextrema() == (0, 255)
