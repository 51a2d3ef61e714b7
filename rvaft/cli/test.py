"""`rvaft test`: compares the verdicts of a tree on its traces with the expected ones.

Verdicts that are missing in the file of expectations are not checked.
"""

from collections import deque
from collections.abc import Iterator
from functools import partial
from itertools import islice, zip_longest
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias
from xml.etree import ElementTree as ET

import click
import msgspec

from rvaft.api import monitor
from rvaft.cli import FAILED, FOUND, Failures, options, warn
from rvaft.core.branches import branches
from rvaft.core.fields_to_read import TreeReads
from rvaft.errors import OptionError, TreeError
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.readers.log import suffix
from rvaft.readers.registry import read_log, suffixes
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.statistics import EventTypeIndex
from rvaft.support.files import write_whole
from rvaft.support.terminal import inert, readable_json, visible

TREE: Final = "tree"
"""The key for the whole tree."""
MOST_BRANCHES: Final = 1_000
"""Maximum number of branches in a new file."""

ExpectedVerdicts: TypeAlias = dict[str, dict[Semantics, dict[str, str]]]
"""Trace name -> semantics -> "tree" or a branch number -> ⊤, ⊥ or ? after each event."""


class Expectation(NamedTuple):
    """The expected and actual verdicts of one trace, None if missing."""

    tree: str
    trace: str
    semantics: str
    part: str
    expected: str | None
    actual: str | None

    @property
    def complaint(self) -> str:
        """The difference as a message, or ""."""
        if self.expected == self.actual:
            return ""
        if self.expected is None:
            return f"{self.trace}: the trace has no expected verdicts; --update writes them"
        if self.actual is None:
            return f"{self.trace}: the expected verdicts name this trace, but it does not exist"
        pairs = enumerate(zip_longest(self.expected, self.actual), 1)
        first = next(place for place, (expected, actual) in pairs if expected != actual)
        part = TREE if self.part == TREE else f"branch {self.part}"
        return f"{self.trace}: {self.semantics}, {part}: expected {self.expected}, got {self.actual} (event {first})"


@click.command("test")
@click.argument("trees", nargs=-1, required=True, metavar="TREE...")
@click.option("--update", is_flag=True, help="Write the verdicts of the engine to NAME.verdicts.json.")
@options.reading_options
@options.output_format("text", "junit")
def test_command(*, trees: tuple[str, ...], update: bool, form: str) -> int:
    """Compare the verdicts of each TREE on its traces with the expected verdicts.

    The traces are the files NAME.traces/*.jsonl (or another log format) beside the tree, the
    expected verdicts are in NAME.verdicts.json. The exit status is 1 if a verdict differs. --update
    writes the verdicts of the engine: review the difference before you commit it.
    """
    failures, rows = Failures(), list[Expectation]()
    for tree in trees:
        with failures.reported():
            if update:
                _update(tree)
            else:
                rows += _compared(tree)
    wrong = [row.complaint for row in rows if row.complaint]
    if form == "junit":
        click.echo(_junit(rows))
    elif not update:
        click.echo("".join(f"{inert(visible(complaint))}\n" for complaint in wrong), nl=False)
        outcome = (
            "nothing was compared" if not rows else f"{len(wrong):,} not as expected" if wrong else "all as expected"
        )
        traces = len({(row.tree, row.trace) for row in rows})
        counts = {"tree": len({row.tree for row in rows}), "trace": traces, "row": len(rows)}
        counted_verdicts = ", ".join(f"{count:,} {noun}{'s' * (count != 1)}" for noun, count in counts.items())
        click.echo(f"{counted_verdicts} of verdicts; {outcome}")
    return FAILED if failures.met else FOUND if wrong else 0


def _compared(name: str) -> Iterator[Expectation]:
    path, tree, traces = _opened(name)
    try:
        expected = msgspec.json.decode(options.read_named(path, Path(name).parent), type=ExpectedVerdicts)
    except FileNotFoundError as error:
        raise OSError(
            error.errno, "the file of expected verdicts does not exist; --update writes it", str(path)
        ) from None
    except msgspec.MsgspecError as error:
        raise OptionError(f"{path}: not a file of expected verdicts: {error}") from error
    for trace in sorted(expected.keys() | traces.keys()):
        written = trace if suffix(Path(trace)) in suffixes() else f"{trace}.jsonl"
        file = str(path.with_name(f"{Path(name).stem}.traces") / written)
        if trace not in traces or trace not in expected:
            yield Expectation(name, file, "", "", "" if trace in expected else None, "" if trace in traces else None)
            continue
        for semantics, parts in expected[trace].items():
            for part, signs in parts.items():
                yield Expectation(name, file, semantics, part, signs, _signs(tree, semantics, part, traces[trace]))


def _update(name: str) -> None:
    path, tree, traces = _opened(name)
    parts = [TREE, *(str(branch.number) for branch in islice(branches(tree), MOST_BRANCHES))]
    found = {
        trace: {semantics: {part: _signs(tree, semantics, part, events) for part in parts} for semantics in Semantics}
        for trace, events in traces.items()
    }
    text = readable_json(found, indent=1) + "\n"
    same = path.exists() and path.read_text(encoding="utf-8") == text
    if not same:
        write_whole(path, text.encode(), follow=False)
    what = "unchanged" if same else "written from the engine"
    click.echo(inert(visible(f"{path}: {what}, {len(traces)} traces")), err=True)


def _opened(name: str) -> tuple[Path, RVAFT, dict[str, list[Json]]]:
    folder = Path(name).with_suffix(".traces")
    tree = options.load_tree(name)
    files = sorted(file for file in folder.glob("*") if suffix(file) in suffixes())
    if not files:
        raise OptionError(f"{name}: no traces: put them into {folder}/ as NAME.jsonl")
    names = {file: file.stem if file.suffix == ".jsonl" else file.name for file in files}
    within = Path(name).parent if options.is_confined() else None
    read = partial(read_log, reads=TreeReads(tree), warn=warn, within=within)
    traces = {names[file]: list(read(file)) for file in files}
    data_warnings = DataWarnings(EventTypeIndex(tree))
    for trace, events in traces.items():
        deque(data_warnings.over(enumerate(events, 1), f"{trace}: "), maxlen=0)
    for line in data_warnings.lines:
        warn(f"{name}: {line}")
    return Path(name).with_suffix(".verdicts.json"), tree, traces


def _signs(tree: RVAFT, semantics: Semantics, part: str, events: list[Json]) -> str:
    """Return the engine's verdicts after each event."""
    try:
        engine = monitor(tree, semantics=semantics, branch=None if part == TREE else int(part))
    except ValueError as error:
        if isinstance(error, TreeError) and error.rule == "no-scenario":
            return Verdict.FALSE.symbol * len(events)
        if isinstance(error, TreeError):
            raise
        raise OptionError(f"{part!r} is neither {TREE!r} nor the number of a branch") from None
    return "".join(verdict.symbol for verdict in engine.run(events))


def _junit(rows: list[Expectation]) -> str:
    root = ET.Element("testsuites")
    for tree in dict.fromkeys(row.tree for row in rows):
        own = [row for row in rows if row.tree == tree]
        failures = str(sum(bool(row.complaint) for row in own))
        suite = ET.SubElement(root, "testsuite", name=visible(tree), tests=str(len(own)), failures=failures)
        for row in own:
            name = " ".join(filter(None, (Path(row.trace).stem, row.semantics, row.part)))
            case = ET.SubElement(suite, "testcase", classname=visible(tree), name=visible(name))
            if row.complaint:
                ET.SubElement(case, "failure", message=visible(row.complaint))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")
