"""Options that several commands share."""

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any, BinaryIO, TypeVar

import click

from rvaft.backend import UnknownBackend, backend, speaking
from rvaft.errors import OptionError, TooLarge
from rvaft.model.nodes import Gate, Kind
from rvaft.model.verdict import Semantics

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


def misused(message: str) -> click.UsageError:
    """The error for options that do not go together, with a hint at the command's help."""
    return click.UsageError(message, click.get_current_context())


def standard_input(argument: str) -> BinaryIO:
    """Standard input, which the argument of that name stands for; refused where it is closed."""
    if sys.stdin is None:
        raise misused(f"standard input is closed: name a {argument}")
    return sys.stdin.buffer


def standard_bytes(argument: str) -> bytes:
    """All that standard input holds; raises `OSError` where it cannot be read."""
    stream = standard_input(argument)
    try:
        return stream.read()
    except OSError as error:
        raise OSError(error.errno, f"cannot read the file: {error.strerror}", "<stdin>") from error


def exclusive(**options: object) -> None:
    """Refuse that more than one of these options is given; the keywords are the options' names."""
    given = [f"--{name}" for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise misused(f"{' and '.join(given)} exclude each other")


@contextmanager
def suggesting() -> Iterator[None]:
    """Add to the error about an unknown backend the name that was probably meant, and to that about a size the option."""
    try:
        yield
    except UnknownBackend as error:
        close = get_close_matches(error.name.lower().removeprefix("."), error.known, n=1)
        meant = speaking(error.name) or next(iter(close), None)
        if meant is None:
            raise
        raise OptionError(f"{error}; did you mean {meant}?") from error
    except TooLarge as error:
        given = click.get_current_context().params
        has_limit = {"language", "limit"} <= given.keys()
        if has_limit and error.limit == (given["limit"] or backend(given["language"]).default_limit):
            error.add_note("raise it with --limit N")  # that limit, and not one of another computation
        raise


def some_semantics(
    _context: click.Context, _parameter: click.Parameter, value: str | None
) -> tuple[Semantics, ...] | None:
    """The semantics that a list names, `all` being all; None without the option."""
    if value is None:
        return None
    if value == "all":
        return tuple(Semantics)
    try:
        return tuple(dict.fromkeys(Semantics(name.strip()) for name in value.split(",")))
    except ValueError:
        raise click.BadParameter(f"{value!r} is not `all` or some of {', '.join(Semantics)}, with commas") from None


def some_gates(_context: click.Context, _parameter: click.Parameter, value: str | None) -> tuple[Gate, ...] | None:
    """The gates that a list names; None without the option."""
    if value is None:
        return None
    found = []
    for word in _words(value):
        try:
            found.append(Gate(word.lower()))
        except ValueError:
            close = get_close_matches(word.lower(), list(Gate), n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise click.BadParameter(f"unknown gate {word}; known: {', '.join(Gate)}{hint}") from None
    return tuple(dict.fromkeys(found))


def some_backends(named: str | None) -> tuple[str, ...] | None:
    """The backends that a list names; raises `OptionError` for an unknown one. None without a list."""
    if named is None:
        return None
    names = tuple(dict.fromkeys(_words(named)))
    with suggesting():
        for name in names:
            backend(name)
    return names


def finite(_context: click.Context, _parameter: click.Parameter, value: float | None) -> float | None:
    """Refuse NaN, which is in every range, since no comparison with it holds."""
    if value is not None and math.isnan(value):
        raise click.BadParameter("nan is no time")
    return value


def _words(value: str) -> list[str]:
    return [word for part in value.split(",") if (word := part.strip())]
