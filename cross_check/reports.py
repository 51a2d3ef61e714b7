"""Results for people, spreadsheets and continuous integration."""

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from itertools import groupby
from typing import Final, Self
from xml.etree import ElementTree as ET

from cross_check.results import Result, Status
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import columns

_RAN: Final = (Status.BASELINE, Status.PROVED, Status.TESTED, Status.DIFFERS)
_SKIPPED: Final = (Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT)


@dataclass(frozen=True, slots=True)
class Totals:
    """Counts over all results; `statuses` by participant and semantics."""

    trees: int
    comparisons: int
    verdicts: int
    proofs: int
    statuses: dict[tuple[str, Semantics], Counter[Status]]
    differing: tuple[Result, ...]
    unable: tuple[Result, ...]
    """Those that are neither proved nor tested, and do not differ."""
    masked: int
    """Traces on which a program of others differs as it is known to."""

    @classmethod
    def of(cls, results: Iterable[Result]) -> Self:
        """The totals of results."""
        every = list(results)
        statuses: dict[tuple[str, Semantics], Counter[Status]] = {}
        for result in every:
            statuses.setdefault((result.participant, result.job.semantics), Counter())[result.status] += 1
        return cls(
            trees=len({result.job.title for result in every}),
            comparisons=len({result.job for result in every}),
            verdicts=sum(result.verdicts for result in every),
            proofs=sum(result.status is Status.PROVED for result in every),
            statuses=statuses,
            differing=tuple(result for result in every if result.status is Status.DIFFERS),
            masked=sum(result.masked for result in every),
            unable=tuple(result for result in every if result.status not in _RAN),
        )

    @property
    def table(self) -> list[list[str]]:
        """How often what: a line for each participant, a column for each semantics, in the order they came."""
        semantics = list(dict.fromkeys(one for _, one in self.statuses))
        lines = [["participant", *semantics]]
        for participant in dict.fromkeys(participant for participant, _ in self.statuses):
            counts = [self.statuses.get((participant, one), Counter()) for one in semantics]
            cells = (", ".join(f"{status} {one[status]}" for status in Status if one[status]) for one in counts)
            lines.append([participant, *cells])
        return lines

    @property
    def headline(self) -> str:
        """All in one line."""
        counted = {"tree": self.trees, "comparison": self.comparisons, "verdict": self.verdicts, "proof": self.proofs}
        if not self.verdicts:
            return f"{', '.join(_many(number, what) for what, number in counted.items())}; nothing was compared"
        if self.masked:
            counted["masked trace"] = self.masked
        differ = len(self.differing)
        said = ", ".join(_many(number, what) for what, number in counted.items())
        return f"{said}; {_many(differ, 'disagreement') if differ else 'no disagreement'}"


