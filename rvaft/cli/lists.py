"""Options of which the value is a list with commas, or a number of seconds."""

import math
from difflib import get_close_matches

import click

from rvaft.backend import backend
from rvaft.cli.languages import suggesting
from rvaft.model import Gate
from rvaft.verdict import Semantics


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
