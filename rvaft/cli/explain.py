"""`rvaft explain`: what a finding means."""

from typing import Final

import click

from rvaft.rules import explain

SYNTAX: Final = "syntax"
"""The code under which `check --format json` reports a text that is no tree; no rule is about it."""

_SYNTAX: Final = """syntax (error): the text is not in the language

The file cannot be read, or its text is not in the language of trees. The message says what was expected at that place; no
rule was looked at."""


@click.command("explain")
@click.argument("code", metavar="CODE")
def command(*, code: str) -> int:
    """Explain the findings of one CODE, with a tree that has it and the same tree mended."""
    click.echo(_SYNTAX if code == SYNTAX else explain(code).rstrip("\n"))
    return 0