def _many(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def result_lines(results: Iterable[Result]) -> list[str]:
    """For a terminal: one line per participant and comparison."""
    rows = [["TREE", "SEMANTICS", "PARTICIPANT", "SECONDS", "SYMBOLS", "STATES", "RESULT"]]
    for result in results:
        named = [result.job.title, result.job.semantics, result.participant, f"{result.seconds:.3f}"]
        rows.append([*named, *_sizes(result), result.text])
    return columns(rows)


def _sizes(result: Result) -> list[str]:
    return ["" if size is None else str(size) for size in (result.symbols, result.states)]


def summary_lines(totals: Totals) -> list[str]:
    """For a terminal: one line per participant, with how often what under each semantics."""
    head, *lines = totals.table
    return columns([[cell.upper() for cell in head], *lines])


def difference_lines(result: Result) -> list[str]:
    """The trace on which a participant differs, with both verdicts after every event."""
    found = result.difference
    if found is None:
        return []
    rows = [("EVENT", found.baseline, result.participant)]
    for event, expected, got in zip(found.trace, found.expected, found.got, strict=True):
        rows.append((json.dumps(event, ensure_ascii=False), expected.symbol, got.symbol))
    return columns(rows) if found.trace else ["they differ before any event"]


COLUMNS: Final = [
    "tree",
    "semantics",
    "participant",
    "exit_status",
    "seconds",
    "symbols",
    "states",
    "verdicts",
    "result",
]
"""The columns of the CSV report, as those of Spot's `ltlcross` where they mean the same."""


def csv_text(results: Iterable[Result], note: str = "") -> str:  # noqa: ARG001 (a table has no room for it)
    """One row per participant and comparison."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for result in results:
        row = [result.job.title, result.job.semantics, result.participant, exit_status(result), f"{result.seconds:.6f}"]
        writer.writerow([*row, *_sizes(result), result.verdicts, result.text])
    return stream.getvalue()


def json_text(results: Iterable[Result], note: str = "") -> str:
    """The totals and every result, with the traces that show differences; `note` is what else there is to say."""
    every = list(results)
    totals = Totals.of(every)
    counts = {name: getattr(totals, name) for name in ("trees", "comparisons", "verdicts", "proofs")}
    counts["disagreements"] = len(totals.differing)
    found = {"version": version("rvaft"), "note": note, "totals": counts, "results": [_object(one) for one in every]}
    return json.dumps(found, indent=1) + "\n"


def exit_status(result: Result) -> str:
    """How it ended, whatever the verdicts were: `ok` for everybody who gave verdicts to the end."""
    return "ok" if result.status in _RAN else str(result.status)


def _object(result: Result) -> dict[str, Json]:
    found = result.difference
    names = ["symbols", "states", "verdicts", "traces", "longest", "masked", "masks"]
    return {
        "tree": result.job.name,
        "branch": result.job.branch,
        "kind": result.job.kind,
        "semantics": result.job.semantics,
        "participant": result.participant,
        "status": result.status,
        "exit_status": exit_status(result),
        "seconds": round(result.seconds, 6),
        **{name: getattr(result, name) for name in names},
        "result": result.text,
        "difference": found and {name: getattr(found, name) for name in ("trace", "baseline", "expected", "got")},
    }


def junit_text(results: Iterable[Result], note: str = "") -> str:
    """For continuous integration, as tests: one suite per tree and semantics, one test case per participant.

    A disagreement is a failure, what could not run an error, and what a language cannot say or is too large is skipped.
    """
    root = ET.Element("testsuites", name=f"rvaft cross-check{f': {note}' if note else ''}")
    for job, group in groupby(results, key=lambda result: result.job):
        cases = list(group)
        kinds = [_kind(case) for case in cases]
        suite = ET.SubElement(root, "testsuite", name=_text(f"{job.title} ({job.semantics})"))
        counts = {"failures": kinds.count("failure"), "errors": kinds.count("error"), "skipped": kinds.count("skipped")}
        for name, number in {"tests": len(cases), **counts}.items():
            suite.set(name, str(number))
        suite.set("time", f"{sum(case.seconds for case in cases):.3f}")
        for case, kind in zip(cases, kinds, strict=True):
            classname = _text(f"{job.title}.{job.semantics}")
            made = ET.SubElement(suite, "testcase", name=_text(case.participant), classname=classname)
            made.set("time", f"{case.seconds:.3f}")
            if kind:
                said = ET.SubElement(made, kind, message=_text(case.text))
                said.text = _text("\n".join(difference_lines(case))) or None
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _kind(result: Result) -> str:
    if result.status in _RAN:
        return "failure" if result.status is Status.DIFFERS else ""
    return "skipped" if result.status in _SKIPPED else "error"


def _text(text: str) -> str:
    """The text without the control characters that XML cannot hold."""
    return "".join(c if c in "\t\n" or (c.isprintable() or ord(c) > 0x9F) else "\ufffd" for c in text)


def markdown_text(results: Iterable[Result], note: str = "") -> str:
    """The totals as a table, then each disagreement with its trace, then what could not be compared."""
    totals = Totals.of(results)
    lines = ["## rvaft cross-check", "", f"{'; '.join(filter(None, [totals.headline, note]))}.", ""]
    if not totals.statuses:
        return "\n".join(lines)
    head, *rows = totals.table
    lines += [f"| {' | '.join(map(_cell, row))} |" for row in (head, ["---"] * len(head), *rows)]
    for result in totals.differing:
        lines += ["", f"### {_cell(_named(result))}", "", *(f"    {line}" for line in difference_lines(result))]
    if totals.unable:
        lines += ["", "### Not compared", ""]
        lines += [f"- {_cell(f'{_named(result)}: {result.text}')}" for result in totals.unable]
    return "\n".join(lines) + "\n"


def _named(result: Result) -> str:
    return f"{result.participant}: {result.job.title} ({result.job.semantics})"


def _cell(text: str) -> str:
    """The text in one line and without meaning in Markdown or HTML."""
    plain = " ".join(text.split())
    for sign in "\\|`*_<>[]":
        plain = plain.replace(sign, f"\\{sign}")
    return plain
