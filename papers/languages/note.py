"""The page of results, generated from the measurements."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from papers.languages.findings import SECTIONS, Finding
from papers.languages.measurement import EVENTS, PROGRAMS, Measurement, Outcome
from papers.languages.tables import milliseconds, unable
from rvaft.backend import backend
from rvaft.capabilities import table
from rvaft.errors import Cause
from rvaft.export.latex import escaped
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

FOLDER: Final = Path(__file__).parent
TREES: Final = (
    "order",
    "votes",
    "shared",
    "nested",
    "overlap",
    "guard",
    "null",
    "tied",
    "tied_some",
    "compared",
    "product",
    "window",
    "inner_window",
    "apart",
    "late",
)
"""Trees that need increasing capabilities: files in `trees/`, described by their first lines."""
SHORT: Final = (2, 3, 4, 6, 8)
"""The numbers of children in the short table; VOT with half of them."""
_CAUSES: Final = {Cause.LANGUAGE: "beyond the language", Cause.WRITER: "not written by rvaft"}
_ANSWERS: Final = {Cause.LANGUAGE: "no", Cause.WRITER: "-"}
FEW: Final = 5
"""Number of children in the tables of sizes and times: the most within all limits."""

_HEAD: Final = """\
# Evaluation: {languages} specification languages

One set of attack-fault trees is translated into {languages} specification languages.

- **RQ1** Which language can express which tree?
- **RQ2** How does the size of a specification grow with the tree?
- **RQ3** How long do translation and monitoring take?

## Method

| factor | values |
| --- | --- |
| trees | each gate with 1 to {most} children, votes with each threshold, and the {trees} trees of RQ1 |
| semantics | `strict`, `projected`, `consecutive`, `scattered` |
| languages | {names} |

There are {count} measurements: {outcomes}. Of the texts, {extended:,} use an extension of rvaft, which
other programs of the language do not read. Each measurement runs in its own process. Automata are limited to
{limit:,} states, other languages to the default limit of `rvaft emit`. [Compare
languages](../../docs/how-to/compare.md) defines the measures. Every text that is run must give the engine's verdicts
on the timed traces. {outside}

`python -m papers.languages` repeats all measurements and writes this page; `--resume` continues. `--claims`
lists what a language cannot express, with the page that has the argument.

| file | content |
| --- | --- |
| `languages.csv` | every measurement |
| `expressible.tex`, `capabilities.tex` | RQ1 and the capabilities of the backends, for LaTeX |
| `languages.tex`, `short.tex` | all sizes and times, and a selection |
| `figures/` | plots, each as PDF and PNG |

## RQ1: expressiveness

All trees are under `scattered`; the last rows count the trees that have a text under each semantics, and
after `+` those whose text uses an extension of rvaft.

| cell | meaning |
| --- | --- |
| yes | a text in the language as it is |
| slices, time variables | a text with this extension of rvaft: its header has variables over several events |
| no (n) | the language cannot express it, for reason n below; its page has the argument |
| - (n) | rvaft does not write it, for reason n; this says nothing of the language |

"""
_SEEN: Final = """
## RQ2: sizes

Each statement is checked against all cells that it concerns. n is the number of children, of which k are
needed; C(n,k) is a binomial coefficient.
"""
_LIMITS: Final = """
### Limits

"""
_TABLES: Final = """
## RQ3: times at {few} children

Under `scattered`, which all languages except the paper's translation express. Languages with * report
detections only: their programs read whole traces. A time has after ± the difference of the longest and the
shortest of its runs, if there are several. There is no speed of fewer than {events} events.
"""
_THREATS: Final = """
## Threats to validity

- **Construct.** Symbols are tokens, and languages differ in what they need tokens for. The count of HOA
  includes its header, which defines the events; the counts of LTLf and MTL leave such headers out.
