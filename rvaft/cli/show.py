"""`rvaft show` draws or converts a tree; `rvaft branches` lists its branches."""

import re
import sys
import time
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path, PurePath
from typing import Any, Final

import click

from rvaft.api import monitor
from rvaft.cli import options, warn
from rvaft.cli.horizon import Horizon, time_option
from rvaft.core.branches import Branch, branches
from rvaft.core.fields_to_read import TreeReads
from rvaft.errors import OptionError
from rvaft.export import SUFFIXES, Format, format_of
from rvaft.export.drawing import LOSSES, draw
from rvaft.export.layout import NARROWEST, WIDTH, Look, Marks, branch_marks, marks
from rvaft.export.property_text import WIDTH as LATEX_WIDTH
from rvaft.export.property_text import align_latex, kinds_of, property_sign, property_text, property_unicode
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.readers.registry import read_log
from rvaft.stream.detection import matched_events
from rvaft.support.files import deliver
from rvaft.support.terminal import visible
from rvaft.support.wording import counted

_FORMAT: Final = "Output format; by default that of FILE's suffix, else tree. pdf and png need cairosvg."
_RISK: Final = "Write the probability of each node by this time in its box, as in '1000 h'."
_EVENTS: Final = "Show runtime events and guards below labels; by default only in the terminal."


@click.command("show")
@options.tree_argument
@options.choice("--format", "form", words=Format, text=_FORMAT)
@options.flag("--events/--no-events", help=_EVENTS)
@options.flag("--names/--no-names", help="Show the names of labelled nodes; the default.")
@options.number("--wrap", least=NARROWEST, text=f"Width of the text in a box, in columns; default: {WIDTH}.")
@options.number("--depth", least=0, text="Draw only N levels below the root.")
@click.option("--collapse", multiple=True, metavar="NODE", help="Hide the nodes below this node; repeatable.")
@click.option(
    "--highlight", multiple=True, metavar="branch:N|TRACE", help="Mark a branch, or the detection in a trace."
)
@options.number("--cut-set", text="Mark this minimal cut set, as `rvaft cut-sets` numbers them.")
@time_option("--risk", "risk", _RISK)
@options.semantics_option
@options.flag("--legend", help="Add a legend of the symbols.")
@options.flag("--stagger", help="Place some leaves a level lower, for a narrower tree.")
@options.flag("--boxes", help="Draw gates as text in boxes instead of the symbols of fault trees.")
@options.output_option
def show_command(*, tree: str, form: Format | None, output: str | None, highlight: tuple[str, ...], **look: Any) -> int:
    """Draw a tree, or write it in another format. Use - as TREE for standard input."""
    chosen, semantics = form or _suggested(output), look.pop("semantics")
    given = {name: value for name, value in {**look, "highlight": highlight}.items() if value not in (None, ())}
    everywhere = ("events", "depth", "collapse", "highlight", "cut_set", "risk")
    in_boxes = ("names", "wrap", "legend", "stagger", "boxes")
    for useless, refused, why in (
        (not chosen.drawing, everywhere + in_boxes, "which writes the whole tree"),
        (chosen is Format.TREE, in_boxes, "which has no boxes"),
        (chosen is Format.DOT, ("boxes",), "which has no symbols"),
    ):
        found = [name for name in refused if name in given]
        names = [f"--{'no-' if given[name] is False else ''}{name.replace('_', '-')}" for name in found]
        options.refuse(useless and names, f"{' and '.join(names)}: not for the format {chosen}, {why}")
    options.refuse(len(highlight) > 1, "--highlight marks one branch or one trace: give it once")
    options.refuse(highlight and "cut_set" in given, "--cut-set and --highlight exclude each other")
    on_screen = output in (None, "-") and sys.stdout.isatty()
    options.refuse(
        chosen in (Format.PDF, Format.PNG) and on_screen,
        "this format is binary: name a file with -o, or redirect standard output",
    )
    loaded = options.read_tree(tree)
    given["marks"] = _highlighted(loaded, given.pop("highlight")[0], semantics) if highlight else None
    number, horizon = given.pop("cut_set", None), given.pop("risk", None)
    if number is not None or horizon is not None:
        given |= _risk_look(tree, loaded, number, horizon)
    given["symbols"] = not given.pop("boxes", False)
    deliver(draw(loaded, chosen, Look(**{"events": chosen is Format.TREE, **given})), output)
    if chosen in LOSSES:
        for loss in LOSSES[chosen](loaded):
            warn(f"{chosen}: {loss}")
    return 0


