"""The output of `rvaft monitor` as text, a table, or a JSON object per event."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Final, NamedTuple, TextIO

import click

from rvaft.cli import described
from rvaft.model.event_time import UNITS
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Ended, Explanation
from rvaft.stream import detection
from rvaft.stream.checkpoint import CheckpointFile
from rvaft.stream.detection_commands import Hooks
from rvaft.stream.listeners import Listener
from rvaft.stream.monitor_set import DetectionCount, MonitorSet, Per
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from rvaft.stream.statistics import OTHERS, Statistics
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.stream.whole_log import QueryEngine
from rvaft.support.terminal import ProgressBar, columns, cut, readable_json, takes_colour, visible
from rvaft.support.wording import counted

if TYPE_CHECKING:
    from rvaft.cli.monitor_risk import RiskListener
    from rvaft.cli.native_run import NativeRun
    from rvaft.diagnosis.recent_events import RecentEvents

ENDS: Final = 1_000
"""Maximum number of keys whose missing events are listed, which takes time."""
ALL: Final = 100
"""Maximum number of rows in a full summary; then only detections and errors have one."""
MOST: Final = 1_000
"""Maximum number of rows of a summary, and of events without a change in a table."""
WIDE: Final = 8
"""Maximum number of monitors with a column in the summary."""
TYPES: Final = 20
WAITING: Final = 10
"""Maximum number of branches with listed missing events."""
LISTED: Final = 20
FEW: Final = 3
"""Maximum number of trees that a line names."""
AFRESH: Final = (
    "each log is monitored afresh, so a match that begins in one and ends in another is not found ({what}); to "
    "monitor them as one, join them in the order of time, as with cat LOG... | rvaft monitor TREE"
)
"""The note on several logs that may be parts of one."""


class DrawnLine(str):
    """A line of a drawing, in which hidden characters are escaped; it may have colours."""

    __slots__ = ()


class Sink:
    """The destination of a run's output: standard output and error, or a file and a list of error
    lines that another process passes on.
    """

    def __init__(self, file: TextIO | None = None, progress: ProgressBar | None = None) -> None:
        self._file = file
        self._progress = progress
        self.errors: list[str] = []
        self.kept: list[str] | None = None

    def write(self, text: str) -> None:
        """Write text unchanged."""
        if self._progress is not None:
            self._progress.hide()
        (self._file or sys.stdout).write(text)

    def line(self, *lines: str) -> None:
        """Write lines with control characters escaped."""
        plain = "".join(lines).isprintable()
        shown = lines if plain else [one if isinstance(one, DrawnLine) else visible(one) for one in lines]
        self.write("".join([f"{line}\n" for line in shown]))

    @property
    def takes_colour(self) -> bool:
        """Whether lines may have colours."""
        return self._file is None and takes_colour(sys.stdout)

    def flush(self) -> None:
        """Flush standard output."""
        if self._file is None:
            self.write("")
            sys.stdout.flush()

    def warn(self, message: str) -> None:
        """Print a warning on standard error."""
        self._say([visible(f"rvaft: warning: {message}")])

    def report(self, error: BaseException) -> None:
        """Print an error on standard error."""
        self._say(described(error))

    def _say(self, lines: Sequence[str]) -> None:
        self.errors += lines
        if self.kept is not None:
            self.kept += lines
        self.pass_on()

    def pass_on(self) -> None:
        """Print the collected error lines, after the pending output."""
        if self._file is None and self.errors:
            self.flush()
            click.echo("\n".join(self.errors), err=True)
            self.errors.clear()


@dataclass(frozen=True, slots=True)
class MonitorSettings:
    """How all traces are run and reported; `name` is the tree's name.

    With `several`, lines name their trace. `unchosen`: the semantics is the default. With
    `detections` only detections are printed; with `drawn` they are drawn in the text, and with `near` the text
    ends with near misses. The first detection is drawn to the file `drawing`. With `many`, it is
    one of several trees, which lines name.
    """

    plan: MonitoringPlan
    tree: RVAFT
    name: str
    per: Per
    several: bool
    form: str
    detections: bool
    drawn: bool
    near: bool
    drawing: str | None
    hooks: Hooks
    checkpoints: CheckpointFile | None
    follow: bool
    clock: int | None = None
    """The period in nanoseconds in which monitors are told the time, if they are."""
    complete: bool = False
    """Whether the end of a log decides what waits."""
    engine: QueryEngine | None = None
    native: "NativeRun | None" = None
    unchosen: bool = False
    template: str | None = None
    others: Sequence[Listener] = ()
    risk: "RiskListener | None" = None
    """What follows the risk, and notifies no reporter: these ask it."""
    many: bool = False

    @property
    def of_tree(self) -> str:
        """The prefix of messages about the tree, if there are several."""
        return f"{self.name}: " if self.many else ""

    def of_trace(self, name: str) -> str:
        """Return the prefix of the numbers of events of a trace, if there are several."""
        return f"{name}: " if self.several else ""

    @property
    def summed(self) -> bool:
        """Whether a summary is printed at the end."""
        return self.many or self.several or self.plan.key is not None

    def key(self, watch: MonitoredTrace) -> dict[str, Json]:
        """The key of a monitored trace as JSON output has it."""
        return {} if watch.key is None or self.plan.key is None else {"key": self.plan.key.as_json(watch.key)}


class SummaryRow(NamedTuple):
    """The final state of the monitors of one trace or key.

    `since` has the events that made the verdicts final, `found` the counts of detections.
    """

    trace: str
    key: tuple[Json, ...] | None
    events: int
    verdicts: tuple[Verdict, ...]
    since: Mapping[int, int]
    found: Sequence[DetectionCount]
    explanation: Explanation | None
    failed: bool

    @classmethod
    def of(cls, watch: MonitoredTrace, *, failed: bool) -> "SummaryRow":
        """Return the row of a trace that has ended."""
        own = watch.monitors
        how = own.explanation(0) or own.found[0].explanation
        return cls(watch.trace, watch.key, watch.events, own.verdicts, own.since, own.found, how, failed)


class Reporter(Listener):
    """Prints verdicts to a sink, and with `sums` a summary."""

    sums = False
    together = True
    """Whether several trees end with one summary."""

    def __init__(self, settings: MonitorSettings, sink: Sink) -> None:
        self.settings = settings
        self.columns = settings.plan.monitors.columns
        self.sink = sink
        self.fields = detection.identifying_fields(settings.tree)
        self.listed = 0
        """The number of keys whose missing events were listed."""
        self.totals: Totals | None = None
        self.risk = settings.risk
        self.every = self.every or self.risk is not None
        self.whole = self.whole or self.risk is not None

    def risks(self, watch: MonitoredTrace) -> dict[str, Json]:
        """Return the risks for JSON, and what raises that of the tree most."""
        if self.risk is None:
            return {}
        found: dict[str, Json] = {"risk": self.risk.of(watch)[0]}
        if len(self.columns) > 1:
            found["risks"] = {one.label: risk for one, risk in zip(self.columns, self.risk.of(watch), strict=True)}
        return found | (self.risk.coming(watch) if self.risk.changed(watch) else {})

    def ends(self, change: VerdictChange) -> dict[int, Ended]:
        """Return why columns can no longer detect, for up to `ENDS` keys."""
        if self.listed >= ENDS:
            return {}
        ended = {column: change.watch.monitors.ended(column) for column in change.columns}
        found = {column: end for column, end in ended.items() if end is not None}
        if change.watch.key is not None and found:
            self.listed += 1
            if self.listed == ENDS:
                self.sink.warn(f"{ENDS} keys can no longer match: missing events are not listed for further keys")
        return found

    def pause(self, run: TraceRun) -> None:
        """Called between batches, and regularly while no events come."""

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:
        """Called after all traces, if at least one was read to its end."""
        doubts, semantics_hint = totals.data_warnings.lines, totals.semantics_hint
        if self.sums and totals.statistics is not None:
            meant = [f"note: {semantics_hint.line}"] if semantics_hint is not None and semantics_hint.line else []
            summed = _summary([(self.settings, rows)]) if self.settings.summed else ()
            afresh = (f"note: {line}" for line in read_afresh(rows))
            lines = *held(totals.statistics), *meant, *afresh, *summed, *(f"warning: {line}" for line in doubts)
            self.sink.line(*lines)
        else:
            for line in (*read_afresh(rows), *doubts):
                self.sink.warn(line)


class _JsonLines(Reporter):
    """Prints a JSON object per event, or per detection."""

    each_key = False

    def __init__(self, settings: MonitorSettings, sink: Sink) -> None:
        super().__init__(settings, sink)
        self.every = not settings.detections
        self._alike: tuple[object, ...] = ()
        """The last event without a change: trace, verdicts, and its line around the event
        number.
        """

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:  # noqa: ARG002
        if self.risk is None:
            self.events(watch, number, number, watch.monitors.verdicts)
        else:
            record = self._record(watch, number, watch.monitors.verdicts) | self.risks(watch)
            self.sink.write(f"{json.dumps(record)}\n")

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:
        if self._alike[:2] != (watch, verdicts):
            # monitors of different keys may have equal verdicts
            before, after = json.dumps(self._record(watch, 0, verdicts)).rsplit('"event": 0, "verdict": ', 1)
            self._alike = watch, verdicts, f'{before}"event": ', f', "verdict": {after}\n'
        _, _, head, tail = self._alike
        self.sink.write(f"{head}{f'{tail}{head}'.join(map(str, range(first, last + 1)))}{tail}")

    def _record(self, watch: MonitoredTrace, number: int, verdicts: Sequence[Verdict]) -> dict[str, Json]:
        record: dict[str, Json] = {"tree": self.settings.name} if self.settings.many else {}
        record |= {"trace": watch.trace} if self.settings.several else {}
        record |= {**self.settings.key(watch), "event": number, "verdict": verdicts[0].value}
        if self.settings.per is not Per.TREE:
            record["verdicts"] = {one.label: verdict.value for one, verdict in zip(self.columns, verdicts, strict=True)}
        return record

    def change(self, change: VerdictChange) -> None:
        if not self.every and not change.detected:
            return
        record = {**self._record(change.watch, change.number, change.verdicts), "line": change.line}
        record |= {"passed": change.passed} if change.passed else {}
        record |= self.risks(change.watch)
        if change.number <= self.reported_before:
            record["again"] = True
        details: dict[int, dict[str, Json]] = {column: {} for column in change.columns}
        for column, count in change.counts.items():
            details[column] |= count.fields
        for column, explanation in change.explanations.items():
            details[column] |= detection.explained(
                explanation, self.settings.tree, change.events, self.fields, change.lines
            )
        for column, ended in self.ends(change).items():
            details[column] = {"expected": detection.expected(ended.pending)}
        record |= details.pop(0, {})
        if details:
            record["columns"] = {self.columns[column].label: detail for column, detail in details.items()}
        self.sink.write(f"{json.dumps(record)}\n")


class _Text(Reporter):
    """Prints a line per change of the verdict, and a summary.

    With `drawn` each detection is drawn as the tree with the matched nodes.
    """

    each_key = False
    sums = True

    def __init__(self, settings: MonitorSettings, sink: Sink) -> None:
        super().__init__(settings, sink)
        self._recent = _recent_events() if settings.near else None
        self.concerned = settings.near

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        if self._recent is not None:
            self._recent.event(watch, number, event)
        if self.risk is not None and self.risk.changed(watch):
            self.sink.line(f"{self.where(watch)}event {number}: {self._risk(watch)}")

    def change(self, change: VerdictChange) -> None:
        if self._recent is not None:
            self._recent.change(change)
        self.sink.line(*self.lines(change, self.where(change.watch)))

    def _risk(self, watch: MonitoredTrace) -> str:
        """Return the risk in words."""
        assert self.risk is not None
        risks = self.risk.of(watch)
        parts = [f"{one.title} {risk:.6g}" for one, risk in zip(self.columns, risks, strict=True)][1:]
        outlook = self.risk.outlook(watch)
        values = "".join(f", {name} = {_short(value)}" for name, value in outlook.values.items())
        coming = f"; {outlook.next[0].leaf} would raise it to {outlook.next[0].risk:.6g}" if outlook.next else ""
        return (
            f"risk {risks[0]:.6g} within {self.risk.horizon.text}{''.join(f', {one}' for one in parts)}{values}{coming}"
        )

    def end(self, watch: MonitoredTrace) -> None:
        if watch.key is not None or self.settings.many:
            return
        verdicts, since, found = watch.monitors.verdicts, watch.monitors.since, watch.monitors.found
        repeat, ended = watch.monitors.repeat, f"verdict {verdicts[0]} after {counted(watch.events)}"
        if repeat:
            last = f", the last at event {found[0].last}" if found[0].notified else ""
            final = f"; false since event {since[0]}" if 0 in since else ""
            ended = f"{counted(found[0].notified, 'detection')} in {counted(watch.events)}{last}{final}"
        if self.risk is not None and not verdicts[0].final:
            ended += f"; risk {self.risk.of(watch)[0]:.6g} within {self.risk.horizon.text}"
        self.sink.line(f"{self.where(watch)}{ended}")
        if len(self.columns) > 1:
            rows = [(one.title, *_ended(watch.monitors, at, repeat=repeat)) for at, one in enumerate(self.columns)]
            for line in columns([("MONITOR", *_ENDS[repeat]), *rows]):
                self.sink.line(f"  {line}")

    def finish(self, rows: Sequence[SummaryRow], totals: Totals) -> None:
        """Print the near misses of traces and keys without a detection, and the summary."""
        closest = None if self._recent is None else self._recent.closest()
        if closest is not None and closest.found:
            lines = (f"  {self.where(watch)}{line}" for watch, _, line in closest.found)
            self.sink.line(f"{self.settings.of_tree}near misses, closest first:", *lines)
            self.sink.line(*(f"note: {note}" for note in closest.notes))
        super().finish(rows, totals)

    def where(self, watch: MonitoredTrace) -> str:
        """Return the prefix with tree, trace and key, if there are several."""
        parts = [self.settings.name] if self.settings.many else []
        parts += [watch.trace] if self.settings.several else []
        if watch.key is not None and self.settings.plan.key is not None:
            values = zip(self.settings.plan.key.fields, watch.key, strict=True)
            parts.append(", ".join(f"{field.text}={_json(value)}" for field, value in values))
        return "".join(f"{part}: " for part in parts)

    def lines(self, change: VerdictChange, where: str = "") -> Iterator[str]:
        """Yield the lines for a change: verdicts, matches, and missing events."""
        titles, verdicts = [column.title for column in self.columns], change.verdicts
        many = len(titles) > 1
        new_verdicts = {place: f"{verdicts[place]}{_numbered(change.counts.get(place))}" for place in change.columns}
        changed = ", ".join(f"{titles[place]} {verdict}" for place, verdict in new_verdicts.items())
        again = " (reported before)" if change.number <= self.reported_before else ""
        at = _line(change.number, change.line)
        passed = f" ({change.passed})" if change.passed else ""
        yield f"{where}event {change.number}{at}{passed}: {changed if many else new_verdicts[0]}{again}"
        for which, explanation in detection.unlike(change.explanations):
            title = f"{', '.join(titles[place] for place in which)}: " if many else ""
            if self.settings.drawn:
                from rvaft.export.drawing import fired_text  # noqa: PLC0415 -- imported on use

                colour = self.sink.takes_colour
                drawing = fired_text(self.settings.tree, explanation, change.events, colour=colour)
                yield from [f"  {title.strip()}"] if title.strip() else []
                yield from (DrawnLine(f"  {line}") for line in drawing.splitlines() if line)
            else:
                yield from (f"  {line}" for line in self._explained(explanation, change, title))
        for place, ended in self.ends(change).items():
            title = f"  {titles[place]}: " if many else "  "
            for record in ended.pending[:WAITING]:
                who = "" if record.branch is None else f"branch {record.branch} "
                values = ", ".join(f"{name} = {_short(value)}" for name, value in record.variables.items())
                names = [one.event if one.event == one.node else f"{one.event} ({one.node})" for one in record.awaited]
                names += [f"no {one.event} ({one.node})" for one in record.absent]
                more = " or others" if len(names) > WAITING else ""
                awaited = f"{' or '.join(names[:WAITING])}{more}{f', with {values}' if values else ''}"
                yield f"{title}{who}waited for {awaited}"
            if len(ended.pending) > WAITING:
                yield f"{title}and {len(ended.pending) - WAITING} more"

    def _explained(self, explanation: Explanation, change: VerdictChange, title: str) -> Iterator[str]:
        events = change.events
        kinds = ", ".join(sorted(kind.value for kind in explanation.kinds))
        branch = "" if explanation.branch is None else f"branch {explanation.branch}"
        if head := title + ": ".join(part for part in (branch, kinds) if part):
            yield head
        tree = self.settings.tree
        for node, numbers in explanation.events.items():
            label, number = tree.nodes[node].label if node in tree.nodes else None, numbers[-1]
            place = " (no longer stored)"
            line = _line(number, change.lines.get(number))
            if number in events:
                known = detection.places(events[number], tree)
                if isinstance(known.get("time"), Mapping) and tree.time and (time := tree.time.read(events[number])):
                    known["time"] = f"{time // UNITS['s']}.{time % UNITS['s']:09}"
                place = f" at {_short(known['time'])}" if "time" in known else ""
                place += f" on {_short(known['topic'])}" if "topic" in known else ""
                if others := detection.other_fields(node, events[number], tree, self.fields):
                    place += f" with {', '.join([f'{name} {_short(value)}' for name, value in others.items()])}"
            earlier = "event "
            if len(numbers) > 1:
                shown = [f"{one}{_line(one, change.lines.get(one))}" for one in numbers[:LISTED]]
                shown = [*shown, *["…"] * (len(numbers) > LISTED + 1)][: len(numbers) - 1]
                earlier = f"events {', '.join(shown)} and "
            is_ = "is" if len(numbers) == 1 else "are"
            yield f"{earlier}{number}{line}{place} {is_} {node}{f' ({label})' if label else ''}"
        for absence in explanation.absences:
            yield f"{absence.text} ({absence.node})"
        for variable, value in explanation.bound(tree).items():
            yield f"{variable} = {_json(value)}"


class _Table(_Text):
    """Prints a table per trace: events in rows, verdicts in columns (Tables 2 and 3 of the
    paper).
    """

    every, whole, sums, each_key = True, True, False, True

    def begin(self, watch: MonitoredTrace) -> None:  # noqa: ARG002
        risk = () if self.risk is None else ("RISK", *(f"RISK {column.title}" for column in self.columns[1:]))
        self._rows: list[tuple[str, ...]] = [("EVENT", *(column.title for column in self.columns), *risk)]
        self._left_out = 0
        self._reasons: list[str] = []

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        if number > MOST:
            self._left_out += 1
        else:
            risk = () if self.risk is None else [f"{one:.6g}" for one in self.risk.of(watch)]
            self._rows.append((_json(event), *(verdict.symbol for verdict in watch.monitors.verdicts), *risk))

    def change(self, change: VerdictChange) -> None:
        self._note_left_out()
        self.event(change.watch, 0, change.event)
        self._reasons += self.lines(change)

    def end(self, watch: MonitoredTrace) -> None:
        self._note_left_out()
        for line in (*([watch.trace] if self.settings.several else []), *columns(self._rows), *self._reasons):
            self.sink.line(line)

    def stop(self, watch: MonitoredTrace) -> None:
        if len(self._rows) > 1:
            self.end(watch)

    def _note_left_out(self) -> None:
        if self._left_out:
            self._rows.append((f"({self._left_out} more)", *("" for _ in self._rows[0][1:])))
            self._left_out = 0


def _recent_events() -> "RecentEvents":
    from rvaft.diagnosis.recent_events import RecentEvents  # noqa: PLC0415 -- imported on use

    return RecentEvents()


REPORTERS: Final = {"text": _Text, "table": _Table, "jsonl": _JsonLines}


def read_afresh(rows: Sequence[SummaryRow]) -> Iterator[str]:
    """Yield that no match spans two traces, if there are several and one of them may be continued."""
    traces = {row.trace for row in rows if not row.failed}
    unknown = {row.trace for row in rows if row.verdicts[0] is Verdict.UNKNOWN and not row.failed}
    if len(traces) > 1 and unknown:
        yield AFRESH.format(what=f"{len(unknown)} of {len(traces)} end unknown")


def finish_together(reporters: Sequence[Reporter], rows: Sequence[Sequence[SummaryRow]]) -> None:
    """Print the summary of several trees; `rows` has those of each."""
    first, lines, doubts = reporters[0], dict[str, list[str]](), dict[str, list[str]]()
    events = 0
    for reporter in reporters:
        totals, own = reporter.totals, list[str]()
        assert totals is not None
        if totals.statistics is not None:
            events = max(events, totals.statistics.events)
            own += [f"relevant: {relevant(totals.statistics)}"] if len(reporters) <= WIDE else []
            own += doubtful(totals.statistics)
        if totals.semantics_hint is not None and totals.semantics_hint.line:
            own.append(f"note: {totals.semantics_hint.line}")
        for line in own:
            lines.setdefault(line, []).append(reporter.settings.name)
        for line in totals.data_warnings.lines:
            doubts.setdefault(line, []).append(reporter.settings.name)
    afresh = list(read_afresh([row for some in rows for row in some]))
    if first.sums:
        summed = _summary([(reporter.settings, some) for reporter, some in zip(reporters, rows, strict=True)])
        first.sink.line(
            f"trees: {len(reporters)}; events read: {events}",
            *_named(lines, len(reporters)),
            *(f"note: {line}" for line in afresh),
            *summed,
            *(f"warning: {line}" for line in _named(doubts, len(reporters))),
        )
    else:
        for line in (*afresh, *_named(doubts, len(reporters))):
            first.sink.warn(line)


def _named(lines: Mapping[str, Sequence[str]], trees: int) -> Iterator[str]:
    """Yield lines with the trees that they are about, at most `MOST`."""
    for line, names in islice(lines.items(), MOST):
        more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
        whose = "all trees" if len(names) == trees else f"{', '.join(names[:FEW])}{more}"
        label = next((one for one in ("warning: ", "note: ") if line.startswith(one)), "")
        yield f"{label}{whose}: {line.removeprefix(label)}"
    if len(lines) > MOST:
        yield f"and {len(lines) - MOST} more lines about trees"


def held(statistics: Statistics) -> Iterator[str]:
    """Yield the counts by event type, missing types and near misses."""
    yield f"events read: {statistics.events}; relevant: {relevant(statistics)}"
    yield from doubtful(statistics)


def relevant(statistics: Statistics) -> str:
    """Return the numbers of relevant events by type."""
    names, counts = statistics.names, statistics.relevant
    listed = [name for name in names if len(names) <= TYPES or counts[name]]
    zero = [f"{len(names) - len(listed)} other types 0"] if len(listed) < len(names) else []
    return ", ".join([*(f"{name} {counts[name]}" for name in listed), *zero]) or "none"


def doubtful(statistics: Statistics) -> Iterator[str]:
    """Yield missing event types and near misses."""
    never = statistics.never_seen
    yield from (f"warning: no event of type {name}" for name in never[:TYPES])
    if len(never) > TYPES:
        yield f"warning: {len(never) - TYPES} other types never seen"
    calls = statistics.never_called
    if calls:
        more = f" and {len(calls) - TYPES} more" if len(calls) > TYPES else ""
        yield f"warning: no event fits {', '.join(calls[:TYPES])}{more}"
    for field, values in statistics.others.items() if never or calls else ():
        if values:
            more = ", ..." if len(values) >= OTHERS else ""
            yield f"note: other events of the log have {field} {', '.join(map(_json, values))}{more}"
    for miss in statistics.near_misses.values():
        has = "is missing" if miss.found is None else f"is {miss.found}, not {miss.expected}"
        count = f"{'at least ' if miss.more else ''}{counted(miss.count)}"
        would = f"{count} would be {miss.type} but for the field {'.'.join(miss.field)}"
        yield f"warning: near miss: {would}, which {has} (first: {miss.first})"


def _summary(of_trees: Sequence[tuple[MonitorSettings, Sequence[SummaryRow]]]) -> Iterator[str]:
    """Yield a table with a row for each tree, trace and key."""
    settings = of_trees[0][0]
    fields = () if settings.plan.key is None else settings.plan.key.fields
    titles = [column.title for column in settings.plan.monitors.columns]
    repeat, many = settings.plan.monitors.repeat, settings.many
    each = 1 < len(titles) <= WIDE and not many
    verdicts = titles if each else _ENDS[repeat]
    parts = any(len(one.plan.monitors.columns) > (1 if many else WIDE) for one, _ in of_trees)
    tree, trace, detected = ["TREE"] * many, ["TRACE"] * settings.several, ["DETECTED"] * parts
    names = [*tree, *trace, *(field.text for field in fields)]
    table = [[*names, "EVENTS", *verdicts, "BRANCH", "KINDS", *detected, ""]]
    rows = [(one, row) for one, some in of_trees for row in some]
    hidden: list[Verdict] = []
    for own, row in rows:
        detections = [at for at, count in enumerate(row.found) if count.notified]
        if len(table) > MOST or not (len(rows) <= ALL or row.failed or detections):
            hidden.append(row.verdicts[0])
            continue
        cells = [*([own.name] if many else []), *([row.trace] if settings.several else [])]
        cells += ["" for _ in fields] if row.key is None else map(_json, row.key)
        cells.append(str(row.events))
        if each:
            ends = [f"{one} {row.since.get(at, '')}".rstrip() for at, one in enumerate(row.verdicts)]
            cells += [f"{one.notified}, last {one.last}" if one.last else "0" for one in row.found] if repeat else ends
        else:
            cells += _ended(row, 0, repeat=repeat)
        branch, kinds = (None, []) if row.explanation is None else (row.explanation.branch, row.explanation.kinds)
        cells += ["-" if branch is None else str(branch), ", ".join(sorted(kinds)) or "-"]
        if parts:
            labels = [column.title for column in own.plan.monitors.columns]
            found = [at for at in detections if at]
            first = ", ".join(f"{labels[at]} {row.found[at].last}" for at in found[:3])
            cells.append(f"{first} and {len(found) - 3} more" if len(found) > 3 else first or "-")
        table.append([*cells, "error" if row.failed else ""])
    yield from columns(table)
    if repeat:
        yield f"detections: {sum(row.found[0].notified for _, row in rows)}"
    if hidden:
        counts = ((verdict, hidden.count(verdict)) for verdict in Verdict)
        yield f"and {len(hidden)} more: {', '.join(f'{count} {verdict}' for verdict, count in counts if count)}"


def _line(number: int, line: int | None) -> str:
    return "" if line is None or line == number else f" (line {line})"


def _numbered(count: DetectionCount | None) -> str:
    if count is None:
        return ""
    return f" (detection {count.notified}{f', {count.between} suppressed before it' if count.between else ''})"


_ENDS: Final = {True: ("DETECTIONS", "LAST", "FALSE SINCE"), False: ("VERDICT", "EVENT")}


def _ended(own: SummaryRow | MonitorSet, column: int, *, repeat: bool) -> tuple[str, ...]:
    """Return the cells of a monitor."""
    since, count = str(own.since.get(column, "-")), own.found[column]
    return (str(count.notified), str(count.last or "-"), since) if repeat else (str(own.verdicts[column]), since)


_encode: Final = readable_json


def _json(value: Json) -> str:
    is_plain = type(value) is int or (type(value) is float and value - value == 0)
    return repr(value) if is_plain else _encode(value)


def _short(value: Json) -> str:
    return cut(value if isinstance(value, str) else _json(value))
