"""Which backend was meant where none has the name that a user gave."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches

from rvaft.backend import Backend, UnknownBackend, all_backends
from rvaft.errors import OptionError


@contextmanager
def suggesting() -> Iterator[None]:
    """Add to the error about an unknown backend the name that was probably meant."""
    try:
        yield
    except UnknownBackend as error:
        meant = _meant(error.name)
        if meant is None:
            raise
        raise OptionError(f"{error}; did you mean {meant}?") from error


def _meant(name: str) -> str | None:
    """The faithful backend whose language or suffix it is, else the name that is close."""
    wanted = name.lower().removeprefix(".")
    for known, entry in all_backends().items():
        with suppress(Exception):  # a third party's module may fail in any way; the others still count
            backend: Backend = entry.load()()
            if backend.faithful and wanted in (backend.language.lower(), backend.suffix.removeprefix(".")):
                return known
    return next(iter(get_close_matches(wanted, all_backends(), n=1)), None)