def _risk_look(file: str, tree: RVAFT, number: int | None, horizon: Horizon | None) -> dict[str, Any]:
    """Return the marks of a cut set, and the probabilities of nodes."""
    from rvaft.cli import risk_drawing  # noqa: PLC0415 -- imported on use

    form = risk_drawing.form_of(file, tree)
    marked = {} if number is None else {"marks": risk_drawing.cut_set_marks(tree, form, number)}
    return marked | ({} if horizon is None else {"values": risk_drawing.probabilities(tree, form, horizon)})


def _suggested(output: str | None) -> Format:
    suffix = PurePath(output or "").suffix
    if output is None or not suffix:
        return Format.TREE
    found = format_of(output)
    if found is None:
        message = f"no format has the suffix {suffix}; known: {', '.join(SUFFIXES)}; or name one with --format"
        raise click.UsageError(message, click.get_current_context())
    return found


def _highlighted(tree: RVAFT, what: str, semantics: Semantics | None) -> Marks:
    is_number = re.compile(r"[0-9]{1,9}").fullmatch
    if what.startswith("branch:"):
        branch = what.removeprefix("branch:")
        if not is_number(branch):
            raise OptionError(f"--highlight branch:N takes the number of a branch, not {branch!r}")
        return branch_marks(tree, int(branch))
    if is_number(what) and not Path(what).exists():
        raise OptionError(f"{what}: no such trace; a branch is marked by --highlight branch:{what}")
    watching = monitor(tree, semantics=semantics)
    events = {}
    for place, event in enumerate(read_log(what, reads=TreeReads(tree), warn=warn), 1):
        events[place] = event
        if watching.step(event).final:
            break
    explanation = watching.explanation
    if explanation is None:
        message = f"the verdict is {watching.verdict} after {counted(len(events))}"
        raise OptionError(f"{what}: nothing is detected ({message})")
    return marks(tree, explanation, {place: events[place] for place in matched_events([explanation])})


_SIGNS = "Output format; unicode and latex use mathematical notation, latex in one align* environment."


@click.command("branches")
@options.tree_argument
@options.output_format("text", "unicode", "latex", text=_SIGNS)
@click.option("--whole", is_flag=True, help="Print the property of the whole tree instead of its branches.")
@options.number(
    "--width", text=f"With --format latex: break formulas longer than N characters.  [default: {LATEX_WIDTH}]"
)
@options.number("--limit", text="List only the first N branches.")
def branches_command(*, tree: str, form: str, whole: bool, width: int | None, limit: int | None) -> int:
    """List the branches of a tree, one line each: number, kinds (- for none), property.

    Use - as TREE for standard input.
    """
    wrong = width is not None and form != "latex"
    options.refuse(wrong, f"--width: not for the format {form}; with it, each property is one line")
    loaded = options.read_tree(tree)
    parts: Iterable[RVAFT | Branch] = [loaded] if whole else _counted(branches(loaded), limit)
    for row in align_latex(parts, width=width or LATEX_WIDTH) if form == "latex" else _rows(parts, form):
        sys.stdout.write(f"{row}\n")
    return 0


def _counted(found: Iterator[Branch], limit: int | None) -> Iterator[Branch]:
    """Yield up to `limit` branches; report progress if output is piped."""
    shown = time.monotonic()
    for branch in islice(found, limit):
        yield branch
        if branch.number % 100 == 0 and not sys.stdout.isatty() and time.monotonic() > shown + 5:
            shown = time.monotonic()
            click.echo(f"rvaft: {branch.number:,} branches so far; --limit N ends after N", err=True)
    if limit is not None and next(found, None) is not None:
        warn(f"the tree has more than {limit} branches")


def _rows(parts: Iterable[RVAFT | Branch], form: str) -> Iterator[str]:
    for part in parts:
        kinds = ",".join(sorted(kind.value for kind in kinds_of(part))) or "-"
        if form == "unicode":
            yield f"{property_sign(part)}\t{kinds}\t{property_unicode(part)}"
        else:
            yield f"{part.number if isinstance(part, Branch) else '-'}\t{kinds}\t{visible(property_text(part))}"
