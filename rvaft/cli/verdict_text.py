"""What `rvaft monitor` prints for people: a line per change of verdict and how it came about, and at the end what the traces held."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from rvaft.cli.sink import Sink
from rvaft.cli.summary import columns_table, summary
from rvaft.cli.verdicts import Changed, Reporter, Row, Shape
from rvaft.language import pattern_text
from rvaft.monitoring.told import apart, counted, places, variables
from rvaft.monitoring.totals import Totals
from rvaft.monitoring.watch import Watch
from rvaft.monitors import Awaited, Ended, Explanation, Pending
from rvaft.printable import visible
from rvaft.statistics import NearMiss
from rvaft.values import Json

_LISTED: Final = 20
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
        from rvaft.drawing.fired import fired_text  # noqa: PLC0415 -- imported on use

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
    listed = [name for name in types if len(types) <= _LISTED or counts[name]]
    relevant = ", ".join([*(f"{name} {counts[name]}" for name in listed), *_and_others(types, listed, "0")])
    yield f"events read: {totals.events}; relevant: {relevant or 'none'}"
    never = totals.never_seen
    yield from (f"warning: no event of type {name}" for name in never[:_LISTED])
    yield from (f"warning: {others}" for others in _and_others(never, never[:_LISTED], "never seen"))
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
