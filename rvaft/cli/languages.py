"""What the errors of backends tell a user of the command: which backend was meant, which option mends it."""

from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches

import click

from rvaft.backend import UnknownBackend, backend, speaking
from rvaft.errors import OptionError, TooLarge


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
        if _raised_by_limit(error):
            error.add_note("raise it with --limit N")
        raise


def _raised_by_limit(error: TooLarge) -> bool:
    """Whether the command has the option `--limit` and that is the limit, not one of another computation."""
    given = click.get_current_context().params
    if not {"language", "limit"} <= given.keys():
        return False
    return error.limit == (given["limit"] or backend(given["language"]).default_limit)
