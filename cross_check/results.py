"""Results of comparisons, with output for terminals, spreadsheets and continuous integration."""

import csv
import io
import json
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from importlib.metadata import version
from itertools import groupby
from typing import Final, cast
from xml.etree import ElementTree as ET

from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolMissing, ToolTimeout
from rvaft.model.nodes import Kind
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.reports.notebook import table_html
from rvaft.support.plugins import display
from rvaft.support.terminal import columns, spreadsheet_cell, visible
from rvaft.support.wording import listing


class Status(StrEnum):
    """The result for one participant."""

    BASELINE = "baseline"
    PROVED = "proved"
    """Agrees with the baseline on all traces."""
    TESTED = "tested"
    """Agrees on the traces that were tried."""
    DIFFERS = "differs"
    VACUOUS = "vacuous"
    """All verdicts were equal, but nothing was detected: no evidence of agreement."""
    NOT_EXPRESSIBLE = "not expressible"
    TOO_LARGE = "too large"
    TIMEOUT = "timeout"
    TOOL_MISSING = "tool missing"
    COULD_NOT_RUN = "could not run"

    @classmethod
    def of(cls, error: RvaftError) -> "Status":
        """Return the status for an error that excludes a participant; never agreement."""
        match error:
            case NotExpressible():
                return cls.NOT_EXPRESSIBLE
            case TooLarge():
                return cls.TOO_LARGE
            case ToolMissing():
                return cls.TOOL_MISSING
            case ToolTimeout():
                return cls.TIMEOUT
            case _:
                return cls.COULD_NOT_RUN

    @property
    def agrees(self) -> bool:
        """Whether verdicts with detections were compared and equal."""
        return self in (Status.PROVED, Status.TESTED)


def raised(error: Exception) -> RvaftError:
    """Return an exception as an error of this project."""
    if isinstance(error, RvaftError):
        return error
    return RvaftError(" ".join(f"{type(error).__name__}: {error}".split()))


def reason(error: BaseException) -> str:
    """Return the reason to show beside a status."""
    match error:
        case NotExpressible():
            return " ".join(error.reason.split())
        case TooLarge():
            return f"{error.what} (limit {error.limit})"
        case _:
            return str(error).splitlines()[0]


_RAN: Final = (Status.BASELINE, Status.PROVED, Status.TESTED, Status.DIFFERS)
_FAILED: Final = (Status.TOOL_MISSING, Status.COULD_NOT_RUN)
_SKIPPED: Final = (Status.VACUOUS, Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT)
_REASONS: Final = 2
_FAILURES: Final = 20
_JUNIT: Final = {**dict.fromkeys(_RAN, ""), Status.DIFFERS: "failure", **dict.fromkeys(_SKIPPED, "skipped")}


NOTHING: Final = "nothing was detected in any trace"
DETECTIONS_ONLY: Final = "detections only"
"""The note for participants without ⊥: only the first detection of a trace was compared."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A trace on which a participant and the baseline disagree, with their verdicts after every
    prefix.

    If only the matches differ, `match` is the first missing or additional match. `reason` is a value
    that makes the difference, if one is known.
    """

    trace: tuple[Json, ...]
    baseline: str
    expected: tuple[Verdict, ...]
    got: tuple[Verdict, ...]
    match: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Job:
    """A tree, or a part of it, under one semantics; `name` names the tree in reports."""

    name: str
    semantics: Semantics
    branch: int | None = None
    kind: Kind | None = None

    @property
    def title(self) -> str:
        """The name, with the part."""
        if self.branch is not None:
            return f"{self.name} branch {self.branch}"
        return self.name if self.kind is None else f"{self.name} {self.kind}s"


