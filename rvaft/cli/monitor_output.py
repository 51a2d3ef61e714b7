"""What `rvaft monitor` prints for people: a line per change of verdict and how it came about, and at the end what the traces held."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar, Final, Protocol, TextIO

import click

from rvaft.cli.failure import described, report
from rvaft.model.expressions import pattern_text
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitoring.explanation_json import apart, counted, expected, explained, matched_events, places, variables
from rvaft.monitoring.monitor_set import Bank, Column, Listener, Per, Totals, Watch
from rvaft.monitoring.near_misses import NearMiss
from rvaft.monitors import Awaited, Ended, Explanation, Pending
from rvaft.support.terminal import Progress, visible
from rvaft.support.terminal import columns as aligned

# Where a run of `rvaft monitor` writes: this process's own streams, or files that another process passes on later.


class Sink(Protocol):
    """What is printed, and what is said about the run."""

    def write(self, text: str) -> None:
        """Print text as it is."""

    def warn(self, said: str) -> None:
        """Say on standard error what is doubtful."""

    def report(self, error: BaseException) -> None:
        """Say on standard error what went wrong."""

    def flush(self) -> None:
        """Let all that was printed be seen."""


class Streams:
    """Standard output and standard error; the progress bar makes room for what is printed."""

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress = progress

    def write(self, text: str) -> None:
        """Print text as it is."""
        if self._progress is not None:
            self._progress.hide()
        sys.stdout.write(text)

    def warn(self, said: str) -> None:
        """Say on standard error what is doubtful."""
        self.flush()
        click.echo(warning(said), err=True)

    def report(self, error: BaseException) -> None:
        """Say on standard error what went wrong."""
        if self._progress is not None:
            self._progress.hide()
        report(error)

    def flush(self) -> None:
        """Let all that was printed be seen."""
        if self._progress is not None:
            self._progress.hide()
        sys.stdout.flush()


class Kept:
    """A file for what is printed, and the lines for standard error."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self.errors: list[str] = []

    def write(self, text: str) -> None:
        """Print text as it is."""
        self._file.write(text)

    def warn(self, said: str) -> None:
        """Keep what is doubtful."""
        self.errors.append(warning(said))

    def report(self, error: BaseException) -> None:
        """Keep what went wrong."""
        self.errors.extend(described(error))

    def flush(self) -> None:
        """Nobody looks before the end."""


def warning(said: str) -> str:
    """A warning as a line."""
    return visible(f"rvaft: warning: {said}")


# What `rvaft monitor` prints: what all forms share, and one JSON object per event.


@dataclass(frozen=True, slots=True)
class Shape:
    """What the output of a run is about: the tree and its columns, the field that is the key, and whether traces are named."""

    tree: RVAFT
    columns: tuple[Column, ...]
    per: Per = Per.TREE
    key: str | None = None
    several: bool = False


@dataclass(frozen=True, slots=True)
class Row:
    """How one watch ended, for the summary; `since` are the events that made the verdicts final."""

    trace: str
    key: tuple[Json] | None
    events: int
    verdicts: tuple[Verdict, ...]
    since: Mapping[int, int]
    branch: int | None
    kinds: tuple[str, ...]
    failed: bool

    @classmethod
    def of(cls, watch: Watch, *, failed: bool) -> "Row":
        """The row of a watch that has come to its end."""
        bank = watch.bank
        found = bank.explanation(0)
        branch, kinds = (None, ()) if found is None else (found.branch, tuple(sorted(map(str, found.kinds))))
        return cls(watch.trace, watch.key, watch.events, bank.verdicts, bank.since, branch, kinds, failed)


class Changed:
    """What there is to say about an event that changed verdicts: explanations and ends by column, and the events that they name."""

    def __init__(
        self, watch: Watch, number: int, event: Json, columns: Sequence[int], *, with_ends: bool = True
    ) -> None:
        bank = watch.bank
        self.columns = columns
        found = {column: bank.explanation(column) for column in columns}
        self.explanations: dict[int, Explanation] = {
            column: explanation for column, explanation in found.items() if explanation is not None
        }
        ended = {column: bank.ended(column) for column in columns if with_ends}
        self.ended: dict[int, Ended] = {column: end for column, end in ended.items() if end is not None}
        wanted = matched_events(self.explanations.values())
        self.events: Mapping[int, Json] = {**watch.recall.events(wanted - {number}), number: event}


_ENDS: Final = 1_000
"""Keys for which it is said what was waited for in vain: finding out takes time, and among very many keys nobody reads it."""


