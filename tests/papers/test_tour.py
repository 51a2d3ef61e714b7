"""The notebook `papers/tour.ipynb`: whole, without outputs or places of a machine, and every cell does what it says."""

import base64
import html
import io
import re
import shutil
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
    outputs = [[], *(cell.outputs for cell in notebook.cells if cell.cell_type == "code")]
    assert {output.output_type for cell in outputs for output in cell} == {"stream", "execute_result"}

    def printed(cell: int) -> str:
        return "".join(output.text for output in outputs[cell] if output.output_type == "stream")

    def shown(cell: int, form: str) -> str:
        data: str = outputs[cell][-1].data[form]
        return data

    def words(cell: int) -> str:
        """The text in the picture that a cell shows, in one line."""
        texts = re.findall(r"<text[^>]*>(.*?)</text>", shown(cell, "image/svg+xml"), re.DOTALL)
        return " ".join(" ".join(html.unescape(text) for text in texts).split())

    # the tree, its property
    assert "toplevel damaged;" in printed(1)
    assert all(text in words(2) for text in ("Robot damaged by radiation", "Waypoint was altered", "SAND"))
    sound, unsound = printed(3).splitlines()
    assert sound == "pruned: no error"
    assert re.fullmatch(r"listing: .*\[unbound-variable\]", unsound)
    assert "branch 4: result(Waypoint, " in printed(4)
    tex = shown(4, "text/latex")
    assert tex.startswith("\\begin{align*}\n\\varphi_{1} &= ")
    assert "\n\\varphi &= (" in tex
    # a monitor
    assert [line[0] for line in printed(5).splitlines()[:5]] == [*"????⊤"]
    assert "branch 3, attack; " in printed(5)
    assert all(text in words(5) for text in ("event 5", "time 22.405", "branch 3: attack", "MBGoal = 2"))
    # languages
    assert re.findall(r"^(\w+): \d+ symbols, last verdict (.)$", printed(6), re.MULTILINE) == [
        (name, "⊤") for name in ("rml", "ltlf", "automaton")
    ]
    said = dict(line.split(": ", 1) for line in printed(7).splitlines())
    assert said["reference"] == "baseline"
    assert all(said[name].startswith(("tested", "proved")) for name in ("engine", "rml", "ltlf", "automaton"))
    assert said["rml-paper"].startswith("differs")
    # tables and a figure
    assert "branches exercised 2 of 4 (50%)" in printed(8)
    first, *lines = printed(9).splitlines()
    assert first.startswith("TREE ")
    rows = [line.split() for line in lines if line]
    assert {row[3] for row in rows} == {"rml", "rml-paper", "ltlf", "automaton"}
    assert {("and", "3"), ("vot", "2/3")} <= {(row[0], row[1]) for row in rows}
    written = [Path(line) for line in printed(10).splitlines()]
    assert {file.suffix for file in written} == {".pdf", ".png"}
    assert all(file.stat().st_size > 5_000 for file in written)
    shutil.rmtree(written[0].parent)
    from PIL import Image

    with Image.open(io.BytesIO(base64.b64decode(shown(10, "image/png")))) as figure:
        assert min(figure.size) > 500
        assert figure.convert("L").getextrema() == (0, 255)
