"""`rvaft lsp`: a language server for editors, over standard input and output.

The functions of `analysis` and `completion` do the work; here they are put into the protocol.
"""

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Final

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
    reading: TreeOptions = {"strict_galileo": bool(context.meta.get("strict_galileo")), "year": context.meta.get("year")}
    server(reading, confined=options.is_confined()).start_io()
    return 0


def _protocol() -> tuple[ModuleType, ModuleType, ModuleType]:
    """Return the modules of pygls and of the types of the protocol; raises `ToolMissing`."""
    remedy = "pip install 'rvaft[editor]'"
    names = ("pygls.lsp.server", "pygls.uris", "lsprotocol.types")
    server_module, uris, types = (installed(name, "pygls", remedy) for name in names)
    return server_module, uris, types


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


def server(reading: TreeOptions | None = None, *, confined: bool = False) -> Any:
    """Return the language server; raises `ToolMissing` without pygls."""
    pygls, uris, types = _protocol()
    sync = types.TextDocumentSyncKind.Full  # pygls counts other line breaks than the protocol
    made = pygls.LanguageServer("rvaft", rvaft.__version__, text_document_sync_kind=sync)
    workspace = Workspace(reading, confined=confined)
    running: dict[str, asyncio.Task[None]] = {}

    def document_of(uri: str) -> Document:
        path = uris.to_fs_path(uri) if uri.startswith("file:") else None
        return workspace.document(made.workspace.get_text_document(uri).source, path)

    def place_of(given: Any) -> tuple[Document, int]:
        document = document_of(given.text_document.uri)
        return document, document.offset(Position(given.position.line, given.position.character))

    def range_of(region: Region) -> Any:
        return types.Range(types.Position(*region.start), types.Position(*region.end))

    def location_of(target: Target, document: Document, uri: str) -> Any:
        own = target.file == document.file
        return types.Location(uri if own else uris.from_fs_path(str(Path(target.file).resolve())), range_of(target.region))

    def locations(targets: Sequence[Target], document: Document, uri: str) -> list[Any]:
        return [location_of(target, document, uri) for target in targets]

    def diagnostic(one: analysis.Problem, document: Document, uri: str) -> Any:
        related = []
        if one.origin is not None:
            related = [types.DiagnosticRelatedInformation(location_of(one.origin, document, uri), one.message)]
        return types.Diagnostic(
            range=range_of(one.region),
            message=f"{one.message}\n{one.explanation}".rstrip(),
            severity=getattr(types.DiagnosticSeverity, _SEVERITIES[one.severity]),
            code=one.code,
            source="rvaft",
            related_information=related or None,
        )

    def publish(uri: str) -> None:
        document = document_of(uri)
        found = [diagnostic(one, document, uri) for one in analysis.problems(document, workspace.reading)]
        version = made.workspace.get_text_document(uri).version
        made.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, found, version))

    async def publish_later(uri: str) -> None:
        await asyncio.sleep(_PAUSE)
        publish(uri)

    @made.feature(types.INITIALIZE)  # type: ignore[untyped-decorator]
    def initialize(given: Any) -> None:
        workspace.configure(given.initialization_options)

    @made.feature(types.WORKSPACE_DID_CHANGE_CONFIGURATION)  # type: ignore[untyped-decorator]
    def configured(given: Any) -> None:
        workspace.configure(given.settings)

    @made.feature(types.TEXT_DOCUMENT_DID_OPEN)  # type: ignore[untyped-decorator]
    @made.feature(types.TEXT_DOCUMENT_DID_SAVE)  # type: ignore[untyped-decorator]
    def opened(given: Any) -> None:
        publish(given.text_document.uri)

    @made.feature(types.TEXT_DOCUMENT_DID_CHANGE)  # type: ignore[untyped-decorator]
    async def changed(given: Any) -> None:
        uri = given.text_document.uri
        if (earlier := running.pop(uri, None)) is not None:
            earlier.cancel()
        running[uri] = asyncio.ensure_future(publish_later(uri))

    @made.feature(types.TEXT_DOCUMENT_DID_CLOSE)  # type: ignore[untyped-decorator]
    def closed(given: Any) -> None:
        uri = given.text_document.uri
        if (earlier := running.pop(uri, None)) is not None:
            earlier.cancel()
        made.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, []))

    @made.feature(types.TEXT_DOCUMENT_HOVER)  # type: ignore[untyped-decorator]
    def hovered(given: Any) -> Any:
        document, offset = place_of(given)
        found = analysis.hover(document, offset, workspace.sample(document))
        if found is None:
            return None
        content = types.MarkupContent(types.MarkupKind.Markdown, found.markdown)
        return types.Hover(content, range_of(found.region))

    triggers = types.CompletionOptions(trigger_characters=['"', "(", "{", ",", ":", " "])

    @made.feature(types.TEXT_DOCUMENT_COMPLETION, triggers)  # type: ignore[untyped-decorator]
    def completed(given: Any) -> Any:
        document, offset = place_of(given)
        found = completion.proposals(document, offset, workspace.sample(document))
        items = [
            types.CompletionItem(
                label=one.label,
                kind=getattr(types.CompletionItemKind, _KINDS.get(one.sort, "Keyword")),
                detail=one.detail or None,
                sort_text=f"{number:04}",
                text_edit=types.TextEdit(range_of(document.region(one.start, one.end)), one.label),
            )
            for number, one in enumerate(found)
        ]
        return types.CompletionList(is_incomplete=len(items) >= completion.MOST, items=items)

    @made.feature(types.TEXT_DOCUMENT_DEFINITION)  # type: ignore[untyped-decorator]
    def defined(given: Any) -> Any:
        document, offset = place_of(given)
        return locations(analysis.definition(document, offset), document, given.text_document.uri)

    @made.feature(types.TEXT_DOCUMENT_REFERENCES)  # type: ignore[untyped-decorator]
    def referred(given: Any) -> Any:
        document, offset = place_of(given)
        found = analysis.references(document, offset, declarations=given.context.include_declaration)
        return locations(found, document, given.text_document.uri)

    @made.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)  # type: ignore[untyped-decorator]
    def listed(given: Any) -> Any:
        kinds = {Sort.NODE: types.SymbolKind.Object, Sort.EVENT: types.SymbolKind.Event}
        return [
            types.DocumentSymbol(
                name=one.name,
                kind=kinds[one.sort],
                range=range_of(one.region),
                selection_range=range_of(one.selection),
                detail=one.detail or None,
            )
            for one in analysis.symbols(document_of(given.text_document.uri))
        ]

    @made.feature(types.TEXT_DOCUMENT_FORMATTING)  # type: ignore[untyped-decorator]
    def laid_out(given: Any) -> Any:
        document = document_of(given.text_document.uri)
        if len(document.text) > MAX_TEXT:
            return None
        try:
            text = formatted(document.text)
        except NotFormatted:
            return None
        whole = range_of(document.region(0, len(document.text)))
        return [types.TextEdit(whole, text)] if text != document.text else []

    return made
