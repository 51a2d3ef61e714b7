"""Options that several commands share."""

import sys
from collections.abc import Callable
from typing import Any, BinaryIO, TypeVar

import click

from rvaft.model import Kind
from rvaft.verdict import Semantics

F = TypeVar("F", bound=Callable[..., Any])

tree_argument = click.argument("tree", metavar="TREE")
output_option = click.option("-o", "--output", metavar="FILE", help="Write to this file instead of standard output.")
semantics_option = click.option(
    "--semantics",
    type=click.Choice([choice.value for choice in Semantics]),
    default=Semantics.PROJECTED.value,
    show_default=True,
    help="Which events of a trace a match may use.",
)


def part_options(function: F) -> F:
    """`--branch N | --kind K`, of which one excludes the other."""
    function = click.option(
        "--kind", type=click.Choice([kind.value for kind in Kind]), help="Only the branches that have this kind."
    )(function)
    return click.option("--branch", type=int, metavar="N", help="Only this branch, counted from 1.")(function)


def standard_input(argument: str) -> BinaryIO:
    """Standard input, which the argument of that name stands for; refused where it is closed."""
    if sys.stdin is None:
        raise click.UsageError(f"standard input is closed: name a {argument}", click.get_current_context())
    return sys.stdin.buffer


def exclusive(**options: object) -> None:
    """Refuse that more than one of these options is given; the keywords are the options' names."""
    given = [f"--{name}" for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise click.UsageError(f"{' and '.join(given)} exclude each other", click.get_current_context())
