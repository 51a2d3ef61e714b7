"""`rvaft emit` writes a specification or draws the automaton; `rvaft backends` lists the languages."""

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath
from typing import Any, Final, Protocol, runtime_checkable

import click

from rvaft.backend import Backend, Specification, UnknownBackend, all_backends, backend
from rvaft.capabilities import table
from rvaft.cli import options
from rvaft.errors import OptionError, TooLarge, ToolFailed, ToolMissing
from rvaft.export import PICTURES, Format, format_of
from rvaft.model.nodes import Kind, Node
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.verdict import Semantics
from rvaft.rules.validity import valid_part
from rvaft.support.files import deliver
from rvaft.support.terminal import columns, visible

_FORMATS: Final = "Output format; latex writes a listing with its language definition (package listings)."
_DIALECT: Final = (
    "SQL dialect: sqlite, duckdb or postgres; with --table also athena, bigquery, databricks, redshift, "
    "snowflake, spark or trino.  [default: sqlite]"
)
_TO: Final = "A language that `rvaft backends` lists, or dot for a drawing of the automaton."

_MISSING: Final = "For eql: write absent events as `![…]`, which Elasticsearch has and the package eql lacks."
_CERTIFY: Final = "Compare ltlf, automaton or rml with the tree for every trace, by the verified validator."
_VERIFIED: Final = "For --certify: this build of the verified monitor.  [default: rvaft-verified on the PATH]"


@runtime_checkable
class _WithSignature(Protocol):
    def signature(self, text: str) -> str: ...


@click.command("emit")
@options.tree_argument
@click.option("--to", "language", metavar="LANGUAGE", required=True, help=_TO)
@click.option("--dialect", metavar="DIALECT", help=_DIALECT)
@click.option("--signature", metavar="FILE", help="For MFOTL: also write the predicate signature to FILE.")
@click.option("--certify", is_flag=True, help=_CERTIFY)
@click.option("--verified", metavar="PROGRAM", help=_VERIFIED)
@options.semantics_option
@options.part_options
@options.output_format("text", "latex", text=_FORMATS)
@options.number("--limit", text="Maximum size, in the unit of the language; for a drawing, in states.")
@options.mapping_option
@options.table_options
@click.option("--missing-events", is_flag=True, help=_MISSING)
@options.output_option
def emit_command(
    *,
    tree: str,
    language: str,
    dialect: str | None,
    signature: str | None,
    certify: bool,
    verified: str | None,
    form: str,
    missing_events: bool,
    output: str | None,
    **chosen: Any,
) -> int:
    """Write a specification of a tree in another language, equivalent under the chosen semantics.

    With `--certify`, standard error says whether the text is proved to have the verdicts of the tree, and
    the exit status is 0 if it is, 1 if a trace shows a difference, and 2 if this is not decided.
    """
    options.refuse(verified is not None and not certify, "--verified is for --certify: add it")
    if missing_events:
        options.refuse(language != "eql", f"--missing-events is for eql, not for {language}")
        options.refuse(chosen["mapping"] is not None, "--missing-events and --mapping exclude each other")
        chosen["mapping"] = {"missing_events": True}
    if language == "dot":
        options.refuse(dialect, "--to dot writes a drawing: omit --dialect")
        options.refuse(signature, "--to dot writes a drawing: omit --signature")
        options.refuse(certify, "--to dot writes a drawing: omit --certify")
        _draw(options.read_tree(tree), form, output, **chosen)
        return 0
    if language in PICTURES:
        raise OptionError(
            f"{language} is not a specification language: --to dot -o FILE.{language} draws the automaton"
        )
    mend = f"--to dot -o {output} draws the automaton"
    options.refuse(_is_drawing(output), f"{language} is written as text, but {output} names a drawing: {mend}")
    with options.suggesting():
        try:
            loaded = options.read_tree(tree)
            writer = backend(language)
            if dialect is not None:
                writer = backend(writer.dialect_backend(dialect))
            specification = _specification(loaded, writer, **chosen)
            text = specification.text
        except UnknownBackend as error:
            raise UnknownBackend(error.name, (*error.known, "dot")) from error
    if signature is not None:
        if not isinstance(writer, _WithSignature):
            raise OptionError(f"{writer.name} specifications have no signature: omit --signature")
        deliver(writer.signature(text).encode(), signature)
    status, answer = 0, ""
    if certify:
        from rvaft.export.certificates import certificate, on_path  # noqa: PLC0415 -- imported on use

        semantics = resolve_semantics(loaded, chosen["semantics"])
        program = on_path() if verified is None else Path(verified)
        chosen = {"branch": chosen["branch"], "kind": chosen["kind"]}
        status, answer = certificate(loaded, writer, specification, semantics, program, **chosen)
    if form == "latex":
        from rvaft.export.latex import listing  # noqa: PLC0415 -- imported on use

        text = listing(text, writer.highlighting)
    deliver((text if text.endswith("\n") else f"{text}\n").encode(), output)
    if certify:
        click.echo(answer, err=True)
    return status


