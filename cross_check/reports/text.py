"""Results for a terminal, as lines of plain text."""

import json
from collections.abc import Iterable

from cross_check.reports.totals import Totals
from cross_check.results import Result
from rvaft.printable import columns


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