@dataclass(frozen=True, slots=True)
class Result:
    """One participant in one comparison.

    - `seconds`: time of translation and first reading.
    - `verdicts`: number of compared verdicts.
    - `symbols`, `states`: sizes of the text.
    - `why`: reason if the participant is not proved.
    - `masked`, `masks`: traces with known deviations of the tool, and these deviations.
    - `matched`: traces on which all matches were compared.
    - `detections_only`: ⊥ was not compared.
    - `unknown_fields`: the fields that the text reads and no event of the tree has.
    - `outside`: a difference on a trace that breaks an assumption of the tree; no disagreement.
    """

    job: Job
    participant: str
    status: Status
    seconds: float = 0.0
    symbols: int | None = None
    states: int | None = None
    verdicts: int = 0
    traces: int = 0
    longest: int = 0
    why: str = ""
    difference: Difference | None = None
    masked: int = 0
    masks: tuple[str, ...] = ()
    matched: int = 0
    detections_only: bool = False
    unknown_fields: tuple[str, ...] = ()
    outside: Difference | None = None

    def _repr_html_(self) -> str:
        return cast("str", display("comparison")(self))

    @property
    def text(self) -> str:
        """The result in one line."""
        match self.status:
            case Status.PROVED | Status.BASELINE:
                return str(self.status)
            case Status.TESTED:
                because = f" ({self.why})" if self.why else ""
                matched = f", all matches of {self.matched}" if self.matched else ""
                return f"tested: {self._tried}{matched}{self._masked}{because}"
            case Status.VACUOUS if self.traces:
                limited = f" ({self.why})" if self.why != NOTHING else ""
                return f"vacuous: nothing was detected in {self._tried}{self._masked}{limited}"
            case Status.DIFFERS:
                length = len(self.difference.trace) if self.difference else 0
                return f"differs after {length} {_plural('event', length)}"
            case _:
                return f"{self.status}: {self.why}" if self.why else str(self.status)

    @property
    def _tried(self) -> str:
        return f"{self.traces} {_plural('trace', self.traces)} up to length {self.longest}"

    @property
    def _masked(self) -> str:
        return f", {self.masked} masked ({', '.join(self.masks)})" if self.masked else ""

    @property
    def ending(self) -> str:
        """`ok` if the participant gave verdicts to the end, else its status."""
        return "ok" if self.status in _RAN else str(self.status)


def result_html(result: Result) -> str:
    """Return a result as a table for a notebook."""
    job, compared = result.job, f"{result.verdicts:,}"
    row = [job.title, job.semantics, result.participant, result.text, compared]
    return table_html(["tree", "semantics", "participant", "result", "verdicts"], [row])


def exit_status(results: Iterable[Result], *, failing: Collection[Status] = (), vacuous: bool = False) -> int:
    """Return 0 if all agree, 1 for disagreements, 2 if something could not run or nothing was
    compared.

    2 takes precedence. `failing` lists further statuses that count as failures. A comparison with
    only vacuous results compared nothing; `vacuous` allows this for single comparisons, such as
    random trees, but not for all.
    """
    every = list(results)
    failed = {Status.COULD_NOT_RUN, Status.TOOL_MISSING, *failing}
    compared = {result.job for result in every if result.status.agrees or result.status is Status.DIFFERS}
    if vacuous and compared:
        compared |= {result.job for result in every if result.status is Status.VACUOUS}
    if any(result.status in failed or result.job not in compared for result in every):
        return 2
    return 1 if any(result.status is Status.DIFFERS for result in every) else 0


class ComparisonTotals:
    """Counts over all results; `unable`: the results without a comparison.

    Verdicts of vacuous comparisons do not count.
    """

    def __init__(self, results: Iterable[Result]) -> None:
        every = list(results)
        self.statuses: dict[tuple[str, Semantics], Counter[Status]] = {}
        called = _called(every)
        for result in every:
            counts = self.statuses.setdefault((called[result.participant], result.job.semantics), Counter())
            counts[result.status] += 1
        self.differing = [result for result in every if result.status is Status.DIFFERS]
        self.remarkable = [result for result in every if remarks(result)]
        self.unable = [result for result in every if result.status not in _RAN]
        self.vacuous = sum(result.status is Status.VACUOUS for result in every)
        compared = {result.job for result in every if result.status.agrees or result.status is Status.DIFFERS}
        self.counts = {
            "tree": len({result.job.title for result in every}),
            "comparison": len({result.job for result in every}),
            "verdict": sum(result.verdicts for result in every if result.status in _RAN and result.job in compared),
            "proof": sum(result.status is Status.PROVED for result in every),
        }
        self.masked = sum(result.masked for result in every)

    @property
    def table(self) -> list[list[str]]:
        """Counts of statuses: a row per participant, a column per semantics, in order of
        appearance.
        """
        semantics = list(dict.fromkeys(one for _, one in self.statuses))
        lines = [["participant", *semantics]]
        for participant in dict.fromkeys(participant for participant, _ in self.statuses):
            counts = [self.statuses.get((participant, one), Counter()) for one in semantics]
            lines.append([participant, *map(_counted, counts)])
        return lines

    @property
    def headline(self) -> str:
        """The summary line."""
        seldom = {"masked trace": self.masked, "vacuous result": self.vacuous}
        counted = self.counts | {what: number for what, number in seldom.items() if number}
        summary = ", ".join(f"{number:,} {_plural(what, number)}" for what, number in counted.items())
        if not self.counts["verdict"]:
            outcome = "nothing was detected, so nothing was compared" if self.vacuous else "nothing was compared"
            return f"{summary}; {outcome}"
        differ, failed = len(self.differing), sum(one.status in _FAILED for one in self.unable)
        ends = [
            f"{differ:,} {_plural('disagreement', differ)}" * bool(differ),
            f"{failed:,} could not run" * bool(failed),
        ]
        return f"{summary}; {', '.join(filter(None, ends)) or 'no disagreement'}"


