"""`rvaft lsp`: a language server for editors, over standard input and output.

The functions of `analysis` and `completion` do the work; here they are put into the protocol.
"""

import asyncio
import os
from collections.abc import Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple, Self

import click

import rvaft
from rvaft.cli import options
from rvaft.errors import installed
from rvaft.integrations.editor import analysis, completion, sample_log
from rvaft.integrations.editor.document import MAX_TEXT, Document, Position, Region, Target
from rvaft.language.formatting import NotFormatted, formatted
from rvaft.language.parser import TreeOptions
from rvaft.language.words import Sort
from rvaft.rules.rule import Severity

_PAUSE: Final = 0.2
"""Seconds after a change before the text is checked."""
_SEVERITIES: Final = {Severity.ERROR: "Error", Severity.WARNING: "Warning", Severity.INFORMATION: "Information"}
_KINDS: Final = {
    Sort.NODE: "Variable",
    Sort.EVENT: "Function",
    Sort.FIELD: "Field",
    Sort.PARAMETER: "Variable",
    Sort.VARIABLE: "Variable",
    Sort.FUNCTION: "Function",
    Sort.STRING: "Value",
    Sort.CHOICE: "EnumMember",
    Sort.CONSTANT: "Constant",
    Sort.OPERATOR: "Operator",
}
"""The kinds of proposals; the others are keywords."""


@click.command("lsp")
@options.reading_options
def lsp_command() -> int:
    """Serve editors by the Language Server Protocol, over standard input and output.

    An editor starts it. Needs the extra `editor`.
    """
    context = click.get_current_context()
    reading: TreeOptions = {
        "strict_galileo": bool(context.meta.get("strict_galileo")),
        "year": context.meta.get("year"),
    }
    made = server(reading, confined=options.is_confined())
    with open(os.dup(0), "rb") as source, open(os.dup(1), "wb") as sink:  # noqa: PTH123 - pygls closes them
        made.start_io(source, sink)
    return 0


class Workspace:
    """The documents of an editor and their samples; `log` is the setting of that name."""

    def __init__(self, reading: TreeOptions | None = None, *, confined: bool = False) -> None:
        self.log = ""
        self.reading: TreeOptions = reading or {}
        self._confined = confined
        self._sample = cache(lambda files, _stamps: sample_log.read(files))

    def configure(self, settings: object) -> None:
        """Read the settings of an editor: `{"log": …}`, also inside `{"rvaft": …}`."""
        inner = settings.get("rvaft", settings) if isinstance(settings, dict) else {}
        log = inner.get("log", "") if isinstance(inner, dict) else ""
        self.log = log if isinstance(log, str) else ""

    def document(self, text: str, path: str | None) -> Document:
        """Return the document of a text; without a path it has no file."""
        return Document(text, path or "<text>", self._confined)

    def sample(self, document: Document) -> sample_log.Sample:
        """Return the sample of a document, read again only if its files have changed."""
        files, stamps = [], []
        for file in sample_log.files_of(document.file, self.log):
            with suppress(OSError):
                stamps.append(((found := file.stat()).st_mtime_ns, found.st_size))
                files.append(file)
        found_sample: sample_log.Sample = self._sample(tuple(files), tuple(stamps))
        return found_sample


class Protocol(NamedTuple):
    """The modules of pygls, and the types of the protocol."""

    server: ModuleType
    uris: ModuleType
    types: ModuleType

    @classmethod
    def imported(cls) -> Self:
        """Import the modules; raises `ToolMissing`."""
        names = ("pygls.lsp.server", "pygls.uris", "lsprotocol.types")
        return cls(*(installed(name, "pygls", "pip install 'rvaft[editor]'") for name in names))


