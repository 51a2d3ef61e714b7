"""The two verbs: translate a tree into a specification, or monitor events against it.

`branch` and `kind` narrow a tree to one branch, or to the branches that have a kind.
"""

from enum import StrEnum
from typing import TYPE_CHECKING, TypeVar

from rvaft.errors import OptionError
from rvaft.model import Kind
from rvaft.verdict import Semantics

if TYPE_CHECKING:
    from rvaft.backend import Specification
    from rvaft.monitors import Monitor
    from rvaft.tree import RVAFT

Choice = TypeVar("Choice", bound=StrEnum)


def translate(
    tree: "RVAFT",
    language: str,
    *,
    semantics: Semantics | str = Semantics.PROJECTED,
    branch: int | None = None,
    kind: Kind | str | None = None,
    limit: int | None = None,
) -> "Specification":
    """The tree as a specification; `language` names a backend.

    Raises `UnknownBackend`, `OptionError`, `TreeError` for a branch or kind that the tree has not, `NotExpressible`
    where the language cannot say it, and `TooLarge` beyond the limit (None is the backend's own).
    """
    from rvaft.backend import backend

    return backend(language).translate(narrowed(tree, branch, kind), one_of(Semantics, semantics), limit=limit)


def monitor(
    tree: "RVAFT",
    *,
    semantics: Semantics | str = Semantics.PROJECTED,
    branch: int | None = None,
    kind: Kind | str | None = None,
) -> "Monitor":
    """A fresh monitor of the tree.

    Raises `OptionError`, `TreeError` for a branch or kind that the tree has not, and `TooLarge`.
    """
    from rvaft.engine import Engine

    return Engine(narrowed(tree, branch, kind), one_of(Semantics, semantics))


def narrowed(tree: "RVAFT", branch: int | None = None, kind: Kind | str | None = None) -> "RVAFT":
    """The tree itself, or the part of it that a monitor for one branch or one kind looks at."""
    if branch is None and kind is None:
        return tree
    from rvaft.restrict import restrict

    return restrict(tree, branch=branch, kind=None if kind is None else one_of(Kind, kind))


def one_of(choices: type[Choice], value: Choice | str) -> Choice:
    """The member of an enumeration that a word names; raises `OptionError`."""
    try:
        return choices(value)
    except ValueError:
        known = ", ".join(choice.value for choice in choices)
        raise OptionError(f"unknown {choices.__name__.lower()} {value!r}; known: {known}") from None
