"""What `rvaft monitor` prints: a line per change of verdict and how it came about, a table, or one JSON object per event."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final, TextIO

import click

from rvaft.cli.failure import described, report
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitoring.explanation_json import (
    counted,
    expected,
    explained,
    other_fields,
    places,
    told_fields,
    unlike,
    variables,
)
from rvaft.monitoring.monitor_set import Column, Per
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.run import Listener, MonitoredTrace, VerdictChange
from rvaft.monitoring.stream import Key
from rvaft.monitors import Ended, Explanation
from rvaft.support.terminal import ProgressBar, visible
from rvaft.support.terminal import columns as aligned

ENDS: Final = 1_000
"""Keys for which it is said what was waited for in vain: finding out takes time, and among very many keys nobody reads it."""
ALL: Final = 100
"""Rows of the summary up to which all are shown; beyond it those of a detection or an error."""
MOST: Final = 1_000
"""Rows of the summary; and events up to which all have a row in a table, beyond it those that change a verdict."""
WIDE: Final = 8
"""Columns up to which each has one in the summary; beyond it those of a detection are listed."""
TYPES: Final = 20
"""Event types that are listed one by one."""
WAITING: Final = 10
"""Branches of which it is said what they waited for."""
SHOWN: Final = 40
"""Characters of a value that stands beside other things."""


class Sink:
    """Where a run writes: standard output and standard error, or a file and the lines for standard error, which another process passes on.

    The progress bar makes room for what is printed.
    """

    def __init__(self, file: TextIO | None = None, progress: ProgressBar | None = None) -> None:
        self._file = file
        self._progress = progress
        self.errors: list[str] = []

    def write(self, text: str) -> None:
        """Print text as it is."""
        if self._progress is not None:
            self._progress.hide()
        (self._file or sys.stdout).write(text)

    def warn(self, said: str) -> None:
        """Say on standard error what is doubtful."""
        self.flush()
        line = warning(said)
        if self._file is None:
            click.echo(line, err=True)
        else:
            self.errors.append(line)

    def report(self, error: BaseException) -> None:
        """Say on standard error what went wrong."""
        if self._file is not None:
            self.errors.extend(described(error))
            return
        if self._progress is not None:
            self._progress.hide()
        report(error)

    def flush(self) -> None:
        """Let all that was printed be seen."""
        if self._file is None:
            if self._progress is not None:
                self._progress.hide()
            sys.stdout.flush()


def warning(said: str) -> str:
    """A warning as a line."""
    return visible(f"rvaft: warning: {said}")


@dataclass(frozen=True, slots=True)
class OutputShape:
    """What the output of a run is about: the tree and its columns, the key, and whether traces are named."""

    tree: RVAFT
    columns: tuple[Column, ...]
    per: Per = Per.TREE
    key: Key | None = None
    several: bool = False

    @property
    def summed(self) -> bool:
        """Whether there is a summary at the end."""
        return self.several or self.key is not None


@dataclass(frozen=True, slots=True)
class SummaryRow:
    """How the monitors of one trace or key ended, for the summary; `since` are the events that made the verdicts final."""

    trace: str
    key: tuple[Json, ...] | None
    events: int
    verdicts: tuple[Verdict, ...]
    since: Mapping[int, int]
    branch: int | None
    kinds: tuple[str, ...]
    failed: bool

    @classmethod
    def of(cls, watch: MonitoredTrace, *, failed: bool) -> "SummaryRow":
        """The row of a trace that has come to its end."""
        monitors = watch.monitors
        found = monitors.explanation(0)
        branch, kinds = (None, ()) if found is None else (found.branch, tuple(sorted(map(str, found.kinds))))
        return cls(watch.trace, watch.key, watch.events, monitors.verdicts, monitors.since, branch, kinds, failed)


class Reporter(Listener):
    """Prints what it is told, to a sink."""

    def __init__(self, shape: OutputShape, sink: Sink) -> None:
        self.shape = shape
        self.sink = sink
        self.fields = told_fields(shape.tree)
        self._ends = 0

    def ends(self, change: VerdictChange) -> dict[int, Ended]:
        """For the columns that can no longer detect how their last hope ended, unless that was said of very many keys."""
        if self._ends >= ENDS:
            return {}
        ended = {column: change.watch.monitors.ended(column) for column in change.columns}
        found = {column: end for column, end in ended.items() if end is not None}
        if change.watch.key is not None and found:
            self._ends += 1
            if self._ends == ENDS:
                self.sink.warn(f"{ENDS} keys can no longer match: for others it is not said what was waited for")
        return found

    def finish(self, rows: Sequence[SummaryRow], statistics: Statistics) -> None:
        """All traces have been read, at least one of them to its end."""


class JsonReporter(Reporter):
    """One JSON object per event, and nothing else; with `detections` only for those that detect something."""

    def __init__(self, shape: OutputShape, sink: Sink, *, detections: bool = False) -> None:
        super().__init__(shape, sink)
        self.every = not detections

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:  # noqa: ARG002 (the interface)
        """Print the verdicts."""
        self._print(watch, number)

    def change(self, change: VerdictChange) -> None:
        """Print the verdicts, and how those that changed came about."""
        if self.every or change.detected:
            self._print(change.watch, change.number, change)

    def _print(self, watch: MonitoredTrace, number: int, change: VerdictChange | None = None) -> None:
        shape = self.shape
        said: dict[str, Json] = {"trace": watch.trace} if shape.several else {}
        if watch.key is not None and shape.key is not None:
            said["key"] = shape.key.told(watch.key)
        verdicts = watch.monitors.verdicts
        said |= {"event": number, "verdict": verdicts[0].value}
        if shape.per is not Per.TREE:
            said["verdicts"] = {one.label: verdict.value for one, verdict in zip(shape.columns, verdicts, strict=True)}
        if change is not None:
            if number <= self.told_before:
                said["again"] = True
            details: dict[int, dict[str, Json]] = {column: {} for column in change.columns}
            for column, explanation in change.explanations.items():
                details[column] = explained(explanation, shape.tree, change.events, self.fields)
            for column, ended in self.ends(change).items():
                details[column] = {"expected": expected(ended.pending)}
            said |= details.pop(0, {})
            if details:
                said["columns"] = {shape.columns[column].label: detail for column, detail in details.items()}
        self.sink.write(f"{json.dumps(said)}\n")


class TextReporter(Reporter):
    """A line per change of verdict with the explanation, and at the end what the traces held.

    With `drawn` each detection is followed by a drawing of the tree with the path that fired.
    """

    def __init__(self, shape: OutputShape, sink: Sink, *, drawn: bool = False) -> None:
        super().__init__(shape, sink)
        self.drawn = drawn

    def change(self, change: VerdictChange) -> None:
        """Print a change of verdict, and how it came about."""
        for line in self.lines(change, self.where(change.watch)):
            self.print(line)

    def end(self, watch: MonitoredTrace) -> None:
        """Print the last verdicts of the trace; those of keys stand in the summary."""
        if watch.key is not None:
            return
        monitors = watch.monitors
        self.print(f"{self.where(watch)}verdict {monitors.verdicts[0]} after {counted(watch.events)}")
        if len(self.shape.columns) > 1:
            rows = [("MONITOR", "VERDICT", "EVENT")]
            for place, (column, verdict) in enumerate(zip(self.shape.columns, monitors.verdicts, strict=True)):
                rows.append((column.title, str(verdict), str(monitors.since.get(place, "-"))))
            for line in aligned(rows):
                self.print(f"  {line}")

    def finish(self, rows: Sequence[SummaryRow], statistics: Statistics) -> None:
        """Print what all traces held, what looks like a mistake in them or in the tree, and how each trace or key ended."""
        for line in (*held(statistics), *(summary(self.shape, rows) if self.shape.summed else ())):
            self.print(line)

    def print(self, line: str) -> None:
        """Print one line."""
        self.sink.write(f"{visible(line)}\n")

    def where(self, watch: MonitoredTrace) -> str:
        """The trace and the key that a line is about, where there are several."""
        parts = [watch.trace] if self.shape.several else []
        if watch.key is not None and self.shape.key is not None:
            values = zip(self.shape.key.fields, watch.key, strict=True)
            parts.append(", ".join(f"{field.text}={_json(value)}" for field, value in values))
        return "".join(f"{part}: " for part in parts)

    def lines(self, change: VerdictChange, where: str = "") -> Iterator[str]:
        """A change of verdict, the matches, each once, and what was waited for in vain."""
        columns, verdicts = self.shape.columns, change.verdicts
        many = len(columns) > 1
        changed = ", ".join(f"{columns[place].title} {verdicts[place]}" for place in change.columns)
        again = " (told before)" if change.number <= self.told_before else ""
        yield f"{where}event {change.number}: {changed if many else verdicts[0]}{again}"
        for which, explanation in unlike(change.explanations):
            title = f"{', '.join(columns[place].title for place in which)}: " if many else ""
            for line in (self._drawn if self.drawn else self._explained)(explanation, change.events, title):
                yield f"  {line}"
        for place, ended in self.ends(change).items():
            title = f"  {columns[place].title}: " if many else "  "
            for record in ended.pending[:WAITING]:
                who = "" if record.branch is None else f"branch {record.branch} "
                values = ", ".join(f"{name} = {_short(value)}" for name, value in record.variables.items())
                names = [one.event if one.event == one.node else f"{one.event} ({one.node})" for one in record.awaited]
                more = " or others" if len(names) > WAITING else ""
                awaited = f"{' or '.join(names[:WAITING])}{more}{f', with {values}' if values else ''}"
                yield f"{title}{who}waited for {awaited}"
            if len(ended.pending) > WAITING:
                yield f"{title}and {len(ended.pending) - WAITING} more"

    def _explained(self, explanation: Explanation, events: Mapping[int, Json], title: str) -> Iterator[str]:
        kinds = ", ".join(sorted(kind.value for kind in explanation.kinds))
        branch = "" if explanation.branch is None else f"branch {explanation.branch}"
        if head := title + ": ".join(part for part in (branch, kinds) if part):
            yield head
        tree = self.shape.tree
        for node, number in explanation.matched.items():
            label = tree.nodes[node].label if node in tree.nodes else None
            place = " (no longer known)"
            if number in events:
                known = places(events[number])
                said = [f" {word} {_short(known[it])}" for word, it in (("at", "time"), ("on", "topic")) if it in known]
                others = other_fields(node, events[number], tree, self.fields)
                more = ", ".join(f"{name} {_short(value)}" for name, value in others.items())
                place = "".join(said) + (f" with {more}" if more else "")
            yield f"event {number}{place} is {node}{f' ({label})' if label else ''}"
        for variable, value in variables(explanation, tree).items():
            yield f"{variable} = {_json(value)}"

    def _drawn(self, explanation: Explanation, events: Mapping[int, Json], title: str) -> Iterator[str]:
        """The same as a drawing."""
        from rvaft.export import fired_text  # noqa: PLC0415 -- imported on use

        yield from filter(None, [title.strip(), *fired_text(self.shape.tree, explanation, events).splitlines()])


class TableReporter(TextReporter):
    """For each trace a table with a row per event and a column per verdict, as Tables 2 and 3 of the paper, and how the verdicts came about."""

    every = True

    def begin(self, watch: MonitoredTrace) -> None:  # noqa: ARG002 (the interface)
        """A table for the trace."""
        self._rows: list[tuple[str, ...]] = [("EVENT", *(column.title for column in self.shape.columns))]
        self._left_out = 0
        self._reasons: list[str] = []

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """A row for the event."""
        if number > MOST:
            self._left_out += 1
        else:
            self._add_row(watch, event)

    def change(self, change: VerdictChange) -> None:
        """A row for the event, and how it changed a verdict."""
        self._note_left_out()
        self._add_row(change.watch, change.event)
        self._reasons += self.lines(change)

    def end(self, watch: MonitoredTrace) -> None:
        """Print the table."""
        self._note_left_out()
        if self.shape.several:
            self.print(watch.trace)
        for line in (*aligned(self._rows), *self._reasons):
            self.print(line)

    def stop(self, watch: MonitoredTrace) -> None:
        """Print the table as far as it goes."""
        if len(self._rows) > 1:
            self.end(watch)

    def finish(self, rows: Sequence[SummaryRow], statistics: Statistics) -> None:
        """Nothing more is printed."""

    def _add_row(self, watch: MonitoredTrace, event: Json) -> None:
        self._rows.append((_json(event), *(verdict.symbol for verdict in watch.monitors.verdicts)))

    def _note_left_out(self) -> None:
        if self._left_out:
            self._rows.append((f"({self._left_out} more)", *("" for _ in self.shape.columns)))
            self._left_out = 0


# -- the end ------------------------------------------------------------------------------------------------------------


def held(statistics: Statistics) -> Iterator[str]:
    """What all traces held, and what looks like a mistake in them or in the tree."""
    names, counts, never = statistics.names, statistics.relevant, statistics.never_seen
    listed = [name for name in names if len(names) <= TYPES or counts[name]]
    zero = [f"{len(names) - len(listed)} other types 0"] if len(listed) < len(names) else []
    relevant = ", ".join([*(f"{name} {counts[name]}" for name in listed), *zero])
    yield f"events read: {statistics.events}; relevant: {relevant or 'none'}"
    yield from (f"warning: no event of type {name}" for name in never[:TYPES])
    if len(never) > TYPES:
        yield f"warning: {len(never) - TYPES} other types never seen"
    for miss in statistics.near_misses.values():
        has = "is missing" if miss.found is None else f"is {miss.found}, not {miss.expected}"
        count = f"{'at least ' if miss.more else ''}{counted(miss.count)}"
        would = f"{count} would be {miss.type} but for the field {'.'.join(miss.field)}"
        yield f"warning: near miss: {would}, which {has} (first: {miss.first})"


def summary(shape: OutputShape, rows: Sequence[SummaryRow]) -> Iterator[str]:
    """How each trace and each key ended, a row for each; where there are very many, for those worth a look."""
    worth = [row for row in rows if len(rows) <= ALL or row.failed or Verdict.TRUE in row.verdicts]
    shown = list(islice(worth, MOST))
    keys = [] if shape.key is None else [field.text for field in shape.key.fields]
    headings = [*(["TRACE"] if shape.several else []), *keys]
    verdicts = [column.title for column in shape.columns] if 1 < len(shape.columns) <= WIDE else ["VERDICT", "EVENT"]
    detected = ["DETECTED"] if len(shape.columns) > WIDE else []
    table = [(*headings, "EVENTS", *verdicts, "BRANCH", "KINDS", *detected, "")]
    table += [tuple(_cells(shape, row)) for row in shown]
    yield from aligned(table)
    if len(shown) < len(rows):
        known = set(map(id, shown))
        hidden = [row.verdicts[0] for row in rows if id(row) not in known]
        counts = ((verdict, hidden.count(verdict)) for verdict in Verdict)
        rest = ", ".join(f"{count} {verdict}" for verdict, count in counts if count)
        yield f"and {len(hidden)} more: {rest}"


def _cells(shape: OutputShape, row: SummaryRow) -> Iterator[str]:
    if shape.several:
        yield row.trace
    if shape.key is not None:
        yield from ("" for _ in shape.key.fields) if row.key is None else map(_json, row.key)
    yield str(row.events)
    if 1 < len(shape.columns) <= WIDE:
        for place, verdict in enumerate(row.verdicts):
            yield f"{verdict} {row.since[place]}" if place in row.since else str(verdict)
    else:
        yield str(row.verdicts[0])
        yield str(row.since.get(0, "-"))
    yield "-" if row.branch is None else str(row.branch)
    yield ", ".join(row.kinds) or "-"
    if len(shape.columns) > WIDE:
        # The columns beside the first that were detected, each with its event.
        found = [place for place, verdict in enumerate(row.verdicts) if place and verdict is Verdict.TRUE]
        first = ", ".join(f"{shape.columns[place].title} {row.since[place]}" for place in found[:3])
        yield f"{first} and {len(found) - 3} more" if len(found) > 3 else first or "-"
    yield "error" if row.failed else ""


def _json(value: Json) -> str:
    return json.dumps(value, ensure_ascii=False)


def _short(value: Json) -> str:
    text = value if isinstance(value, str) else _json(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"
