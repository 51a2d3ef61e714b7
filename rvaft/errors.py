"""Every error a user of rvaft can meet.

All derive from `RvaftError` and from the builtin a caller would expect; what is wrong travels in fields as
well as in the one-line text.
"""

import os
from collections.abc import Iterable
from importlib import import_module
from types import UnionType
from typing import Any


class RvaftError(Exception):
    """The root of all errors that rvaft raises on purpose.

    >>> issubclass(TreeError, RvaftError) and issubclass(TreeError, ValueError)
    True
    """


class LanguageError(RvaftError, ValueError):
    """A text is not in the language it should be in (a tree, a pattern, a guard, a specification).

    >>> print(LanguageError("unexpected ';'", file="t.rvaft", line=2, column=4, source="top;"))
    t.rvaft:2:4: unexpected ';'
    top;
       ^
    """

    def __init__(self, message: str, *, file: str = "<text>", line: int = 1, column: int = 1, source: str = "") -> None:
        self.message = message
        self.file = file
        self.line = line
        self.column = column
        self.source = source
        super().__init__(message)

    @property
    def caret(self) -> str:
        """The offending line with a caret below the column, or the empty string without a source line."""
        if not self.source:
            return ""
        before = "".join(c if c == "\t" else " " for c in self.source[: self.column - 1])
        return f"{self.source}\n{before}^"

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}: {self.message}"
        return f"{where}\n{self.caret}" if self.caret else where


class TreeError(RvaftError, ValueError):
    """A tree breaks a rule; `rule` is the code that `rvaft explain` knows, `nodes` the culprits.

    >>> TreeError("the root top is not a node of the tree", rule="no-root", nodes=["top"]).rule
    'no-root'
    """

    def __init__(self, message: str, *, rule: str, nodes: Iterable[str] = ()) -> None:
        self.message = message
        self.rule = rule
        self.nodes = tuple(nodes)
        super().__init__(f"{message} [{rule}]")


class NotExpressible(RvaftError, ValueError):
    """A backend cannot express this tree under this semantics; it never emits a text with another meaning.

    A writer gives the reason and the nodes; `Backend.translate` adds the backend and the semantics.

    >>> print(NotExpressible("the paper does not say how", backend="rml-paper", semantics="scattered"))
    rml-paper cannot express this tree under scattered: the paper does not say how
    """

    def __init__(self, reason: str, *, backend: str = "", semantics: str = "", nodes: Iterable[str] = ()) -> None:
        self.reason = reason
        self.backend = backend
        self.semantics = semantics
        self.nodes = tuple(nodes)
        at = f" (at {', '.join(self.nodes)})" if self.nodes else ""
        who = f"{backend} cannot express this tree" if backend else "the tree cannot be expressed"
        under = f" under {semantics}" if semantics else ""
        super().__init__(f"{who}{under}: {reason}{at}")


class TooLarge(RvaftError, RuntimeError):
    """A computation would exceed a limit that the caller can raise; a `remedy` is noted.

    >>> print(TooLarge("states of the automaton", limit=60))
    too large: states of the automaton (limit 60)
    """

    def __init__(self, what: str, *, limit: int, remedy: str = "") -> None:
        self.what = what
        self.limit = limit
        super().__init__(f"too large: {what} (limit {limit})")
        if remedy:
            self.add_note(remedy)


class CheckpointError(RvaftError, ValueError):
    """A checkpoint cannot be made, or not be used here; `file` is its path, `reason` says why.

    >>> print(CheckpointError("run.ckpt", "it is of another tree"))
    run.ckpt: it is of another tree
    """

    def __init__(self, file: str | os.PathLike[str], reason: str) -> None:
        self.file = os.fspath(file)
        self.reason = reason
        super().__init__(f"{self.file}: {reason}")


class TraceError(RvaftError, ValueError):
    """A trace is malformed; `line` counts from 1, and is None where it is no line that is wrong.

    >>> print(TraceError("no JSON object", file="log.jsonl", line=7))
    log.jsonl:7: no JSON object
    """

    def __init__(self, message: str, *, file: str = "<trace>", line: int | None = 1) -> None:
        self.message = message
        self.file = file
        self.line = line
        super().__init__(f"{file}: {message}" if line is None else f"{file}:{line}: {message}")


class ToolMissing(RvaftError, RuntimeError):
    """A program or library that this step needs is not installed; `remedy` says how to get it.

    >>> print(ToolMissing("Graphviz", remedy="apt-get install graphviz"))
    Graphviz is not installed: apt-get install graphviz
    """

    def __init__(self, tool: str, *, remedy: str) -> None:
        self.tool = tool
        self.remedy = remedy
        super().__init__(f"{tool} is not installed: {remedy}")


def installed(module: str, tool: str, remedy: str) -> Any:
    """A module of a library that need not be there, imported now; raises `ToolMissing`.

    >>> installed("json", "JSON", "install Python").loads("1")
    1
    """
    try:
        return import_module(module)
    except ImportError:
        raise ToolMissing(tool, remedy=remedy) from None


class ToolFailed(RvaftError, RuntimeError):
    """A program that this step needs is installed but did not do its work.

    >>> print(ToolFailed("dot", reason="exit status 1"))
    dot failed: exit status 1
    """

    def __init__(self, tool: str, *, reason: str) -> None:
        self.tool = tool
        self.reason = reason
        super().__init__(f"{tool} failed: {reason}")


class WrongType(RvaftError, TypeError):
    """An argument is of a type that it cannot have.

    >>> print(WrongType("limit", "many", "an int"))
    limit must be an int, not str
    """

    def __init__(self, what: str, value: object, expected: str) -> None:
        self.value = value
        self.expected = expected
        super().__init__(f"{what} must be {expected}, not {type(value).__name__}")


def expect(what: str, value: object, kind: type | UnionType, expected: str) -> None:
    """Raise `WrongType` where an argument is not of this type."""
    if not isinstance(value, kind):
        raise WrongType(what, value, expected)


class OptionError(RvaftError, ValueError):
    """An option has a value that is none of those it can have, or two options contradict each other.

    >>> import rvaft
    >>> rvaft.monitor(rvaft.loads("top and a b;"), semantics="loose")
    Traceback (most recent call last):
    ...
    rvaft.errors.OptionError: unknown semantics 'loose'; known: strict, projected, scattered
    """