class Service:
    """The answers to an editor, in the types of the protocol; `server` is that of pygls."""

    def __init__(self, server: Any, protocol: Protocol, workspace: Workspace) -> None:
        self.server = server
        self.uris = protocol.uris
        self.types = protocol.types
        self.workspace = workspace
        self._later: dict[str, asyncio.TimerHandle] = {}

    def register(self) -> None:
        """Register the answers."""
        types = self.types
        completion_options = types.CompletionOptions(trigger_characters=['"', "(", "{", ",", ":", " "])
        for name, answer, given in (
            (types.INITIALIZE, self.initialize, None),
            (types.WORKSPACE_DID_CHANGE_CONFIGURATION, self.configure, None),
            (types.TEXT_DOCUMENT_DID_OPEN, self.publish_now, None),
            (types.TEXT_DOCUMENT_DID_SAVE, self.publish_now, None),
            (types.TEXT_DOCUMENT_DID_CHANGE, self.publish_later, None),
            (types.TEXT_DOCUMENT_DID_CLOSE, self.close, None),
            (types.TEXT_DOCUMENT_HOVER, self.hover, None),
            (types.TEXT_DOCUMENT_COMPLETION, self.complete, completion_options),
            (types.TEXT_DOCUMENT_DEFINITION, self.define, None),
            (types.TEXT_DOCUMENT_REFERENCES, self.refer, None),
            (types.TEXT_DOCUMENT_DOCUMENT_SYMBOL, self.list_symbols, None),
            (types.TEXT_DOCUMENT_FORMATTING, self.lay_out, None),
        ):
            self.server.feature(name, given)(partial(answer))  # pygls sets attributes, and a method has none

    def initialize(self, given: Any) -> None:
        """Read the settings at the start."""
        self.workspace.configure(given.initialization_options)

    def configure(self, given: Any) -> None:
        """Read changed settings."""
        self.workspace.configure(given.settings)

    def _document(self, uri: str) -> Document:
        path = self.uris.to_fs_path(uri) if uri.startswith("file:") else None
        return self.workspace.document(self.server.workspace.get_text_document(uri).source, path)

    def _place(self, given: Any) -> tuple[Document, int]:
        document = self._document(given.text_document.uri)
        return document, document.offset(Position(given.position.line, given.position.character))

    def _range(self, region: Region) -> Any:
        return self.types.Range(self.types.Position(*region.start), self.types.Position(*region.end))

    def _location(self, target: Target, document: Document, uri: str) -> Any:
        other = target.file != document.file
        where = self.uris.from_fs_path(str(Path(target.file).resolve())) if other else uri
        return self.types.Location(where, self._range(target.region))

    def _locations(self, targets: Sequence[Target], document: Document, given: Any) -> list[Any]:
        return [self._location(target, document, given.text_document.uri) for target in targets]

    # findings

    def publish_now(self, given: Any) -> None:
        """Send the findings on a text."""
        self._publish(given.text_document.uri)

    def publish_later(self, given: Any) -> None:
        """Send the findings on a changed text after a pause without a change."""
        uri = given.text_document.uri
        self._cancel(uri)
        self._later[uri] = asyncio.get_running_loop().call_later(_PAUSE, self._publish, uri)

    def close(self, given: Any) -> None:
        """Withdraw the findings on a text."""
        self._cancel(given.text_document.uri)
        self._send(given.text_document.uri, [])

    def _cancel(self, uri: str) -> None:
        if (waiting := self._later.pop(uri, None)) is not None:
            waiting.cancel()

    def _publish(self, uri: str) -> None:
        self._cancel(uri)
        document = self._document(uri)
        found = [self._diagnostic(one, document, uri) for one in analysis.problems(document, self.workspace.reading)]
        self._send(uri, found, self.server.workspace.get_text_document(uri).version)

    def _send(self, uri: str, found: list[Any], version: int | None = None) -> None:
        self.server.text_document_publish_diagnostics(self.types.PublishDiagnosticsParams(uri, found, version))

    def _diagnostic(self, one: analysis.Problem, document: Document, uri: str) -> Any:
        related = None
        if one.origin is not None:
            place = self._location(one.origin, document, uri)
            related = [self.types.DiagnosticRelatedInformation(place, one.message)]
        return self.types.Diagnostic(
            range=self._range(one.region),
            message=f"{one.message}\n{one.explanation}".rstrip(),
            severity=getattr(self.types.DiagnosticSeverity, _SEVERITIES[one.severity]),
            code=one.code,
            source="rvaft",
            related_information=related,
        )

    # places and names

    def hover(self, given: Any) -> Any:
        """Return the meaning of a word, or None."""
        document, offset = self._place(given)
        found = analysis.hover(document, offset, self.workspace.sample(document))
        if found is None:
            return None
        content = self.types.MarkupContent(self.types.MarkupKind.Markdown, found.markdown)
        return self.types.Hover(content, self._range(found.region))

    def complete(self, given: Any) -> Any:
        """Return what can be written at a place, in the order of the proposals."""
        document, offset = self._place(given)
        found = completion.proposals(document, offset, self.workspace.sample(document))
        items = [
            self.types.CompletionItem(
                label=one.label,
                kind=getattr(self.types.CompletionItemKind, _KINDS.get(one.sort, "Keyword")),
                detail=one.detail or None,
                sort_text=f"{number:04}",
                text_edit=self.types.TextEdit(self._range(document.region(one.start, one.end)), one.label),
            )
            for number, one in enumerate(found)
        ]
        return self.types.CompletionList(is_incomplete=len(items) >= completion.MOST, items=items)

    def define(self, given: Any) -> Any:
        """Return the statements about a name."""
        document, offset = self._place(given)
        return self._locations(analysis.definition(document, offset), document, given)

    def refer(self, given: Any) -> Any:
        """Return the uses of a name."""
        document, offset = self._place(given)
        found = analysis.references(document, offset, declarations=given.context.include_declaration)
        return self._locations(found, document, given)

    def list_symbols(self, given: Any) -> Any:
        """Return the nodes and event types of a text."""
        kinds = {Sort.NODE: self.types.SymbolKind.Object, Sort.EVENT: self.types.SymbolKind.Event}
        return [
            self.types.DocumentSymbol(
                name=one.name,
                kind=kinds[one.sort],
                range=self._range(one.region),
                selection_range=self._range(one.selection),
                detail=one.detail or None,
            )
            for one in analysis.symbols(self._document(given.text_document.uri))
        ]

    def lay_out(self, given: Any) -> Any:
        """Return the change to another layout; None if the text has an error or is too large."""
        document = self._document(given.text_document.uri)
        if len(document.text) > MAX_TEXT:
            return None
        try:
            text = formatted(document.text)
        except NotFormatted:
            return None
        whole = self._range(document.region(0, len(document.text)))
        return [self.types.TextEdit(whole, text)] if text != document.text else []


def server(reading: TreeOptions | None = None, *, confined: bool = False) -> Any:
    """Return the language server; raises `ToolMissing` without pygls."""
    protocol = Protocol.imported()
    sync = protocol.types.TextDocumentSyncKind.Full  # pygls counts other line breaks than the protocol
    made = protocol.server.LanguageServer("rvaft", rvaft.__version__, text_document_sync_kind=sync)
    Service(made, protocol, Workspace(reading, confined=confined)).register()
    return made
