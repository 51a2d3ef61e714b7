"""Results for people, spreadsheets and continuous integration."""

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import groupby
from typing import Final, Self
from xml.etree import ElementTree as ET

from cross_check.results import Difference, Result, Status
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import columns

# What many results come to.


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
    def participants(self) -> Sequence[str]:
        """The participants in the order they came."""
        return tuple(dict.fromkeys(participant for participant, _ in self.statuses))

    @property
    def semantics(self) -> Sequence[Semantics]:
        """The semantics in the order they came."""
        return tuple(dict.fromkeys(semantics for _, semantics in self.statuses))

    def counted(self, participant: str, semantics: Semantics) -> str:
        """How often what, in one cell of a table."""
        counts = self.statuses.get((participant, semantics), Counter())
        return ", ".join(f"{status} {counts[status]}" for status in Status if counts[status])

    @property
    def headline(self) -> str:
        """All in one line."""
        said = [
            _many(self.trees, "tree"),
            _many(self.comparisons, "comparison"),
            _many(self.verdicts, "verdict"),
            _many(self.proofs, "proof"),
        ]
        if not self.participants or not self.verdicts:
            return f"{', '.join(said)}; nothing was compared"
        differ = len(self.differing)
        if self.masked:
            said.append(_many(self.masked, "masked trace"))
        return f"{', '.join(said)}; {_many(differ, 'disagreement') if differ else 'no disagreement'}"


_RAN = frozenset({Status.BASELINE, Status.PROVED, Status.TESTED, Status.DIFFERS})


