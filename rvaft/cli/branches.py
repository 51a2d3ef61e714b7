"""`rvaft branches`: the branches of a tree, or its one property."""

import sys
from collections.abc import Iterable, Iterator
from enum import StrEnum

import click

from rvaft.analysis.branches import Branch, branches
from rvaft.api import load
from rvaft.cli.options import tree_argument
from rvaft.export.property_text import WIDTH, align_latex, kinds_of, property_sign, property_text, property_unicode
from rvaft.model.tree import RVAFT
from rvaft.support.terminal import visible


class Form(StrEnum):
    """How properties are written."""

    TEXT = "text"
    UNICODE = "unicode"
    LATEX = "latex"


@click.command("branches")
@tree_argument
@click.option(
    "--format",
    "form",
    type=click.Choice([form.value for form in Form]),
    default=Form.TEXT.value,
    show_default=True,
    help="unicode and latex write properties with the signs of papers; latex as one align*.",
)
@click.option("--whole", is_flag=True, help="The property of the whole tree instead of its branches.")
@click.option(
    "--width",
    type=click.IntRange(min=1),
    metavar="N",
    help=f"With latex: break formulas that are wider than N characters.  [default: {WIDTH}]",
)
def branches_command(*, tree: str, form: str, whole: bool, width: int | None) -> int:
    """List the branches of a tree, one line each: number, kinds (- for none), property."""
    if width is not None and form != Form.LATEX:
        raise click.UsageError(f"--width: not for the format {form}; with it, each property is one line")
    loaded = load(tree)
    parts: Iterable[RVAFT | Branch] = [loaded] if whole else branches(loaded)
    rows = align_latex(parts, width=width or WIDTH) if form == Form.LATEX else _rows(parts, Form(form))
    for row in rows:
        sys.stdout.write(f"{row}\n")
    return 0


def _rows(parts: Iterable[RVAFT | Branch], form: Form) -> Iterator[str]:
    """Number or sign, kinds, and property, with tabs between."""
    for part in parts:
        kinds = ",".join(sorted(kind.value for kind in kinds_of(part))) or "-"
        if form is Form.UNICODE:
            yield f"{property_sign(part)}\t{kinds}\t{property_unicode(part)}"
        else:
            number = part.number if isinstance(part, Branch) else "-"
            yield f"{number}\t{kinds}\t{visible(property_text(part))}"