def _called(results: Iterable[Result]) -> dict[str, str]:
    found: dict[str, str] = {}
    for result in results:
        if result.detections_only or result.participant not in found:
            found[result.participant] = f"{result.participant}{f' ({DETECTIONS_ONLY})' * result.detections_only}"
    return found


def _plural(what: str, number: int) -> str:
    return what if number == 1 else f"{what}s"


# Terminal output.


def result_lines(results: Iterable[Result]) -> list[str]:
    """Return one line per participant and comparison."""
    rows = [["TREE", "SEMANTICS", "PARTICIPANT", "SECONDS", "SYMBOLS", "STATES", "RESULT"]]
    for result in results:
        sizes = ("" if size is None else str(size) for size in (result.symbols, result.states))
        named = [result.job.title, result.job.semantics, result.participant, f"{result.seconds:.3f}"]
        rows.append([*named, *sizes, result.text])
    return columns(rows)


def summary_lines(totals: ComparisonTotals) -> list[str]:
    """Return one line per participant, with counts per semantics."""
    head, *lines = totals.table
    return columns([[cell.upper() for cell in head], *lines])


def part_lines(results: Iterable[Result], parts: Mapping[str, Collection[str]]) -> list[str]:
    """Return one line per participant, with counts on trees per construct (`parts`, by title)."""
    every = list(results)
    names = _called(every)
    found = {part: {name: Counter[Status]() for name in names} for some in parts.values() for part in some}
    for result in every:
        for part in parts.get(result.job.title, ()):
            found[part][result.participant][result.status] += 1
    rows = [["ON TREES WITH", *(part.upper() for part in found)]]
    rows += [[called, *(_counted(counts[name]) for counts in found.values())] for name, called in names.items()]
    return columns(rows) if found else []


def unable_lines(results: Iterable[Result]) -> list[str]:
    """Return what was not compared: the main reasons per participant, and each failure."""
    skipped: dict[tuple[str, Status], list[Result]] = {}
    failed: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        if result.status in _SKIPPED:
            skipped.setdefault((result.participant, result.status), []).append(result)
        elif result.status not in _RAN:
            failed.setdefault((result.participant, result.text), []).append(result)
    rows = [["NOT COMPARED", "COMPARISONS", "BECAUSE"]]
    for (participant, status), some in skipped.items():
        chief = Counter(f"{status}: {result.why}" if result.why else str(status) for result in some).most_common()
        if others := chief[_REASONS:] if len(chief) > _REASONS + 1 else []:
            rest = f"{status}: {len(others)} other reasons"
            chief = [*chief[:_REASONS], (rest, sum(times for _, times in others))]
        rows += [["" if place else participant, f"{times:,}", why] for place, (why, times) in enumerate(chief)]
    lines = columns(rows) if skipped else []
    for (participant, why), some in [*failed.items()][:_FAILURES]:
        where = f"{some[0].job.title} under {some[0].job.semantics}" if len(some) == 1 else f"{len(some):,} comparisons"
        lines.append(visible(f"{participant} on {where}: {why}"))
    if more := sum(map(len, [*failed.values()][_FAILURES:])):
        lines.append(f"and {more:,} more that could not run")
    return lines


def _counted(counts: Mapping[Status, int]) -> str:
    return ", ".join(f"{status} {counts[status]}" for status in Status if counts[status])


def difference_lines(result: Result) -> list[str]:
    """Return the differing trace, with both verdicts after every event."""
    return [] if result.difference is None else _trace_lines(result, result.difference)


def remarks(result: Result) -> list[list[str]]:
    """Return the lines of each remark: on fields of the text, and on a trace that breaks an assumption of the tree."""
    found: list[list[str]] = []
    if result.unknown_fields:
        names = listing(result.unknown_fields)
        what = f"field {names} is" if len(result.unknown_fields) == 1 else f"fields {names} are"
        found.append([f"remark: the {what} in no event of the tree"])
    if (other := result.outside) is not None:
        trace = _trace_lines(result, other)
        found.append(["remark: it differs on a trace that breaks what the tree assumes:", *trace])
    return found


def _trace_lines(result: Result, found: Difference) -> list[str]:
    rows = [("EVENT", found.baseline, result.participant)]
    for event, expected, got in zip(found.trace, found.expected, found.got, strict=True):
        rows.append((json.dumps(event, ensure_ascii=False), expected.symbol, got.symbol))
    lines = columns(rows) if found.trace else ["they differ before any event"]
    return [*lines, *filter(None, (found.match, found.reason))]


# Files: each format gets the results and a note.


