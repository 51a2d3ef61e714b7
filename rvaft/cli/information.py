"""`rvaft branches`, `rvaft backends` and `rvaft explain`: what there is in a tree, in this installation, and among the rules."""

import sys
import time
from collections.abc import Iterable, Iterator
from importlib.metadata import EntryPoint
from itertools import islice

import click

from rvaft.analysis.branches import Branch, branches
from rvaft.backend import Backend, all_backends
from rvaft.cli.options import tree_argument
from rvaft.cli.show import load_tree
from rvaft.errors import ToolMissing
from rvaft.export.property_text import WIDTH, align_latex, kinds_of, property_sign, property_text, property_unicode
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.rules import RULES, explain, meanings
from rvaft.support.terminal import columns, visible


@click.command("branches")
@tree_argument
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "unicode", "latex"]),
    default="text",
    show_default=True,
    help="unicode and latex write properties with the signs of papers; latex as one align*.",
)
@click.option("--whole", is_flag=True, help="The property of the whole tree instead of its branches.")
@click.option(
    "--width",
    type=click.IntRange(min=1),
    metavar="N",
    help=f"With latex: break formulas that are wider than N characters.  [default: {WIDTH}]",
)
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Only the first N branches.")
def branches_command(*, tree: str, form: str, whole: bool, width: int | None, limit: int | None) -> int:
    """List the branches of a tree, one line each: number, kinds (- for none), property. The TREE - is standard input."""
    if width is not None and form != "latex":
        raise click.UsageError(f"--width: not for the format {form}; with it, each property is one line")
    loaded = load_tree(tree)
    parts: Iterable[RVAFT | Branch] = [loaded] if whole else _counted(branches(loaded), limit)
    for row in align_latex(parts, width=width or WIDTH) if form == "latex" else _rows(parts, form):
        sys.stdout.write(f"{row}\n")
    return 0


def _counted(found: Iterator[Branch], limit: int | None) -> Iterator[Branch]:
    """The branches up to a limit; every few seconds standard error is told how many there were, where nobody sees them pass."""
    shown = time.monotonic()
    for branch in islice(found, limit):
        yield branch
        if branch.number % 100 == 0 and not sys.stdout.isatty() and time.monotonic() > shown + 5:
            shown = time.monotonic()
            click.echo(f"rvaft: {branch.number:,} branches so far; --limit N ends after N", err=True)
    if limit is not None and next(found, None) is not None:
        click.echo(f"rvaft: warning: the tree has more than {limit} branches", err=True)


def _rows(parts: Iterable[RVAFT | Branch], form: str) -> Iterator[str]:
    """Number or sign, kinds, and property, with tabs between."""
    for part in parts:
        kinds = ",".join(sorted(kind.value for kind in kinds_of(part))) or "-"
        if form == "unicode":
            yield f"{property_sign(part)}\t{kinds}\t{property_unicode(part)}"
        else:
            number = part.number if isinstance(part, Branch) else "-"
            yield f"{number}\t{kinds}\t{visible(property_text(part))}"


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
    semantics = [choice for choice in Semantics if choice in backend.semantics]
    try:  # a smallest tree
        specification = backend.translate(RVAFT("a", [Node("a")]), semantics[-1])
        if backend.readable:
            specification.monitor()
        available = "yes"
    except ToolMissing as missing:
        available = visible(f"no: {missing}")
    language = f"{backend.language} ({backend.suffix})"
    return name, language, "yes" if backend.faithful else "no", ",".join(semantics), available


@click.command("explain")
@click.argument("code", metavar="[CODE]", required=False)
def explain_command(*, code: str | None) -> int:
    """Explain a CODE in square brackets: what it means, a tree that has it and the same tree mended; without one, list all."""
    if code is None:
        severity = {code: rule.severity.value for code, rule in RULES.items()}
        rows = [(code, severity.get(code, "error"), said.title) for code, said in meanings().items()]
        click.echo("\n".join(columns([("CODE", "SEVERITY", "MEANS"), *sorted(rows)])))
    else:
        click.echo(explain(code).rstrip("\n"))
    return 0
