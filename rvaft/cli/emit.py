"""`rvaft emit`: a specification of a tree, or a drawing of its automaton."""

from pathlib import PurePath
from typing import Final

import click

from rvaft.api import load, narrowed, translate
from rvaft.backend import UnknownBackend, backend
from rvaft.cli.options import (
    exclusive,
    misused,
    output_option,
    part_options,
    semantics_option,
    suggesting,
    tree_argument,
)
from rvaft.errors import OptionError, TooLarge
from rvaft.export import Format, format_of, picture
from rvaft.export.latex import listing
from rvaft.model.verdict import Semantics
from rvaft.support.files import deliver

DRAWN: Final = "dot"
"""The word for a drawing, in place of a language."""
AUTOMATON: Final = "automaton"
"""The backend whose texts are drawn."""
_PICTURES: Final = (Format.SVG, Format.PDF, Format.PNG)


@click.command("emit")
@tree_argument
@click.option(
    "--to",
    "language",
    metavar="LANGUAGE",
    required=True,
    help="A name that `rvaft backends` lists, or dot: the automaton, drawn.",
)
@semantics_option
@part_options
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "latex"]),
    default="text",
    show_default=True,
    help="latex: a listing for the package listings, with the definition of the language.",
)
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    metavar="N",
    help="The largest size, in the language's own unit; of a drawing, in states.",
)
@output_option
def emit_command(
    *,
    tree: str,
    language: str,
    semantics: str,
    branch: int | None,
    kind: str | None,
    form: str,
    limit: int | None,
    output: str | None,
) -> int:
    """Write a specification of a tree that means the tree under the chosen semantics."""
    exclusive(branch=branch, kind=kind)
    drawing = None if output is None else format_of(output)
    pictured = drawing in _PICTURES
    if language == DRAWN:
        loaded = load(tree)
        if form != "text":
            raise misused(f"--to {DRAWN} is a drawing, which has no --format {form}")
        suffix = PurePath(output or "").suffix
        part = narrowed(loaded, branch, kind)
        if suffix and not pictured and drawing is not Format.DOT:
            raise misused(f"no drawing of an automaton has the suffix {suffix}; known: .dot, .gv, .svg, .pdf, .png")
        try:
            dot = backend(AUTOMATON).diagram(part, Semantics(semantics), limit=limit)
        except TooLarge as error:
            error.add_note("raise it with --limit N, or draw one branch with --branch N")
            raise
        deliver(picture(dot, str(drawing)) if pictured else dot.encode(), output)
        return 0
    if language in _PICTURES:
        raise OptionError(f"{language} is no language: --to {DRAWN} -o FILE.{language} draws the automaton")
    if pictured or drawing is Format.DOT:
        mend = f"--to {DRAWN} -o {output} draws the automaton"
        raise misused(f"{language} is written as text, which {output} would not be: {mend}")
    with suggesting():
        try:
            loaded = load(tree)
            specification = translate(loaded, language, semantics=semantics, branch=branch, kind=kind, limit=limit)
        except UnknownBackend as error:
            raise UnknownBackend(error.name, (*error.known, DRAWN)) from error
    text = specification.text
    if form == "latex":
        text = listing(text, backend(language).highlighting)
    deliver((text if text.endswith("\n") else f"{text}\n").encode(), output)
    return 0
