"""Specifications written by hand, or by another tool, to be held against a tree."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from cross_check.participants import Absent, Participant, reference_of
from rvaft.backend import all_backends, backend, speaking
from rvaft.errors import LanguageError, OptionError
from rvaft.language import dumps, loads
from rvaft.patterns import Pattern
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
            found = reference_of(other, semantics, name=self.path)
            return found if isinstance(found, Absent) else replace(found, tree=other)
        reader = backend(self.language)
        atoms = _Events(self.path, tree)
        first = reader.read(self.text, atoms=atoms)
        return Participant(self.path, first.fork, observed=reader.observed(self.text, atoms=atoms))


def handwritten(named: str) -> Handwritten:
    """What `[LANG:]FILE` names; the language follows the suffix where it is not given, and the file `-` is standard input.

    Raises `OSError` where the file cannot be read, `OptionError` where nobody can tell its language, `LanguageError` where it is no
    text in that language.
    """
    language, path = _split(named)
    data = sys.stdin.buffer.read() if path == "-" else Path(path).read_bytes()
    file = "<stdin>" if path == "-" else path
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"not UTF-8 (byte {error.start + 1})"
        raise LanguageError(message, file=file) from None
    shown = file.encode(errors="surrogateescape").decode(errors="replace")
    if language == TREE:  # with what it imports
        return Handwritten(shown, language, dumps(loads(text, file)))
    found = Handwritten(shown, language, text)
    _check(found)
    return found


def is_specification(path: str) -> bool:
    """Whether the name of a file says that it is a specification and no tree."""
    suffix = Path(path).suffix.removeprefix(".")
    return suffix != TREE and bool(suffix) and _language(suffix) is not None


def _split(named: str) -> tuple[str, str]:
    """The name of what reads a file, and its path."""
    before, colon, path = named.partition(":")
    if colon and path and (language := _language(before)) is not None:
        return language, path
    if colon and path and before.isidentifier() and not Path(named).exists():
        raise OptionError(f"{named}: unknown language {before}; known: {', '.join(_known())}")
    suffix = Path(named).suffix
    if (language := _language(suffix.removeprefix("."))) is not None and suffix:
        return language, named
    reason = f"the suffix {suffix} tells no language" if suffix else "without a suffix nobody can tell its language"
    raise OptionError(f"{named}: {reason}; write LANG:{Path(named).name} with LANG one of {', '.join(_known())}")


def _known() -> tuple[str, ...]:
    return (TREE, *all_backends())


def _language(word: str) -> str | None:
    """The name of what reads a language: its own, or that of the backend whose language or suffix the word is."""
    return word.lower() if word.lower() in _known() else speaking(word)


def _check(found: Handwritten) -> None:
    """Read the text once, so that what is wrong with it is said before anything runs."""
    try:
        backend(found.language).read(found.text)
    except LanguageError as error:
        raise LanguageError(
            error.message, file=found.path, line=error.line, column=error.column, source=error.source
        ) from None


class _Events(dict[str, Pattern]):
    """The events of a tree's nodes; an atom of another name is an error and not the default event."""

    def __init__(self, path: str, tree: RVAFT) -> None:
        self._path = path
        patterns = ((name, tree.pattern(name)) for name in tree.occurrences)
        super().__init__((name, pattern) for name, pattern in patterns if pattern is not None)

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ARG002 (as in every mapping)
        """The event of a node; raises `LanguageError`."""
        if name not in self:
            reason = f"the atom {name} is no node with a runtime event, and the text does not say which event it is"
            raise LanguageError(reason, file=self._path)
        return self[name]
