"""The errors of rvaft: each derives from `RvaftError` and a builtin, and has its details as
attributes.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from importlib import import_module
from types import UnionType
from typing import Any, Final, NamedTuple, TypeVar, assert_never

_LONGEST: Final = 300
"""Longer lines of a text are not quoted."""


class RvaftError(Exception):
    """The base class of all expected errors.

    >>> issubclass(TreeError, RvaftError) and issubclass(TreeError, ValueError)
    True
    """


class LanguageError(RvaftError, ValueError):
    """A text (tree, pattern, guard, specification) is not in its language.

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
        """The source line with a caret below the column, or ""."""
        if not self.source:
            return ""
        before = "".join(c if c == "\t" else " " for c in self.source[: self.column - 1])
        return f"{self.source}\n{before}^"

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}: {self.message}"
        return f"{where}\n{self.caret}" if self.caret else where


def error_at(message: str, text: str, position: int, file: str) -> LanguageError:
    """Return a `LanguageError` about a position of a text."""
    start = text.rfind("\n", 0, position) + 1
    end = text.find("\n", position)
    line = text[start : end if end >= 0 else len(text)].rstrip("\r")
    source = "".join(c if c.isprintable() or c == "\t" else "?" for c in line) if len(line) <= _LONGEST else ""
    number = text.count("\n", 0, position) + 1
    return LanguageError(message, file=file, line=number, column=position - start + 1, source=source)


class TreeError(RvaftError, ValueError):
    """A tree breaks a rule; `rule` is its code for `rvaft explain`, `nodes` are the nodes.

    >>> TreeError("the root top is not a node of the tree", rule="no-root", nodes=["top"]).rule
    'no-root'
    """

    def __init__(self, message: str, *, rule: str, nodes: Iterable[str] = ()) -> None:
        self.message = message
        self.rule = rule
        self.nodes = tuple(nodes)
        super().__init__(f"{message} [{rule}]")


class Cause(StrEnum):
    """Why a tree has no text in a language."""

    LANGUAGE = "the language cannot express it"
    WRITER = "rvaft does not write it"


class Reason(NamedTuple):
    """A reason why a tree has no text in a language, with its cause."""

    cause: Cause
    text: str

    def about(self, what: str) -> "Reason":
        """Return the reason with what it is about."""
        return self._replace(text=f"{self.text}: {what}")


def cannot(text: str) -> Reason:
    """Return a reason that no text of the language could avoid; the page of the language has the argument."""
    return Reason(Cause.LANGUAGE, text)


def unwritten(text: str) -> Reason:
    """Return a reason that concerns what rvaft writes, and claims nothing about the language."""
    return Reason(Cause.WRITER, text)


class NotExpressible(RvaftError, ValueError):
    """A backend has no text for this tree under this semantics.

    A writer gives the reason and the nodes; `Backend.translate` adds backend and semantics.

    >>> print(NotExpressible(unwritten("the paper does not say how"), backend="rml-paper", semantics="scattered"))
    rvaft does not write this tree in rml-paper under scattered: the paper does not say how
    >>> print(NotExpressible(cannot("STIX has no null"), backend="stix", semantics="scattered", nodes=["a"]))
    stix cannot express this tree under scattered: STIX has no null (at a)
    """

    def __init__(self, why: Reason, *, backend: str = "", semantics: str = "", nodes: Iterable[str] = ()) -> None:
        expect("the reason of a refusal", why, Reason, "cannot(…) or unwritten(…) of rvaft.errors")
        self.why = why
        self.backend = backend
        self.semantics = semantics
        self.nodes = tuple(nodes)
        at = f" (at {', '.join(self.nodes)})" if self.nodes else ""
        match why.cause:
            case Cause.LANGUAGE:
                who = f"{backend} cannot express this tree" if backend else "the tree cannot be expressed"
            case Cause.WRITER:
                who = f"rvaft does not write this tree in {backend}" if backend else "the tree is not written"
            case _:
                assert_never(why.cause)
        under = f" under {semantics}" if semantics else ""
        super().__init__(f"{who}{under}: {self.reason}{at}")

    @property
    def reason(self) -> str:
        """The text of the reason."""
        return self.why.text

    @property
    def cause(self) -> Cause:
        """Whether the language or the writer is the cause."""
        return self.why.cause


@contextmanager
def naming(node: str) -> Iterator[None]:
    """Add the node to a refusal without nodes."""
    try:
        yield
    except NotExpressible as refusal:
        raise NotExpressible(refusal.why, nodes=refusal.nodes or [node]) from None