- **Internal.** Times come from one machine with two shared cores; `--resume` keeps times of earlier runs.
  Sizes do not depend on the machine. Monitors in Python (RML, LTLf, HOA) are compared with programs in
  other languages (Reelay, SQLite), so speeds compare programs and not languages.
- **External.** Gates over single events show growth, not typical trees. The trees of RQ1 are chosen to
  separate languages.
- **Agreement.** A text may be wrong on untested traces. `rvaft cross-check` tests more, and proves
  agreement if a language has three verdicts and no variables are shared between events.
"""
_LEGEND: Final[Mapping[str, Callable[[Measurement], str]]] = {
    "Symbols": lambda row: "-" if row.symbols is None else f"{row.symbols:,}",
    "Milliseconds to translate": lambda row: _spread(_milliseconds(row.seconds), _milliseconds(row.seconds_spread)),
    "Thousands of events per second, by a reader that has read these traces before, or (*) reads "
    "all of them at once": (
        lambda row: _spread(_thousands(row.again_per_second), _thousands(row.again_spread))
    ),
}  # fmt: skip


def note(rows: Sequence[Measurement], limit: int) -> str:
    """Return the page in Markdown."""
    most = max(row.children or 0 for row in rows)
    names = languages(rows)
    counts: list[tuple[str, int]] = []
    for outcome in Outcome:
        if outcome is Outcome.NOT_EXPRESSIBLE:
            counts += [(words, sum(row.cause is cause for row in rows)) for cause, words in _CAUSES.items()]
        else:
            counts.append((outcome, sum(row.ended is outcome for row in rows)))
    outcomes = ", ".join(f"{count:,} {outcome}" for outcome, count in counts if count)
    outside = []
    for name, program in PROGRAMS.items():
        texts = [row for row in rows if row.language == name and row.result is Outcome.OK]
        run = sum(not row.only_emitted for row in texts)
        outside.append(f"{program} ran {run:,} of the {len(texts):,} texts of `{name}`.")
    head = _HEAD.format(
        languages=len(names),
        most=most,
        trees=len(TREES),
        names=", ".join(f"`{name}`" for name in names),
        count=f"{len(rows):,}",
        outcomes=outcomes,
        limit=limit,
        extended=sum(bool(row.extension) for row in rows),
        outside=" ".join(outside),
    )
    parts = [head, _lines(_markdown(*expressible(rows))), _SEEN]
    for title, findings in SECTIONS.items():
        parts += [f"\n### {title}\n\n", *(_finding(finding, rows) for finding in findings)]
    parts += [_LIMITS, _lines(_large([row for row in rows if row.gate is not None]))]
    parts.append(_TABLES.format(few=FEW, events=EVENTS))
    return "".join([*parts, _lines(_sizes_and_times(rows)), _THREATS])


def languages(rows: Sequence[Measurement]) -> list[str]:
    """Return the languages in order."""
    return [*dict.fromkeys(row.language for row in rows)]


def short(rows: Sequence[Measurement]) -> list[Measurement]:
    """Return the rows of the short table."""
    return [row for row in rows if row.children in SHORT and row.threshold in (None, _half(row))]


def _half(row: Measurement) -> int:
    return ((row.children or 0) + 1) // 2


def _lines(lines: Iterator[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


# Expressiveness.


def expressible(rows: Sequence[Measurement]) -> tuple[list[list[str]], list[str]]:
    """Return the table of languages and trees, heading first, and the reasons for its numbers."""
    names = languages(rows)
    cells = {(Path(row.tree).stem, row.semantics, row.language): row for row in rows if row.gate is None}
    reasons: dict[str, int] = {}

    def cell_text(row: Measurement) -> str:
        if row.result is Outcome.NOT_EXPRESSIBLE:
            assert row.cause is not None
            return f"{_ANSWERS[row.cause]} ({reasons.setdefault(row.reason, len(reasons) + 1)})"
        if _is_said(row):
            return row.extension or "yes"
        return "other verdicts" if row.differing else str(row.ended)

    found = [["tree", *names]]
    for tree in TREES:
        title = (FOLDER / "trees" / f"{tree}.rvaft").read_text(encoding="utf-8").splitlines()[0].strip("/ .")
        found.append([title, *(cell_text(cells[tree, Semantics.SCATTERED, name]) for name in names)])
    for semantics in Semantics:
        said = {name: [row for tree in TREES if _is_said(row := cells[tree, semantics, name])] for name in names}
        extended = {name: sum(bool(row.extension) for row in some) for name, some in said.items()}
        can = (
            f"{len(said[name]) - extended[name]}{f' + {extended[name]}' if extended[name] else ''}" for name in names
        )
        found.append([f"{semantics}, of {len(TREES)}", *can])
    runs = (_told([row for row in rows if row.language == name]) for name in names)
    found.append(["verdicts of a run", *runs])
    return found, list(reasons)


def _is_said(row: Measurement) -> bool:
    return row.ended is Outcome.OK and not row.differing


def _told(rows: Sequence[Measurement]) -> str:
    if all(row.only_emitted for row in rows if row.result is Outcome.OK):
        return "emitted"
    return "detections only" if any(row.detections_only for row in rows) else "all"


def _markdown(lines: Sequence[Sequence[str]], reasons: Sequence[str]) -> Iterator[str]:
    heading, *others = lines
    yield f"| {' | '.join(heading)} |"
    yield "| --- |" + " :---: |" * (len(heading) - 1)
    yield from (f"| {' | '.join(line)} |" for line in others)
    yield ""
    yield from (f"{number}. {reason}" for number, reason in enumerate(reasons, 1))


def capabilities(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the table of capabilities of these backends, heading first."""
    heading, *others = table({name: backend(name).capabilities() for name in names})
    return [("", *heading[1:]), *others]


