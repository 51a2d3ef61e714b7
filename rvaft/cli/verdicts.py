"""What `rvaft monitor` prints: what all forms share, and one JSON object per event."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from rvaft.cli.sink import Sink
from rvaft.monitoring.columns import Column, Per
from rvaft.monitoring.told import expected, explained, matched_events
from rvaft.monitoring.totals import Totals
from rvaft.monitoring.watch import Listener, Watch
from rvaft.monitors import Ended, Explanation
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Verdict


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