class TooLarge(RvaftError, RuntimeError):
    """A computation exceeds a limit that the caller can raise; `remedy` becomes a note.

    >>> print(TooLarge("states of the automaton", limit=60))
    too large: states of the automaton (limit 60)
    """

    def __init__(self, what: str, *, limit: int, remedy: str = "") -> None:
        self.what = what
        self.limit = limit
        super().__init__(f"too large: {what} (limit {limit})")
        if remedy:
            self.add_note(remedy)


class NoVerdict(RvaftError, RuntimeError):
    """A monitor has no verdict after an event, where its language leaves the trace open.

    >>> print(NoVerdict("a number needs more than 64 bits", event=1))
    event 1: a number needs more than 64 bits
    """

    def __init__(self, reason: str, *, event: int) -> None:
        self.reason = reason
        super().__init__(f"event {event}: {reason}")


class CheckpointError(RvaftError, ValueError):
    """A checkpoint cannot be written or used; `file` is its path.

    >>> print(CheckpointError("run.ckpt", "it is of another tree"))
    run.ckpt: it is of another tree
    """

    def __init__(self, file: str | os.PathLike[str], reason: str) -> None:
        self.file = os.fspath(file)
        self.reason = reason
        super().__init__(f"{self.file}: {reason}")


class TraceError(RvaftError, ValueError):
    """A trace is malformed; `line` counts from 1, and is None if the error has no line.

    >>> print(TraceError("not a JSON object", file="log.jsonl", line=7))
    log.jsonl:7: not a JSON object
    """

    def __init__(self, message: str, *, file: str = "<trace>", line: int | None = 1) -> None:
        self.message = message
        self.file = file
        self.line = line
        super().__init__(f"{file}: {message}" if line is None else f"{file}:{line}: {message}")


class ToolMissing(RvaftError, RuntimeError):
    """A required program or library is not installed; `remedy` tells how to install it.

    >>> print(ToolMissing("Graphviz", remedy="apt-get install graphviz"))
    Graphviz is not installed: apt-get install graphviz
    """

    def __init__(self, tool: str, *, remedy: str) -> None:
        self.tool = tool
        self.remedy = remedy
        super().__init__(f"{tool} is not installed: {remedy}")


def installed(module: str, tool: str, remedy: str) -> Any:
    """Import and return a module of an optional library; raises `ToolMissing`.

    >>> installed("json", "JSON", "install Python").loads("1")
    1
    """
    try:
        return import_module(module)
    except ImportError:
        raise ToolMissing(tool, remedy=remedy) from None


class ToolFailed(RvaftError, RuntimeError):
    """An installed program or library failed.

    >>> print(ToolFailed("dot", reason="exit status 1"))
    dot failed: exit status 1
    """

    def __init__(self, tool: str, *, reason: str) -> None:
        self.tool = tool
        self.reason = reason
        super().__init__(f"{tool} failed: {reason}")


class ToolTimeout(ToolFailed):
    """A program, or a process that reads a text, gave no answer within the time limit.

    >>> print(ToolTimeout("rule.sql", seconds=2))
    rule.sql failed: no answer within 2 s; --timeout sets the limit
    """

    def __init__(self, tool: str, *, seconds: float) -> None:
        super().__init__(tool, reason=f"no answer within {seconds:g} s; --timeout sets the limit")


class WrongType(RvaftError, TypeError):
    """An argument has the wrong type.

    >>> print(WrongType("limit", "many", "an int"))
    limit must be an int, not str
    """

    def __init__(self, what: str, value: object, expected: str) -> None:
        self.value = value
        self.expected = expected
        super().__init__(f"{what} must be {expected}, not {type(value).__name__}")


def expect(what: str, value: object, kind: type | UnionType, expected: str) -> None:
    """Raise `WrongType` unless an argument has this type."""
    if not isinstance(value, kind):
        raise WrongType(what, value, expected)


Choice = TypeVar("Choice", bound=StrEnum)


def one_of(choices: type[Choice], value: Choice | str) -> Choice:
    """Return the member of an enumeration with that value; raises `OptionError`."""
    try:
        return choices(value)
    except ValueError:
        known = ", ".join(choice.value for choice in choices)
        raise OptionError(f"unknown {choices.__name__.lower()} {value!r}; known: {known}") from None


class OptionError(RvaftError, ValueError):
    """An option has an invalid value, or contradicts another option.

    >>> import rvaft
    >>> rvaft.monitor(rvaft.loads("top and a b;"), semantics="loose")
    Traceback (most recent call last):
    ...
    rvaft.errors.OptionError: unknown semantics 'loose'; known: strict, projected, consecutive, scattered
    """
