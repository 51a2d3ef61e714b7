"""`rvaft branches`: the branches of a tree."""

import sys

import click

from rvaft.branches import branches
from rvaft.cli.options import tree_argument
from rvaft.language import load
from rvaft.printable import visible


@click.command("branches")
@tree_argument
def command(tree: str) -> int:
    """List the branches of a tree, one line each: number, kinds (- for none), property."""
    for branch in branches(load(tree)):
        kinds = ",".join(sorted(kind.value for kind in branch.kinds)) or "-"
        sys.stdout.write(f"{branch.number}\t{kinds}\t{visible(branch.formula)}\n")
    return 0