def capabilities_tex(names: Sequence[str]) -> str:
    r"""Return the table of capabilities for LaTeX, as an `\input`."""
    heading, *others = ([escaped(cell.replace("`", "")) for cell in line] for line in capabilities(names))
    turned = " & ".join(rf"\rotatebox{{90}}{{{name}}}" for name in heading[1:])
    return "\n".join(
        [
            "% Needs \\usepackage[T1]{fontenc} and \\usepackage{booktabs,graphicx,textcomp}.",
            r"\begin{table*}[htbp]",
            r"\centering",
            r"\caption{The capabilities of each backend; it refuses trees that need others.}",
            r"\label{tab:languages-capabilities}",
            r"\footnotesize\setlength{\tabcolsep}{3.5pt}",
            rf"\begin{{tabular}}{{l{'c' * (len(heading) - 1)}}}",
            r"\toprule",
            rf" & {turned} \\",
            r"\midrule",
            *(" & ".join(line) + r" \\" for line in others),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table*}",
            "",
        ]
    )


def expressible_tex(cells: Sequence[Sequence[str]], reasons: Sequence[str]) -> str:
    r"""Return the table of expressiveness for LaTeX, as an `\input`, with the reasons below it."""
    heading, *others = ([escaped(cell) for cell in line] for line in cells)
    turned = " & ".join(rf"\rotatebox{{90}}{{{name}}}" for name in heading[1:])
    rotated_cells = ("emitted", "detections only", "all", "slices", "time variables")
    rotated = ([rf"\rotatebox{{90}}{{{cell}}}" if cell in rotated_cells else cell for cell in line] for line in others)
    lines = [" & ".join(line) + r" \\" for line in rotated]
    below = " ".join(f"({number}) {escaped(reason.replace('`', ''))}." for number, reason in enumerate(reasons, 1))
    return "\n".join(
        [
            "% Needs \\usepackage[T1]{fontenc} and \\usepackage{booktabs,graphicx,textcomp}.",
            r"\begin{table*}[htbp]",
            r"\centering",
            (
                r"\caption{Which language has a text for which tree under scattered: as it is (yes), by an extension "
                r"of rvaft (its name), not as the language cannot (no) or rvaft does not write it (-); "
                r"below it, how many of the trees under each semantics, after + by extension.}"
            ),
            r"\label{tab:languages-expressible}",
            r"\footnotesize\setlength{\tabcolsep}{3.5pt}",
            rf"\begin{{tabular}}{{l{'c' * (len(heading) - 1)}}}",
            r"\toprule",
            rf"{heading[0]} & {turned} \\",
            r"\midrule",
            *lines[: len(TREES)],
            r"\midrule",
            *lines[len(TREES) :],
            r"\bottomrule",
            r"\end{tabular}",
            "",
            rf"\medskip\parbox{{\linewidth}}{{\scriptsize {below}}}",
            r"\end{table*}",
            "",
        ]
    )


