"""Results as Markdown, for the summary page of a run in continuous integration."""

from collections.abc import Iterable

from cross_check.reports.text import difference_lines
from cross_check.reports.totals import Totals
from cross_check.results import Result


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