class Reporter(Listener):
    """Prints what it is told, to a sink."""

    def __init__(self, shape: Shape, sink: Sink) -> None:
        self.shape = shape
        self.sink = sink
        self._ends = 0

    def changed(self, watch: Watch, number: int, event: Json, columns: Sequence[int]) -> Changed:
        """What there is to say about an event that changed the verdicts of these columns."""
        changed = Changed(watch, number, event, columns, with_ends=self._ends < _ENDS)
        if watch.key is not None and changed.ended:
            self._ends += 1
            if self._ends == _ENDS:
                self.sink.warn(f"{_ENDS} keys can no longer match: for others it is not said what was waited for")
        return changed

    def finish(self, rows: Sequence[Row], totals: Totals) -> None:
        """All traces have been read, at least one of them to its end."""


class JsonLines(Reporter):
    """One object per event, and nothing else."""

    every: ClassVar[bool] = True

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Print the verdicts, and how those that changed came about."""
        said: dict[str, Json] = {"trace": watch.trace} if self.shape.several else {}
        if watch.key is not None:
            said["key"] = watch.key[0]
        verdicts = watch.bank.verdicts
        said |= {"event": number, "verdict": verdicts[0].value}
        columns = self.shape.columns
        if self.shape.per is not Per.TREE:
            said["verdicts"] = {column.label: verdict.value for column, verdict in zip(columns, verdicts, strict=True)}
        if changed:
            what = self.changed(watch, number, event, changed)
            details = {column: self._detail(what, column) for column in changed}
            said |= details.pop(0, {})
            if details:
                said["columns"] = {columns[column].label: detail for column, detail in details.items()}
        self.sink.write(f"{json.dumps(said)}\n")

    def _detail(self, changed: Changed, column: int) -> dict[str, Json]:
        if column in changed.explanations:
            return explained(changed.explanations[column], self.shape.tree, changed.events)
        return {"expected": expected(changed.ended[column].pending)} if column in changed.ended else {}


# Tables of `rvaft monitor`: how each monitor, each trace and each key ended.

_ALL: Final = 100
"""Rows up to which all are shown; beyond it those of a detection or an error."""
_MOST: Final = 1_000
"""Rows of a table."""
_WIDE: Final = 8
"""Columns up to which each has one in the table; beyond it those of a detection are listed."""
_LISTED: Final = 3
"""How many are listed."""


def columns_table(columns: Sequence[Column], bank: Bank) -> list[str]:
    """The verdict of each column, and the event that made it final."""
    rows = [("MONITOR", "VERDICT", "EVENT")]
    for place, (column, verdict) in enumerate(zip(columns, bank.verdicts, strict=True)):
        rows.append((column.title, str(verdict), str(bank.since.get(place, "-"))))
    return aligned(rows)


def summary(shape: Shape, rows: Sequence[Row]) -> Iterator[str]:
    """How each trace and each key ended, a row for each; where there are very many, for those worth a look."""
    worth = [row for row in rows if len(rows) <= _ALL or row.failed or Verdict.TRUE in row.verdicts]
    shown = list(islice(worth, _MOST))
    headings = [*(["TRACE"] if shape.several else []), *([shape.key] if shape.key is not None else [])]
    verdicts = [column.title for column in shape.columns] if 1 < len(shape.columns) <= _WIDE else ["VERDICT", "EVENT"]
    detected = ["DETECTED"] if len(shape.columns) > _WIDE else []
    table = [(*headings, "EVENTS", *verdicts, "BRANCH", "KINDS", *detected, "")]
    table += [tuple(_cells(shape, row)) for row in shown]
    yield from aligned(table)
    if len(shown) < len(rows):
        yield f"and {len(rows) - len(shown)} more: {_rest(rows, shown)}"


def _cells(shape: Shape, row: Row) -> Iterator[str]:
    if shape.several:
        yield row.trace
    if shape.key is not None:
        yield "" if row.key is None else json.dumps(row.key[0], ensure_ascii=False)
    yield str(row.events)
    if 1 < len(shape.columns) <= _WIDE:
        for place, verdict in enumerate(row.verdicts):
            yield f"{verdict} {row.since[place]}" if place in row.since else str(verdict)
    else:
        yield str(row.verdicts[0])
        yield str(row.since.get(0, "-"))
    yield "-" if row.branch is None else str(row.branch)
    yield ", ".join(row.kinds) or "-"
    if len(shape.columns) > _WIDE:
        yield _detected(shape, row)
    yield "error" if row.failed else ""


def _detected(shape: Shape, row: Row) -> str:
    """The columns beside the first that were detected, each with its event."""
    found = [place for place, verdict in enumerate(row.verdicts) if place and verdict is Verdict.TRUE]
    first = ", ".join(f"{shape.columns[place].title} {row.since[place]}" for place in found[:_LISTED])
    others = len(found) - _LISTED
    return f"{first} and {others} more" if others > 0 else first or "-"


def _rest(rows: Sequence[Row], shown: Sequence[Row]) -> str:
    known = {id(row) for row in shown}
    hidden = [row.verdicts[0] for row in rows if id(row) not in known]
    counts = ((verdict, hidden.count(verdict)) for verdict in Verdict)
    return ", ".join(f"{count} {verdict}" for verdict, count in counts if count)


_VERDICT_TEXT_LISTED: Final = 20
"""Event types that are listed one by one."""
_WAITING: Final = 10
"""Branches of which it is said what they waited for."""
_SHOWN: Final = 40
"""Characters of a value that stands beside other things."""


class Text(Reporter):
    """A line per change of verdict with the explanation, and at the end what the traces held.

    With `drawn` each detection is followed by a drawing of the tree with the path that fired.
    """

    def __init__(self, shape: Shape, sink: Sink, *, drawn: bool = False) -> None:
        super().__init__(shape, sink)
        self.drawn = drawn

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Print a change of verdict, and how it came about."""
        if changed:
            self.print(f"{self.where(watch)}event {number}: {self.verdicts(watch, changed)}")
            for line in self.reasons(self.changed(watch, number, event, changed)):
                self.print(f"  {line}")

    def end(self, watch: Watch) -> None:
        """Print the last verdicts of the trace; those of keys stand in the summary."""
        if watch.key is None:
            verdict = watch.bank.verdicts[0]
            self.print(f"{self.where(watch)}verdict {verdict} after {counted(watch.events)}")
            if len(self.shape.columns) > 1:
                for line in columns_table(self.shape.columns, watch.bank):
                    self.print(f"  {line}")

    def finish(self, rows: Sequence[Row], totals: Totals) -> None:
        """Print what all traces held, what looks like a mistake in them or in the tree, and how each trace or key ended."""
        for line in held(totals):
            self.print(line)
        if self.shape.several or self.shape.key is not None:
            for line in summary(self.shape, rows):
                self.print(line)

    def print(self, line: str) -> None:
        """Print one line."""
        self.sink.write(f"{visible(line)}\n")

    def where(self, watch: Watch) -> str:
        """The trace and the key that a line is about, where there are several."""
        parts = [watch.trace] if self.shape.several else []
        if watch.key is not None:
            parts.append(f"{self.shape.key}={_json(watch.key[0])}")
        return "".join(f"{part}: " for part in parts)

    def reasons(self, changed: Changed) -> Iterator[str]:
        """How verdicts came about: the matches, each once, and what was waited for in vain."""
        explanations = [changed.explanations.get(column) for column in changed.columns]
        for which, explanation in apart(explanations):
            columns = [changed.columns[place] for place in which]
            if self.drawn:
                yield from self._drawn(explanation, changed.events, columns)
            else:
                yield from self._explained(explanation, changed.events, columns)
        for column, ended in changed.ended.items():
            yield from self._ended(ended, column)

    def verdicts(self, watch: Watch, changed: Sequence[int]) -> str:
        """The verdicts that changed, in words."""
        verdicts, columns = watch.bank.verdicts, self.shape.columns
        if len(columns) == 1:
            return str(verdicts[0])
        return ", ".join(f"{columns[column].title} {verdicts[column]}" for column in changed)

    def _titles(self, which: Sequence[int]) -> str:
        """The columns that something is about, where there are several."""
        columns = self.shape.columns
        return f"{', '.join(columns[column].title for column in which)}: " if len(columns) > 1 else ""

    def _explained(self, explanation: Explanation, events: Mapping[int, Json], which: Sequence[int]) -> Iterator[str]:
        kinds = ", ".join(sorted(kind.value for kind in explanation.kinds))
        branch = "" if explanation.branch is None else f"branch {explanation.branch}"
        head = self._titles(which) + ": ".join(part for part in (branch, kinds) if part)
        if head:
            yield head
        tree = self.shape.tree
        for name, number in explanation.matched.items():
            label = tree.nodes[name].label if name in tree.nodes else None
            yield f"event {number}{_place(events, number)} is {name}{f' ({label})' if label else ''}"
        for variable, value in variables(explanation, tree).items():
            yield f"{variable} = {_json(value)}"

    def _drawn(self, explanation: Explanation, events: Mapping[int, Json], which: Sequence[int]) -> Iterator[str]:
        """The same as a drawing."""
        from rvaft.export import fired_text  # noqa: PLC0415 -- imported on use

        head = self._titles(which).strip()
        yield from filter(None, [head, *fired_text(self.shape.tree, explanation, events).splitlines()])

    def _ended(self, ended: Ended, column: int) -> Iterator[str]:
        title = self._titles([column])
        for record in ended.pending[:_WAITING]:
            yield f"{title}{_waited(record)}"
        if len(ended.pending) > _WAITING:
            yield f"{title}and {len(ended.pending) - _WAITING} more"