# Sizes and times.


def _finding(finding: Finding, rows: Sequence[Measurement]) -> str:
    cells = finding.cells(rows)
    against = [row for row in cells if not finding.holds(row)]
    outcome = f"{len(cells):,} cells" if not against else f"NOT CONFIRMED: {len(against)} of {len(cells)} cells differ"
    return f"- {finding.title} ({outcome})\n"


def _large(rows: Sequence[Measurement]) -> Iterator[str]:
    """Yield the gates beyond limits per language, with the smallest ones, and under which semantics."""
    kinds = dict.fromkeys(
        (row.ended, row.language, row.semantics) for row in rows if row.ended in (Outcome.TOO_LARGE, Outcome.TIMEOUT)
    )
    yield from [""] * bool(kinds)
    found: dict[str, dict[str, list[str]]] = {}
    for outcome, language, semantics in kinds:
        met = [row for row in rows if (row.ended, row.language, row.semantics) == (outcome, language, semantics)]
        least = {gate: min(row.children or 0 for row in met if row.gate is gate) for gate in {row.gate for row in met}}
        first = [row.tree for row in met if row.children == least[row.gate]]
        why = met[0].reason or met[0].run_reason
        smallest = f"{len(met)} gates, the smallest {', '.join(first)} ({why.strip()})"
        found.setdefault(smallest, {}).setdefault(f"{outcome} in `{language}`", []).append(f"`{semantics}`")
    for smallest, places in found.items():
        found_in = "; ".join(f"{where} under {', '.join(under)}" for where, under in places.items())
        yield f"- {found_in}: {smallest}."


def _sizes_and_times(rows: Sequence[Measurement]) -> Iterator[str]:
    """Yield a table per measure, with a row per gate and a column per language."""
    some = [row for row in rows if row.semantics is Semantics.SCATTERED and row.children == FEW]
    chosen = [row for row in some if row.threshold in (None, _half(row)) and row.language not in unable(some)]
    names = languages(chosen)
    starred = {row.language for row in chosen if row.detections_only}
    for title, cell in _LEGEND.items():
        has = [name for name in names if any(cell(row) != "-" for row in chosen if row.language == name)]
        yield from ("", f"{title}:", "")
        yield "| gate | " + " | ".join(f"{name}{'*' * (name in starred)}" for name in has) + " |"
        yield "| --- |" + " ---: |" * len(has)
        for gate in Gate:
            its: Mapping[str, Measurement] = {row.language: row for row in chosen if row.gate is gate}
            if its:
                yield f"| {next(iter(its.values())).tree} | " + " | ".join(cell(its[name]) for name in has) + " |"


def _spread(number: str, spread: str) -> str:
    return number if spread == "-" else f"{number} ± {spread}"


def _milliseconds(seconds: float | None) -> str:
    return "-" if seconds is None else milliseconds(seconds)


def _thousands(speed: float | None) -> str:
    return "-" if speed is None else f"{speed / 1000:.1f}"
