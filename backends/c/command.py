"""`rvaft build`: a program that monitors JSON Lines for one tree."""

from pathlib import Path
from typing import Final

import click

from backends.c import CBackend
from backends.c.library import CAPACITY, build_program, require_compiler
from rvaft.cli import options
from rvaft.model.nodes import Kind
from rvaft.model.tree import resolve_semantics
from rvaft.model.verdict import Semantics
from rvaft.rules.validity import valid_part
from rvaft.support.files import require_target

MOST: Final = 1 << 22


@click.command("build")
@options.tree_argument
@options.semantics_option
@options.part_options
@click.option("--repeat-by", metavar="VARIABLE", help="With --repeat, restart only what has its detected value.")
@options.number("--limit", text="Maximum number of sets of events of all scenarios, or of starts of matches.")
@options.number("--capacity", default=CAPACITY, most=MOST, text="Maximum number of partial matches.")
@click.option("-o", "--output", metavar="FILE", required=True, help="The program to write.")
def build_command(
    *,
    tree: str,
    output: str,
    capacity: int,
    repeat_by: str | None,
    semantics: Semantics | None,
    branch: int | None,
    kind: Kind | None,
    limit: int | None,
) -> int:
    """Compile a native monitor for one tree: a program that reads JSON Lines.

    The program prints what `rvaft monitor --format jsonl --backend c` prints, and exits with 1 if a
    trace detects, 0 if none does, 2 on malformed input, and 3 if it has no verdict.
    """
    options.refuse(output == "-", "a program is no text: name a file with -o (./- for a file of this name)")
    require_compiler()
    loaded = options.read_tree(tree)
    require_target(Path(output), regular=True)
    with options.suggesting():
        language = CBackend() if repeat_by is None else CBackend().repeating(repeat_by)
        text = language.translate(
            valid_part(loaded, branch, kind), resolve_semantics(loaded, semantics), limit=limit
        ).text
    build_program(text, Path(output), capacity)
    return 0
