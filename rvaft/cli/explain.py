"""`rvaft explain`: what the code of a finding or an error means."""

import click

from rvaft.rules import explain


@click.command("explain")
@click.argument("code", metavar="CODE")
def command(*, code: str) -> int:
    """Explain a CODE in square brackets: what it means, a tree that has it and the same tree mended."""
    click.echo(explain(code).rstrip("\n"))
    return 0
