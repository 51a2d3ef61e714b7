"""The functions of `import rvaft`: load, check, draw, translate and monitor a tree; and the types
that they take and return.

`branch` and `kind` narrow a tree to one branch, or to the branches that have a kind.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum
from typing import Any, Final, TypeVar

from rvaft.backend import Backend, Metrics, Specification, UnknownBackend, all_backends, backend
from rvaft.core.branches import Branch, restrict
from rvaft.core.branches import branches as branches_of
from rvaft.engine.monitor import DEFAULT_LIMIT, Engine
from rvaft.errors import (
    CheckpointError,
    LanguageError,
    NotExpressible,
    OptionError,
    RvaftError,
    TooLarge,
    ToolFailed,
    ToolMissing,
    TraceError,
    TreeError,
    WrongType,
    expect,
)
from rvaft.export import dot_text, looking, picture
from rvaft.export.property_text import property_text
from rvaft.language.draft import Draft, no_collections
from rvaft.language.parser import parse, parse_file
from rvaft.language.printer import dumps
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Topic
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Awaited, Ended, Explanation, Monitor, Pending, Repetition
from rvaft.rules import check_draft, check_tree, require_valid
from rvaft.rules.rule import Finding, Severity

__all__ = [
    "RVAFT",
    "Awaited",
    "Backend",
    "Branch",
    "Causality",
    "CheckpointError",
    "Ended",
    "EventType",
    "Explanation",
    "Finding",
    "Gate",
    "Ignore",
    "Kind",
    "LanguageError",
    "Metrics",
    "Monitor",
    "Node",
    "NotExpressible",
    "On",
    "OptionError",
    "Pending",
    "Repetition",
    "RvaftError",
    "Semantics",
    "Severity",
    "Specification",
    "TooLarge",
    "ToolFailed",
    "ToolMissing",
    "Topic",
    "TraceError",
    "TreeError",
    "UnknownBackend",
    "Verdict",
    "WrongType",
    "all_backends",
    "branches",
    "check",
    "dumps",
    "load",
    "loads",
    "monitor",
    "to_dot",
    "translate",
]

_TREE: Final = "an RVAFT, as rvaft.load returns it"

Choice = TypeVar("Choice", bound=StrEnum)


def translate(
    tree: RVAFT,
    language: str,
    *,
    semantics: Semantics | str | None = None,
    branch: int | None = None,
    kind: Kind | str | None = None,
    limit: int | None = None,
    mapping: Mapping[str, Any] | None = None,
) -> Specification:
    r"""The tree as a specification; `language` names a backend.

    A `mapping` says how a language that takes one calls the fields of events.

    Raises `UnknownBackend`, `OptionError`, `TreeError` for a tree that breaks a rule or has no such
    branch or kind, `NotExpressible` where the language cannot say it, `TooLarge` beyond the limit
    (None is the backend's own), and `WrongType`.

    >>> print(translate(loads("top or a b;"), "rml", semantics="strict").text.splitlines()[-1])
    Main = (a \/ b) all;
    """
    expect("tree", tree, RVAFT, _TREE)
    expect("language", language, str, "a str, the name of a backend")
    expect("branch", branch, int | None, "an int")
    expect("limit", limit, int | None, "an int")
    expect("mapping", mapping, Mapping | None, "a mapping of event types")
    speaks = backend(language) if mapping is None else backend(language).mapped(mapping)
    return speaks.translate(narrowed(tree, branch, kind), resolve_semantics(tree, semantics), limit=limit)


def monitor(
    tree: RVAFT,
    *,
    semantics: Semantics | str | None = None,
    branch: int | None = None,
    kind: Kind | str | None = None,
    limit: int = DEFAULT_LIMIT,
    repeat: bool = False,
) -> Monitor:
    """A fresh monitor of the tree; `limit` bounds the partial matches that it follows.

    `semantics` is as for `translate`.

    With `repeat` it is a `Repetition`, which begins afresh with the event after each detection.

    Raises `OptionError`, `TreeError` for a tree that breaks a rule or has no such branch or kind,
    `WrongType`, and, when it reads events too, `TooLarge`.

    >>> watching = monitor(loads("top 2of3 a b c;"), semantics="scattered")
    >>> [watching.step({"event": name}).symbol for name in "cxa"]
    ['?', '?', '⊤']
    """
    expect("tree", tree, RVAFT, _TREE)
    expect("branch", branch, int | None, "an int")
    expect("limit", limit, int, "an int")
    expect("repeat", repeat, bool, "a bool")
    engine = Engine(narrowed(tree, branch, kind), resolve_semantics(tree, semantics), limit=limit)
    return Repetition(engine) if repeat else engine


def check(tree: RVAFT) -> list[Finding]:
    """What the rules of `rvaft check` find in a tree, errors and warnings, in the order of their places.

    >>> for finding in check(loads("top or a b; a; b when 1 > 2;")):
    ...     print(finding.code, finding.severity, *finding.nodes)
    infeasible-scenario warning b
    """
    expect("tree", tree, RVAFT, _TREE)
    return check_tree(tree)


def branches(tree: RVAFT) -> Iterator[Branch]:
    """Yield the branches of a tree in the order of their numbers, from 1; there may be very many. Raises `WrongType`.

    >>> [(branch.number, branch.formula) for branch in branches(loads("top or a both; both sand b c;"))]
    [(1, 'a'), (2, 'b ; c')]
    """
    expect("tree", tree, RVAFT, _TREE)
    return branches_of(tree)


def to_dot(
    tree: RVAFT,
    *,
    events: bool = False,
    names: bool = True,
    wrap: int | None = None,
    depth: int | None = None,
    collapse: Iterable[str] = (),
    branch: int | None = None,
    legend: bool = False,
    stagger: bool = False,
) -> str:
    """Return the tree drawn in the DOT language of Graphviz.

    `events` shows runtime events and guards, `names` shows the names of nodes that also have a label, `wrap` breaks
    lines at that many columns, `depth` and `collapse` leave out what is below a level or a node, `branch` marks the
    branch of that number, `legend` explains the signs, `stagger` sets every other leaf of a gate lower, which makes the
    tree narrower. Raises `OptionError`, `TreeError` where there is no such branch, and `WrongType`.

    >>> to_dot(loads("top or a b;")).startswith("digraph")
    True
    """
    expect("tree", tree, RVAFT, _TREE)
    look = looking(
        tree,
        events=events,
        names=names,
        wrap=wrap,
        depth=depth,
        collapse=collapse,
        branch=branch,
        legend=legend,
        stagger=stagger,
    )
    return dot_text(tree, look)


def _notebook_svg(tree: RVAFT) -> str | None:
    """The picture that a notebook shows, or None where Graphviz is not installed or fails."""
    try:
        return picture(to_dot(tree), "svg", timeout=20).decode()
    except (ToolMissing, ToolFailed):
        return None


RVAFT.notebook_svg = staticmethod(_notebook_svg)
Branch.text = staticmethod(property_text)


def narrowed(tree: RVAFT, branch: int | None = None, kind: Kind | str | None = None) -> RVAFT:
    """The tree itself, or the part of it that a monitor for one branch or one kind looks at.

    Raises `TreeError` where the tree breaks a rule, or has no such part.
    """
    require_valid(tree)
    part = restrict(tree, branch=branch, kind=None if kind is None else one_of(Kind, kind))
    try:
        require_valid(part)
    except TreeError as error:
        if error.rule != "no-scenario":
            raise
        name = f"branch {branch}" if branch is not None else f"the part of kind {kind}"
        message = f"{name} has no feasible scenario: nothing can be detected there"
        raise TreeError(message, rule=error.rule, nodes=error.nodes) from error
    return part


def resolve_semantics(tree: RVAFT, semantics: Semantics | str | None = None) -> Semantics:
    """The semantics that is asked for, or else the one that the tree states, or else `projected`; raises `OptionError`.

    >>> resolve_semantics(loads("semantics scattered; top or a b;"))
    <Semantics.SCATTERED: 'scattered'>
    """
    return (tree.semantics or Semantics.PROJECTED) if semantics is None else one_of(Semantics, semantics)


def one_of(choices: type[Choice], value: Choice | str) -> Choice:
    """The member of an enumeration that a word names; raises `OptionError`."""
    try:
        return choices(value)
    except ValueError:
        known = ", ".join(choice.value for choice in choices)
        raise OptionError(f"unknown {choices.__name__.lower()} {value!r}; known: {known}") from None


@no_collections()
def loads(text: str, file: str = "<text>", *, strict_galileo: bool = False, confine_imports: bool = False) -> RVAFT:
    """The tree that a text stands for; imports are relative to the folder of `file`.

    With `confine_imports`, those of files outside that folder are refused.

    Raises `LanguageError` for what is not in the language and `TreeError` for the first rule that
    the tree breaks. Galileo's dynamic gates are read with the meaning that observed failures have,
    or, with `strict_galileo`, refused.

    >>> loads("top sand a b;")
    <RVAFT top: 3 nodes>
    """
    expect("the text of a tree", text, str, "a str")
    return _checked(parse(text, file, strict_galileo=strict_galileo, confine_imports=confine_imports))


@no_collections()
def load(path: os.PathLike[str] | str, *, strict_galileo: bool = False, confine_imports: bool = False) -> RVAFT:
    """The tree in a file, also in Galileo's format; raises as `loads` does, and `OSError` where it cannot be read.

    >>> load("trees/gates/and.rvaft")
    <RVAFT top: 4 nodes>
    """
    expect("the path of a tree", path, str | os.PathLike, "a str or a path")
    return _checked(parse_file(path, strict_galileo=strict_galileo, confine_imports=confine_imports))


def _checked(draft: Draft) -> RVAFT:
    """The tree of a draft; raises the first error that a rule finds, with its place."""
    _raise_first(check_draft(draft))
    tree = draft.build()
    try:
        require_valid(tree)  # errors only, and remembered for whoever asks next
    except TreeError:
        _raise_first(check_tree(tree))
        raise
    return tree


def _raise_first(findings: Iterable[Finding]) -> None:
    for finding in findings:
        if finding.severity is Severity.ERROR:
            raise TreeError(f"{finding.place}: {finding.message}", rule=finding.code, nodes=finding.nodes)
