"""The note on what was found, written from the measurements."""

from collections.abc import Iterator, Sequence
from typing import Final

from cross_check.benchmark.measurement import Measurement, Outcome
from cross_check.benchmark.tables import milliseconds
from papers.languages.findings import FINDINGS, Finding
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

SHORT: Final = (2, 3, 6, 9, 12)
"""The numbers of children in the short table; VOT with half of them."""

_HEAD: Final = """\
# Specification languages compared

Every gate with 1 to {most} children, VOT with every threshold, under each semantics, in each language. `python -m papers.languages` measures all of it anew
and writes this page and, beside it,

| file | what is in it |
| --- | --- |
| `languages.csv` | every measurement; [docs/compare.md](../../docs/compare.md) explains the columns |
| `languages.tex`, `short.tex` | LaTeX tables of all, and of a selection that fits a page for each semantics |
| `figures/` | plots: `gates-MEASURE-SEMANTICS`, each as PDF and PNG |

It takes some minutes; `--resume` goes on after an interruption. Sizes are the same in every run, times are those of the machine that wrote this page,
and of what else it did then: `--resume` keeps the times of earlier runs.

{count} measurements: {outcomes}.

## What is seen in the sizes

Each sentence is held against every cell that it is about.

"""
_TIMES: Final = """
## Times at {most} children

`projected`. Milliseconds to translate; thousands of events per second when a monitor meets them for the first time, and when the same
traces are run again. The readers of RML and LTLf remember what an event did to a state, so that a trace which is known costs little more than a look-up; the first time
tells what the language costs.

"""


def note(rows: Sequence[Measurement]) -> str:
    """The page, in Markdown."""
    most = max(row.children or 0 for row in rows)
    counts = [(outcome, sum(_ended(row) is outcome for row in rows)) for outcome in Outcome]
    outcomes = ", ".join(f"{count:,} {outcome}" for outcome, count in counts if count)
    head = _HEAD.format(most=most, count=f"{len(rows):,}", outcomes=outcomes)
    times = [*_times([row for row in rows if row.semantics is Semantics.PROJECTED and row.children == most])]
    parts = [head, *(_finding(finding, rows) for finding in FINDINGS), *_large(rows)]
    return "".join([*parts, _TIMES.format(most=most), "\n".join(times), "\n"])


def short(rows: Sequence[Measurement]) -> list[Measurement]:
    """The rows of the short table."""
    return [row for row in rows if row.children in SHORT and row.threshold in (None, _half(row))]


def _half(row: Measurement) -> int:
    return ((row.children or 0) + 1) // 2


def _ended(row: Measurement) -> Outcome | None:
    return row.run if row.result is Outcome.OK else row.result


def _finding(finding: Finding, rows: Sequence[Measurement]) -> str:
    cells = finding.cells(rows)
    against = [row for row in cells if not finding.holds(row)]
    said = f"{len(cells):,} cells" if not against else f"NOT CONFIRMED: {len(against)} of {len(cells)} cells differ"
    return f"- {finding.title} ({said})\n"


def _large(rows: Sequence[Measurement]) -> Iterator[str]:
    """What was too much for a language, or took too long."""
    for outcome in (Outcome.TOO_LARGE, Outcome.TIMEOUT):
        met = [row for row in rows if _ended(row) is outcome]
        for language, semantics in dict.fromkeys((row.language, row.semantics) for row in met):
            trees = [row.tree for row in met if (row.language, row.semantics) == (language, semantics)]
            yield f"- {outcome} in `{language}` under `{semantics}`: {', '.join(trees)}.\n"


def _times(rows: Sequence[Measurement]) -> Iterator[str]:
    """A table with a row per gate and a group of columns per language."""
    languages = list(dict.fromkeys(row.language for row in rows))
    columns = ("ms", "first", "again")
    yield "| gate | " + " | ".join(f"{language} {column}" for language in languages for column in columns) + " |"
    yield "| --- |" + " ---: |" * (len(languages) * len(columns))
    for gate in Gate:
        chosen = {row.language: row for row in rows if row.gate is gate and row.threshold in (None, _half(row))}
        if chosen:
            name = next(iter(chosen.values())).tree
            yield (
                f"| {name} | " + " | ".join(cell for language in languages for cell in _cells(chosen[language])) + " |"
            )


def _cells(row: Measurement) -> tuple[str, str, str]:
    time = "-" if row.seconds is None else milliseconds(row.seconds)
    return (time, _thousands(row.events_per_second), _thousands(row.again_per_second))


def _thousands(speed: float | None) -> str:
    return "-" if speed is None else f"{speed / 1000:.1f}"