def held(totals: Totals) -> Iterator[str]:
    """What all traces held, and what looks like a mistake in them or in the tree."""
    types, counts = totals.types, totals.relevant
    listed = [name for name in types if len(types) <= _VERDICT_TEXT_LISTED or counts[name]]
    relevant = ", ".join([*(f"{name} {counts[name]}" for name in listed), *_and_others(types, listed, "0")])
    yield f"events read: {totals.events}; relevant: {relevant or 'none'}"
    never = totals.never_seen
    yield from (f"warning: no event of type {name}" for name in never[:_VERDICT_TEXT_LISTED])
    yield from (f"warning: {others}" for others in _and_others(never, never[:_VERDICT_TEXT_LISTED], "never seen"))
    yield from (f"warning: {_near(miss)}" for miss in totals.near_misses.values())


def _and_others(names: Sequence[str], listed: Sequence[str], what: str) -> list[str]:
    """The names that are not listed, as a number."""
    others = len(names) - len(listed)
    return [f"{others} other types {what}"] if others else []


def _near(miss: NearMiss) -> str:
    field = ".".join(miss.field)
    has = "is missing" if miss.found is None else f"is {miss.found}, not {pattern_text(miss.expected)}"
    least = "at least " if miss.more else ""
    would = f"{least}{counted(miss.count)} would be {miss.type} but for the field {field}"
    return f"near miss: {would}, which {has} (first: {miss.first})"