def _many(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"


# Results for a terminal, as lines of plain text.


def result_lines(results: Iterable[Result]) -> list[str]:
    """One line per participant and comparison."""
    rows: list[tuple[str, ...]] = [("TREE", "SEMANTICS", "PARTICIPANT", "SECONDS", "SYMBOLS", "STATES", "RESULT")]
    for result in results:
        sizes = tuple("" if size is None else str(size) for size in (result.symbols, result.states))
        named = (result.job.title, str(result.job.semantics), result.participant, f"{result.seconds:.3f}")
        rows.append((*named, *sizes, result.text))
    return columns(rows)


def summary_lines(totals: Totals) -> list[str]:
    """One line per participant, with how often what under each semantics."""
    head = ("PARTICIPANT", *(semantics.upper() for semantics in totals.semantics))
    counts = (
        (name, *(totals.counted(name, semantics) for semantics in totals.semantics)) for name in totals.participants
    )
    return columns([head, *counts])


def difference_lines(result: Result) -> list[str]:
    """The trace on which a participant differs, with both verdicts after every event."""
    found = result.difference
    if found is None:
        return []
    rows = [("EVENT", found.baseline, result.participant)]
    for event, expected, got in zip(found.trace, found.expected, found.got, strict=True):
        rows.append((json.dumps(event, ensure_ascii=False), expected.symbol, got.symbol))
    lines = columns(rows)
    return lines if found.trace else ["they differ before any event"]


# Results as CSV and JSON.

COLUMNS: Final = (
    "tree",
    "semantics",
    "participant",
    "exit_status",
    "seconds",
    "symbols",
    "states",
    "verdicts",
    "result",
)
"""The columns of the CSV report, as those of Spot's `ltlcross` where they mean the same."""


def csv_text(results: Iterable[Result], note: str = "") -> str:  # noqa: ARG001 (a table has no room for it)
    """One row per participant and comparison."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for result in results:
        sizes = ("" if size is None else size for size in (result.symbols, result.states))
        row = (result.job.title, result.job.semantics, result.participant, exit_status(result), f"{result.seconds:.6f}")
        writer.writerow([*row, *sizes, result.verdicts, result.text])
    return stream.getvalue()


def json_text(results: Iterable[Result], note: str = "") -> str:
    """The totals and every result, with the traces that show differences; `note` is what else there is to say."""
    every = list(results)
    totals = Totals.of(every)
    counts = {
        "trees": totals.trees,
        "comparisons": totals.comparisons,
        "verdicts": totals.verdicts,
        "proofs": totals.proofs,
        "disagreements": len(totals.differing),
    }
    found = {"version": version("rvaft"), "note": note, "totals": counts, "results": [_object(one) for one in every]}
    return json.dumps(found, indent=1) + "\n"


def exit_status(result: Result) -> str:
    """How it ended, whatever the verdicts were: `ok` for everybody who gave verdicts to the end."""
    return str(result.status) if result in Totals.of([result]).unable else "ok"


def _object(result: Result) -> dict[str, Json]:
    return {
        "tree": result.job.name,
        "branch": result.job.branch,
        "kind": result.job.kind,
        "semantics": result.job.semantics,
        "participant": result.participant,
        "status": result.status,
        "exit_status": exit_status(result),
        "seconds": round(result.seconds, 6),
        "symbols": result.symbols,
        "states": result.states,
        "verdicts": result.verdicts,
        "traces": result.traces,
        "longest": result.longest,
        "masked": result.masked,
        "masks": list(result.masks),
        "result": result.text,
        "difference": None if result.difference is None else _difference(result.difference),
    }


def _difference(found: Difference) -> dict[str, Json]:
    return {
        "trace": list(found.trace),
        "baseline": found.baseline,
        "expected": [verdict.value for verdict in found.expected],
        "got": [verdict.value for verdict in found.got],
    }


# Results as JUnit XML, which continuous integration shows as tests.

_SKIPPED = (Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT)


def junit_text(results: Iterable[Result], note: str = "") -> str:
    """One suite per tree and semantics, one test case per participant.

    A disagreement is a failure, what could not run an error, and what a language cannot say or is too large is skipped.
    """
    root = ET.Element("testsuites", name=f"rvaft cross-check{f': {note}' if note else ''}")
    for job, group in groupby(results, key=lambda result: result.job):
        cases = list(group)
        suite = ET.SubElement(root, "testsuite", name=_text(f"{job.title} ({job.semantics})"))
        suite.set("tests", str(len(cases)))
        suite.set("failures", str(sum(case.status is Status.DIFFERS for case in cases)))
        suite.set("errors", str(sum(_erroneous(case) for case in cases)))
        suite.set("skipped", str(sum(case.status in _SKIPPED for case in cases)))
        suite.set("time", f"{sum(case.seconds for case in cases):.3f}")
        for case in cases:
            _case(suite, case)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _erroneous(result: Result) -> bool:
    return result.status in (Status.COULD_NOT_RUN, Status.TOOL_MISSING)


def _case(suite: ET.Element, result: Result) -> None:
    name = _text(result.participant)
    made = ET.SubElement(suite, "testcase", name=name, classname=_text(f"{result.job.title}.{result.job.semantics}"))
    made.set("time", f"{result.seconds:.3f}")
    if result.status is Status.DIFFERS:
        failure = ET.SubElement(made, "failure", message=_text(result.text))
        failure.text = _text("\n".join(difference_lines(result)))
    elif result.status in _SKIPPED:
        ET.SubElement(made, "skipped", message=_text(result.text))
    elif _erroneous(result):
        ET.SubElement(made, "error", message=_text(result.text))


def _text(text: str) -> str:
    """The text without the control characters that XML cannot hold."""
    return "".join(c if c in "\t\n" or (c.isprintable() or ord(c) > 0x9F) else "\ufffd" for c in text)


# Results as Markdown, for the summary page of a run in continuous integration.


def markdown_text(results: Iterable[Result], note: str = "") -> str:
    """The totals as a table, then each disagreement with its trace, then what could not be compared."""
    totals = Totals.of(results)
    lines = ["## rvaft cross-check", "", f"{'; '.join(filter(None, [totals.headline, note]))}.", ""]
    if not totals.participants:
        return "\n".join(lines)
    lines += _row(["participant", *totals.semantics])
    lines += _row(["---"] * (1 + len(totals.semantics)))
    for participant in totals.participants:
        lines += _row([participant, *(totals.counted(participant, semantics) for semantics in totals.semantics)])
    for result in totals.differing:
        lines += ["", f"### {_cell(f'{result.participant}: {result.job.title} ({result.job.semantics})')}", ""]
        lines += [f"    {line}" for line in difference_lines(result)]
    if totals.unable:
        lines += ["", "### Not compared", ""]
        lines += [_item(result) for result in totals.unable]
    return "\n".join(lines) + "\n"


def _item(result: Result) -> str:
    return f"- {_cell(f'{result.participant}: {result.job.title} ({result.job.semantics}): {result.text}')}"


def _row(cells: Iterable[str]) -> list[str]:
    return [f"| {' | '.join(map(_cell, cells))} |"]


def _cell(text: str) -> str:
    """The text in one line and without meaning in Markdown or HTML."""
    plain = " ".join(text.split())
    for sign in "\\|`*_<>[]":
        plain = plain.replace(sign, f"\\{sign}")
    return plain


__all__ = [
    "Totals",
    "csv_text",
    "difference_lines",
    "json_text",
    "junit_text",
    "markdown_text",
    "result_lines",
    "summary_lines",
]
