"""Files to drafts: decoding, imports (each file once, no cycles), merging of statements."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, assert_never

from rvaft.errors import LanguageError
from rvaft.language.builder import (
    At,
    AttributeClause,
    CausalityStatement,
    EventStatement,
    GateClause,
    IgnoreStatement,
    ImportStatement,
    KindClause,
    LabelClause,
    NodeStatement,
    OnClause,
    ParamStatement,
    PruneStatement,
    Statement,
    TopicStatement,
    ToplevelStatement,
    WhenClause,
)
from rvaft.language.diagnostics import error_in_line
from rvaft.language.draft import Draft, DraftNode, DraftTopic, GateUse, Said, carry_out_prunes
from rvaft.language.parser import parse_statements
from rvaft.language.words import shown
from rvaft.model.nodes import EventType, Ignore, Place

MAX_FILE: Final = 16 * 1024 * 1024
"""The largest file, in bytes: a tree of ten thousand nodes takes less than one mebibyte."""


def parse(text: str, file: str = "<text>") -> Draft:
    """The draft that a text and its imports make; paths of imports are relative to the folder of `file`.

    Raises `LanguageError` for what is not in the language, here or in an imported file. What is in the language and still
    no tree (a cycle, a part set twice, …) stays in the draft.
    """
    draft = Draft(file)
    _read_all(draft, _Source(file, os.path.realpath(file), text))
    if not draft.nodes:
        raise LanguageError("there is no tree here: no statement is about a node", file=file)
    carry_out_prunes(draft)
    return draft


def parse_file(path: os.PathLike[str] | str) -> Draft:
    """The draft of a file and its imports; raises `LanguageError` as `parse` does, and `OSError` where it cannot be read."""
    name = os.fspath(path)
    return parse(_text_of(name), name)


def parse_bytes(data: bytes, file: str) -> Draft:
    """As `parse`, from the bytes of a file or stream; what is no UTF-8 text is a `LanguageError` too."""
    return parse(_decoded(data, file), file)


def _text_of(name: str) -> str:
    try:
        with Path(name).open("rb") as stream:
            data = stream.read(MAX_FILE + 1)  # never more: a device has no end
    except OSError as error:
        raise OSError(error.errno, f"cannot read the file: {error.strerror}", name) from error
    except ValueError as error:  # a path that no system can have
        raise LanguageError(f"cannot read the file: {error}", file=name) from error
    return _decoded(data, name)


def _decoded(data: bytes, name: str) -> str:
    if len(data) > MAX_FILE:
        raise LanguageError(f"the file is larger than {MAX_FILE // 1024**2} MiB, which is no tree", file=name)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start]
        line = before.count(b"\n") + 1
        raise LanguageError("this is no UTF-8 text", file=name, line=line) from error
    return text


@dataclass(slots=True)
class _Source:
    """One file being read: how far, and the `toplevel` settings that count in it."""

    name: str
    identity: str
    text: str
    statements: Iterator[Statement] = field(default_factory=lambda: iter(()))
    toplevels: list[Said[str]] = field(default_factory=list)
    imported: list[str] = field(default_factory=list)

    def place(self, at: At[object]) -> Place:
        return Place(self.name, at.line, at.column)

    def error(self, message: str, at: At[object]) -> LanguageError:
        return error_in_line(message, self.text, at.line, at.column, self.name)


def _read_all(draft: Draft, main: _Source) -> None:
    """Read a file and its imports, depth first, each file once; the importing file's `toplevel` counts."""
    main.statements = iter(parse_statements(main.text, main.name))
    toplevels: dict[str, list[Said[str]]] = {}
    open_files = [main]
    while open_files:
        source = open_files[-1]
        for statement in source.statements:
            if not isinstance(statement, ImportStatement):
                _merge(draft, source, statement)
                continue
            inner = _import(source, statement.path, open_files)
            source.imported.append(inner.identity)
            if inner.identity not in toplevels:
                inner.statements = iter(parse_statements(inner.text, inner.name))
                open_files.append(inner)
                break
        else:
            inherited = (said for identity in source.imported for said in toplevels[identity])
            toplevels[source.identity] = source.toplevels or list(dict.fromkeys(inherited))
            open_files.pop()
    draft.toplevels = toplevels[main.identity]


def _import(source: _Source, path: At[str], open_files: list[_Source]) -> _Source:
    name = os.path.join(os.path.dirname(source.name), path.value)  # noqa: PTH118, PTH120 - keeps "./" as written
    try:
        text = _text_of(name)
    except LanguageError as error:
        if isinstance(error.__cause__, UnicodeDecodeError):
            raise
        raise source.error(f"cannot import {shown(path.value)}: {error.message}", path) from error
    except OSError as error:
        raise source.error(f"cannot import {shown(path.value)}: {error.strerror}", path) from error
    identity = os.path.realpath(name)
    if any(identity == other.identity for other in open_files):
        raise source.error(f"the files import each other in a circle: {shown(path.value)} is being read already", path)
    return _Source(name, identity, text)


def _merge(draft: Draft, source: _Source, statement: Statement) -> None:
    match statement:
        case NodeStatement():
            _merge_node(draft, source, statement)
        case ToplevelStatement(name):
            source.toplevels.append(_said(source, name))
        case ParamStatement(name):
            draft.parameters.append(_said(source, name))
        case CausalityStatement(causality):
            draft.causalities.append(Said(causality.value, source.place(causality)))
        case PruneStatement(names):
            draft.prunes.extend(_said(source, name) for name in names)
        case IgnoreStatement(on, when):
            draft.ignores.append(Ignore(on.value, when, source.place(on)))
        case EventStatement(name, parameters, pattern):
            draft.events.append(EventType(name.value, parameters, pattern, source.place(name)))
        case TopicStatement(name, type_, publishers):
            nodes = tuple(_said(source, publisher) for publisher in publishers)
            draft.topics.append(DraftTopic(_said(source, name), _said(source, type_), nodes))
        case ImportStatement():
            raise AssertionError("imports are followed before statements are merged")
        case _:
            assert_never(statement)


def _said(source: _Source, at: At[str]) -> Said[str]:
    return Said(at.value, source.place(at))


def _merge_node(draft: Draft, source: _Source, statement: NodeStatement) -> None:
    name = statement.name.value
    node = draft.nodes.get(name)
    if node is None:
        node = draft.nodes[name] = DraftNode(name)
    node.statements.append(source.place(statement.name))
    for at in statement.clauses:
        place = source.place(at)
        match at.value:
            case GateClause(gate, children, threshold, out_of):
                said = tuple(_said(source, child) for child in children)
                node.gates.append(Said(GateUse(gate, said, threshold, out_of), place))
            case OnClause(on):
                node.ons.append(Said(on, place))
            case WhenClause(guard):
                node.whens.append(Said(guard, place))
            case KindClause(kind):
                node.kinds.append(Said(kind, place))
            case LabelClause(label):
                node.labels.append(Said(label, place))
            case AttributeClause(key, value):
                node.attributes.append(Said((key, value), place))
            case _ as never:
                assert_never(never)