def csv_text(results: Iterable[Result], note: str = "") -> str:  # noqa: ARG001 (a table has no room for it)
    """Return a row per participant and comparison; columns have the names in Spot's `ltlcross` if
    possible.
    """
    stream = io.StringIO()
    names = ("tree", "semantics", "participant", "exit_status", "seconds", "symbols", "states", "verdicts", "result")
    writer = csv.DictWriter(stream, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for result in results:
        row = {**_object(result), "tree": result.job.title, "seconds": f"{result.seconds:.6f}"}
        writer.writerow({name: spreadsheet_cell(one) if isinstance(one, str) else one for name, one in row.items()})
    return stream.getvalue()


def json_text(results: Iterable[Result], note: str = "") -> str:
    """Return the totals and every result, with differing traces."""
    every = list(results)
    totals = ComparisonTotals(every)
    counts = {**{f"{what}s": number for what, number in totals.counts.items()}, "disagreements": len(totals.differing)}
    counts["vacuous"] = totals.vacuous
    found = {"version": version("rvaft"), "note": note, "totals": counts, "results": [_object(one) for one in every]}
    return json.dumps(found, indent=1) + "\n"


def _object(result: Result) -> dict[str, Json]:
    job = {name: getattr(result.job, name) for name in ("branch", "kind", "semantics")}
    sizes = ("symbols", "states", "verdicts", "traces", "longest", "masked", "masks", "matched", "detections_only")
    return {
        "tree": result.job.name,
        **job,
        "participant": result.participant,
        "status": result.status,
        "exit_status": result.ending,
        "seconds": round(result.seconds, 6),
        **{name: getattr(result, name) for name in sizes},
        "result": result.text,
        "unknown_fields": result.unknown_fields,
        "difference": result.difference and _difference(result.difference),
        "outside": result.outside and _difference(result.outside),
    }


def _difference(found: Difference) -> dict[str, Json]:
    return {name: value for name, value in asdict(found).items() if value or name not in ("match", "reason")}


def junit_text(results: Iterable[Result], note: str = "") -> str:
    """Return JUnit XML: one suite per tree and semantics, one test case per participant.

    A disagreement is a failure, a participant that could not run an error; others without verdicts
    are skipped.
    """
    root = ET.Element("testsuites", name=f"rvaft cross-check{f': {note}' if note else ''}")
    for job, group in groupby(results, key=lambda result: result.job):
        cases = [(case, _JUNIT.get(case.status, "error")) for case in group]
        met = Counter(kind for _, kind in cases)
        counts = {"failures": met["failure"], "errors": met["error"], "skipped": met["skipped"]}
        attributes = {name: str(count) for name, count in {"tests": len(cases), **counts}.items()}
        attributes["time"] = f"{sum(case.seconds for case, _ in cases):.3f}"
        suite = ET.SubElement(root, "testsuite", {"name": _printable(f"{job.title} ({job.semantics})"), **attributes})
        for case, kind in cases:
            named = {"name": _printable(case.participant), "classname": _printable(f"{job.title}.{job.semantics}")}
            made = ET.SubElement(suite, "testcase", named, time=f"{case.seconds:.3f}")
            if kind:
                shown = ET.SubElement(made, kind, message=_printable(case.text))
                shown.text = _printable("\n".join(difference_lines(case))) or None
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _printable(text: str) -> str:
    return "".join(c if c in "\t\n" or (c.isprintable() or ord(c) > 0x9F) else "\ufffd" for c in text)


def markdown_text(results: Iterable[Result], note: str = "") -> str:
    """Return a table of totals, each disagreement with its trace, and what was not compared."""
    totals = ComparisonTotals(results)
    lines = ["## rvaft cross-check", "", f"{'; '.join(filter(None, [totals.headline, note]))}.", ""]
    if not totals.statuses:
        return "\n".join(lines)
    head, *rows = totals.table
    lines += [f"| {' | '.join(map(_cell, row))} |" for row in (head, ["---"] * len(head), *rows)]
    for result in totals.differing:
        lines += ["", f"### {_cell(_named(result))}", "", *(f"    {line}" for line in difference_lines(result))]
    for result in totals.remarkable:
        shown = [f"    {line}" for some in remarks(result) for line in some]
        lines += ["", f"### {_cell(_named(result))}", "", *shown]
    if totals.unable:
        lines += ["", "### Not compared", ""]
        lines += [f"- {_cell(f'{_named(result)}: {result.text}')}" for result in totals.unable]
    return "\n".join(lines) + "\n"


def _named(result: Result) -> str:
    return f"{result.participant}: {result.job.title} ({result.job.semantics})"


def _cell(text: str) -> str:
    plain = " ".join(text.split())
    for sign in "\\|`*_<>[]":
        plain = plain.replace(sign, f"\\{sign}")
    return plain
