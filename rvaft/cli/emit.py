"""`rvaft emit`: a specification of a tree, or a drawing of its automaton."""

from pathlib import PurePath
from typing import Final

import click

from rvaft.api import load, narrowed, translate
from rvaft.backend import UnknownBackend, backend
from rvaft.cli.options import exclusive, output_option, part_options, semantics_option, suggesting, tree_argument
from rvaft.errors import OptionError, TooLarge
from rvaft.export import Format, format_of, picture
from rvaft.export.latex import listing
from rvaft.model.tree import RVAFT
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
    if language != DRAWN:
        _check_no_drawing(language, output)
    loaded = load(tree)
    if language == DRAWN:
        if form != "text":
            raise click.UsageError(
                f"--to {DRAWN} is a drawing, which has no --format {form}", click.get_current_context()
            )
        return _draw(narrowed(loaded, branch, kind), Semantics(semantics), limit, output)
    with suggesting():
        try:
            specification = translate(loaded, language, semantics=semantics, branch=branch, kind=kind, limit=limit)
        except UnknownBackend as error:
            raise UnknownBackend(error.name, (*error.known, DRAWN)) from error
    text = specification.text
    if form == "latex":
        text = listing(text, backend(language).highlighting)
    deliver((text if text.endswith("\n") else f"{text}\n").encode(), output)
    return 0


def _check_no_drawing(language: str, output: str | None) -> None:
    """Refuse the name of a picture's format as a language, and a file whose suffix is that of a drawing."""
    if language in _PICTURES:
        raise OptionError(f"{language} is no language: --to {DRAWN} -o FILE.{language} draws the automaton")
    form = None if output is None else format_of(output)
    if form is Format.DOT or form in _PICTURES:
        message = (
            f"{language} is written as text, which {output} would not be: --to {DRAWN} -o {output} draws the automaton"
        )
        raise click.UsageError(message, click.get_current_context())


def _draw(tree: RVAFT, semantics: Semantics, limit: int | None, output: str | None) -> int:
    """Draw the automaton: in the DOT language, or as the picture that the suffix of the file names."""
    form = None if output is None else format_of(output)
    pictured = form in _PICTURES
    if output is not None and PurePath(output).suffix and not pictured and form is not Format.DOT:
        message = (
            f"no drawing of an automaton has the suffix {PurePath(output).suffix}; known: .dot, .gv, .svg, .pdf, .png"
        )
        raise click.UsageError(message, click.get_current_context())
    try:
        dot = backend(AUTOMATON).diagram(tree, semantics, limit=limit)
    except TooLarge as error:
        error.add_note("raise it with --limit N, or draw one branch with --branch N")
        raise
    deliver(picture(dot, str(form)) if pictured else dot.encode(), output)
    return 0
