"""Specifications written by hand, or by another tool, to be held against a tree."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cross_check.participants import Absent, Participant, reference_of
from rvaft.backend import all_backends, backend
from rvaft.errors import LanguageError, OptionError
from rvaft.language import loads
from rvaft.patterns import Pattern
from rvaft.rules import require_valid
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

TREE: Final = "rvaft"
"""The language of trees, beside those of the backends."""


@dataclass(frozen=True, slots=True)
class Handwritten:
    """The text of a file and the name of what reads it: a backend, or `rvaft` for another tree."""

    path: str
    language: str
    text: str

    def enlist(self, tree: RVAFT, semantics: Semantics) -> Participant | Absent:
        """The participant that this text makes; an atom that the text does not define is the event of the tree's node."""
        if self.language == TREE:
            other = loads(self.text)
            require_valid(other)
            return reference_of(other, semantics, name=self.path)
        reader = backend(self.language)
        atoms = _Known(self.path, tree)
        first = reader.read(self.text, atoms=atoms)
        return Participant(self.path, first.fork, observed=reader.observed(self.text, atoms=atoms))


def handwritten(named: str) -> Handwritten:
    """What `[LANG:]FILE` names; the language follows the suffix where it is not given.

    Raises `OSError` where the file cannot be read, `OptionError` where nobody can tell its language, `LanguageError` where it is no
    text in that language.
    """
    language, path = _split(named)
    data = Path(path).read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"not UTF-8 (byte {error.start + 1})"
        raise LanguageError(message, file=path) from None
    found = Handwritten(path, language, text)
    _check(found)
    return found


def _split(named: str) -> tuple[str, str]:
    known = (TREE, *all_backends())
    language, colon, path = named.partition(":")
    if colon and language in known and path:
        return language, path
    suffix = Path(named).suffix
    if suffix == f".{TREE}":
        return TREE, named
    for name in all_backends():
        if backend(name).faithful and backend(name).suffix == suffix:
            return name, named
    hint = f"write LANG:{os.path.basename(named)} with LANG one of {', '.join(known)}"  # noqa: PTH119 (also for odd paths)
    raise OptionError(f"{named}: the suffix {suffix or 'that is missing'} tells no language; {hint}")


def _check(found: Handwritten) -> None:
    """Read the text once, so that what is wrong with it is said before anything runs."""
    try:
        if found.language == TREE:
            require_valid(loads(found.text))
        else:
            backend(found.language).read(found.text)
    except LanguageError as error:
        raise LanguageError(
            error.message, file=found.path, line=error.line, column=error.column, source=error.source
        ) from None


class _Known(Mapping[str, Pattern]):
    """The events of a tree's nodes; an atom of another name is an error and not the default event."""

    def __init__(self, path: str, tree: RVAFT) -> None:
        self._path = path
        patterns = ((name, tree.pattern(name)) for name in tree.occurrences)
        self._events = {name: pattern for name, pattern in patterns if pattern is not None}

    def __getitem__(self, name: str) -> Pattern:
        try:
            return self._events[name]
        except KeyError:
            raise LanguageError(
                f"the atom {name} is no node with a runtime event, and the text does not say which event it is",
                file=self._path,
            ) from None

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self._events)

    def __len__(self) -> int:
        return len(self._events)
