"""Generation of all files of the paper: their names, order in the document, and failures."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import rvaft
from papers.fmas2022 import tex
from papers.fmas2022.figures import figures
from papers.fmas2022.findings import Page, findings
from papers.fmas2022.gate_table import gate_table
from papers.fmas2022.listing import formulas_tex, listing_rml, listing_tex
from papers.fmas2022.node_table import node_table
from papers.fmas2022.overhead import overhead
from papers.fmas2022.places import GATES, PRUNED, TREES
from papers.fmas2022.verdict_tex import verdict_tables
from rvaft.errors import ToolMissing

PRINTED: Final = (
    (
        "figure4a",
        8.5,
        (
            "The attack-fault tree (after Figure 4a of the paper; the labels of the three faults of images are "
            "chosen here)."
        ),
    ),
    ("figure4b", 8.5, "The pruned tree with the names ev1 to ev10 of its nodes (Figure 4b of the paper)."),
    ("overhead", 8.5, "What monitoring costs a mission, measured."),
)
"""Name, width in centimetres (text has at least 7 points), and caption."""


@dataclass(frozen=True, slots=True)
class Folder:
    """The written files, and the reasons for missing ones."""

    path: Path
    files: list[Path] = field(default_factory=list)
    not_run: list[str] = field(default_factory=list)

    def write(self, name: str, data: str | bytes) -> None:
        """Write one file."""
        file = self.path / name
        file.write_bytes(data.encode() if isinstance(data, str) else data)
        self.files.append(file)


def make(out: Path, *, texts: bool = False) -> tuple[Folder, Page]:
    """Write everything into a folder, which is created if necessary; `texts` skips figures and
    measurements.

    Raises `Disagreement`, `ToolFailed`, and `OSError`; outputs without their tool are left out and
    reported.
    """
    out.mkdir(parents=True, exist_ok=True)
    folder = Folder(out)
    _say("tables, formulas and listings")
    for name, text in latex_texts(TREES).items():
        folder.write(name, text)
    measured = "" if texts else _pictures(folder)
    _say("findings: every command of the page is run (about a minute)")
    page = findings()
    folder.write("findings.md", page.text + measured)
    folder.write("paper.tex", tex.document(_parts({file.name for file in folder.files})))
    return folder, page


def latex_texts(trees: Path, gates: Path = GATES) -> dict[str, str]:
    """Return the tables, formulas and listings by file name, computed from the trees in these
    folders.
    """
    path = trees / PRUNED.name
    tree = rvaft.load(path)
    return {
        "table1.tex": node_table(tree),
        "gates.tex": gate_table(gates),
        "formulas.tex": formulas_tex(tree),
        "listing.rml": listing_rml(tree),
        "listing.tex": listing_tex(tree),
        **{f"table{number}.tex": text for number, text in verdict_tables(tree, path.with_suffix(".traces")).items()},
    }


def _say(what: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"papers.fmas2022: {what}\n")


def _pictures(folder: Folder) -> str:
    """Write figures and measurements; return the section on measurements."""
    _say("figures")
    try:
        for name, data in figures(TREES):
            folder.write(name, data)
    except ToolMissing as error:
        folder.not_run.append(f"figures 4a and 4b: {error}")
    _say("measurements of missions")
    try:
        measured = overhead(folder.path)
    except ToolMissing as error:
        folder.not_run.append(f"overhead: {error}")
        statement = f"not run: {error}\n"
    else:
        folder.files.extend(measured.files)
        statement = measured.statement
    return (
        "\n## What monitoring costs a mission\n\nMeasured on this machine by `python -m "
        f"papers.fmas2022.overhead`.\n\n{statement}"
    )


def _parts(files: set[str]) -> Iterator[str]:
    for name in ("table1", "gates", "formulas", "listing", "table2", "table3"):
        yield rf"\input{{{name}}}"
    for name, width, caption in PRINTED:
        if f"{name}.pdf" in files:
            picture = rf"\includegraphics[width={width}cm]{{{name}}}"
            yield rf"\begin{{figure}}[htbp]\centering{picture}\caption{{{caption}}}\end{{figure}}"
    for name in ("overhead", "overhead_detected"):
        if f"{name}.tex" in files:
            yield rf"\input{{{name}}}"
