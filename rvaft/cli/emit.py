"""`rvaft emit`: a specification of a tree."""

import click

from rvaft.api import translate
from rvaft.cli.languages import suggesting
from rvaft.cli.options import exclusive, output_option, part_options, semantics_option, tree_argument
from rvaft.cli.output import deliver
from rvaft.language import load


@click.command("emit")
@tree_argument
@click.option("--to", "language", metavar="LANGUAGE", required=True, help="A name that `rvaft backends` lists.")
@semantics_option
@part_options
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="The largest size, in the language's own unit.")
@output_option
def command(
    *,
    tree: str,
    language: str,
    semantics: str,
    branch: int | None,
    kind: str | None,
    limit: int | None,
    output: str | None,
) -> int:
    """Write a specification of a tree that means the tree under the chosen semantics."""
    exclusive(branch=branch, kind=kind)
    loaded = load(tree)
    with suggesting():
        specification = translate(loaded, language, semantics=semantics, branch=branch, kind=kind, limit=limit)
    text = specification.text
    deliver((text if text.endswith("\n") else f"{text}\n").encode(), output)
    return 0