def _specification(
    tree: RVAFT,
    writer: Backend,
    *,
    semantics: Semantics | None,
    branch: int | None,
    kind: Kind | None,
    limit: int | None,
    mapping: Mapping[str, Any] | None,
) -> Specification:
    if mapping is not None:
        writer = writer.mapped(mapping)
    return writer.translate(valid_part(tree, branch, kind), resolve_semantics(tree, semantics), limit=limit)


def _is_drawing(output: str | None) -> bool:
    return output is not None and format_of(output) in (*PICTURES, Format.DOT)


def _draw(
    tree: RVAFT,
    form: str,
    output: str | None,
    *,
    semantics: Semantics | None,
    branch: int | None,
    kind: Kind | None,
    limit: int | None,
    mapping: Mapping[str, Any] | None,
) -> None:
    """Write a drawing of the automaton."""
    options.refuse(form != "text", f"--to dot writes a drawing: omit --format {form}")
    options.refuse(mapping is not None, "--to dot writes a drawing: omit --mapping")
    part, suffix = valid_part(tree, branch, kind), PurePath(output or "").suffix
    known = "known: .dot, .gv, .svg, .pdf, .png"
    options.refuse(suffix and not _is_drawing(output), f"no drawing of an automaton has the suffix {suffix}; {known}")
    try:
        text = backend("automaton").diagram(part, resolve_semantics(tree, semantics), limit=limit)
    except TooLarge as error:
        error.add_note("raise it with --limit N, or draw one branch with --branch N")
        raise
    if output is not None and (drawing := format_of(output)) in PICTURES:
        from rvaft.export.dot import picture  # noqa: PLC0415 -- imported on use

        deliver(picture(text, str(drawing)), output)
    else:
        deliver(text.encode(), output)


@click.command("backends")
@click.option("--capabilities", is_flag=True, help="Print a table of what each language can express.")
def backends_command(*, capabilities: bool) -> int:
    """List the specification languages, the semantics they support, and missing tools."""
    if capabilities:
        found = {name: one for name in all_backends() if (one := _loaded(name)) is not None and one.form_of is None}
        click.echo("\n".join(columns(table({name: one.capabilities() for name, one in found.items()}))))
        return 0
    click.echo("\n".join(columns([("NAME", "LANGUAGE", "FAITHFUL", "SEMANTICS", "AVAILABLE"), *_languages()])))
    return 0


def _loaded(name: str) -> Backend | None:
    try:
        return backend(name)
    except ToolFailed:
        return None


def _languages() -> Iterator[tuple[str, ...]]:
    for name, entry in all_backends().items():
        try:
            found: Backend = entry.load()()
        except Exception as error:  # noqa: BLE001 (a third party's module may fail in any way; the others still count)
            yield name, "?", "?", "?", visible(f"no: {type(error).__name__}: {error}")
            continue
        semantics = [choice for choice in Semantics if choice in found.semantics]
        available = "yes" if found.readable else "yes, emit only"
        try:
            specification = found.translate(RVAFT("a", [Node("a")]), semantics[-1])
            if found.readable:
                specification.monitor()
        except ToolMissing as missing:
            available = visible(f"no: {missing}")
        faithful = "yes" if found.faithful else "no"
        yield name, f"{found.language} ({found.suffix})", faithful, ",".join(semantics), available
