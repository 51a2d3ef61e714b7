"""`rvaft backends`: the specification languages."""

from importlib.metadata import EntryPoint

import click

from rvaft.backend import Backend, all_backends
from rvaft.errors import ToolMissing
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.rules import explain
from rvaft.support.terminal import columns, visible


@click.command("backends")
def backends_command() -> int:
    """List the specification languages, what each can do, and what is missing for it."""
    rows = [("NAME", "LANGUAGE", "FAITHFUL", "SEMANTICS", "AVAILABLE")]
    rows += [_row(name, entry) for name, entry in all_backends().items()]
    click.echo("\n".join(columns(rows)))
    return 0


def _row(name: str, entry: EntryPoint) -> tuple[str, str, str, str, str]:
    try:
        backend: Backend = entry.load()()
    except Exception as error:  # noqa: BLE001 (a third party's module may fail in any way; the others still count)
        return name, "?", "?", "?", visible(f"no: {type(error).__name__}: {error}")
    semantics = ",".join(choice.value for choice in Semantics if choice in backend.semantics)
    language = f"{backend.language} ({backend.suffix})"
    return name, language, "yes" if backend.faithful else "no", semantics, _available(backend)


def _available(backend: Backend) -> str:
    """Whether the backend can translate a smallest tree and run the result here, or what to install."""
    semantics = next(choice for choice in reversed(Semantics) if choice in backend.semantics)
    try:
        backend.translate(RVAFT("a", [Node("a")]), semantics).monitor()
    except ToolMissing as missing:
        return visible(f"no: {missing}")
    return "yes"


# `rvaft explain`: what the code of a finding or an error means.


@click.command("explain")
@click.argument("code", metavar="CODE")
def explain_command(*, code: str) -> int:
    """Explain a CODE in square brackets: what it means, a tree that has it and the same tree mended."""
    click.echo(explain(code).rstrip("\n"))
    return 0
