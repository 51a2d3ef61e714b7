"""`rvaft show`: draw a tree, or write it in another format."""

from pathlib import PurePath

import click

from rvaft.cli.options import output_option, tree_argument
from rvaft.cli.output import deliver
from rvaft.drawing import SUFFIXES, Format, draw, format_of, losses
from rvaft.language import load


@click.command("show")
@tree_argument
@click.option(
    "--format",
    "form",
    type=click.Choice([form.value for form in Format]),
    help="The format; by default that of FILE's suffix, else tree. svg, pdf and png need Graphviz.",
)
@output_option
def command(tree: str, form: str | None, output: str | None) -> int:
    """Draw a tree, or write it in another format."""
    chosen = Format(form) if form is not None else _suggested(output)
    loaded = load(tree)
    data = draw(loaded, chosen)
    deliver(data, output, binary=chosen.binary)
    if chosen is Format.GALILEO:
        for loss in losses(loaded):
            click.echo(f"rvaft: warning: galileo: {loss}", err=True)
    return 0


def _suggested(output: str | None) -> Format:
    """The format of a file without `--format`: that of its suffix, and a drawing for the terminal where it has none."""
    suffix = PurePath(output or "").suffix
    if output is None or not suffix:
        return Format.TREE
    found = format_of(output)
    if found is None:
        message = f"no format has the suffix {suffix}; known: {', '.join(SUFFIXES)}; or name one with --format"
        raise click.UsageError(message, click.get_current_context())
    return found