def _place(events: Mapping[int, Json], number: int) -> str:
    """When and where an event happened, in words."""
    if number not in events:
        return " (no longer known)"
    known = places(events[number])
    time = f" at {_short(known['time'])}" if "time" in known else ""
    topic = f" on {_short(known['topic'])}" if "topic" in known else ""
    return time + topic


def _waited(record: Pending) -> str:
    who = "" if record.branch is None else f"branch {record.branch} "
    values = ", ".join(f"{name} = {_short(value)}" for name, value in record.variables.items())
    awaited = " or ".join(_awaited(one) for one in record.awaited[:_WAITING])
    more = " or others" if len(record.awaited) > _WAITING else ""
    return f"{who}waited for {awaited}{more}{f', with {values}' if values else ''}"


def _awaited(awaited: Awaited) -> str:
    return awaited.event if awaited.event == awaited.node else f"{awaited.event} ({awaited.node})"


def _json(value: Json) -> str:
    return json.dumps(value, ensure_ascii=False)


def _short(value: Json) -> str:
    text = value if isinstance(value, str) else _json(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


# What `rvaft monitor --format table` prints: the events as rows, the verdicts as columns, as Tables 2 and 3 of the paper do.

_VERDICT_TABLE_ALL: Final = 1_000
"""Events up to which all have a row; of the others those that change a verdict."""


class Table(Text):
    """A table for each trace, and below it how the verdicts came about."""

    every: ClassVar[bool] = True

    def __init__(self, shape: Shape, sink: Sink, *, drawn: bool = False) -> None:
        super().__init__(shape, sink, drawn=drawn)
        self._rows: list[tuple[str, ...]] = []
        self._left_out = 0
        self._reasons: list[str] = []

    def begin(self, watch: Watch) -> None:  # noqa: ARG002 (the interface)
        """A table for the trace."""
        self._rows = [("EVENT", *(column.title for column in self.shape.columns))]
        self._left_out = 0
        self._reasons = []

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """A row for the event."""
        if number > _VERDICT_TABLE_ALL and not changed:
            self._left_out += 1
            return
        self._note_left_out()
        signs = (verdict.symbol for verdict in watch.bank.verdicts)
        self._rows.append((json.dumps(event, ensure_ascii=False), *signs))
        if changed:
            self._reasons.append(f"event {number}: {self.verdicts(watch, changed)}")
            self._reasons += (f"  {line}" for line in self.reasons(self.changed(watch, number, event, changed)))

    def end(self, watch: Watch) -> None:
        """Print the table."""
        self._note_left_out()
        if self.shape.several:
            self.print(watch.trace)
        for line in (*aligned(self._rows), *self._reasons):
            self.print(line)

    def stop(self, watch: Watch) -> None:
        """Print the table as far as it goes."""
        if len(self._rows) > 1:
            self.end(watch)

    def finish(self, rows: Sequence[Row], totals: Totals) -> None:
        """Nothing more is printed."""

    def _note_left_out(self) -> None:
        if self._left_out:
            self._rows.append((f"({self._left_out} more)", *("" for _ in self.shape.columns)))
            self._left_out = 0
