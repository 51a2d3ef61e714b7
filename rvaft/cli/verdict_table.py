"""What `rvaft monitor --format table` prints: the events as rows, the verdicts as columns, as Tables 2 and 3 of the paper do."""

import json
from collections.abc import Sequence
from typing import ClassVar, Final

from rvaft.cli.sink import Sink
from rvaft.cli.verdict_text import Text
from rvaft.cli.verdicts import Row, Shape
from rvaft.monitoring.totals import Totals
from rvaft.monitoring.watch import Watch
from rvaft.printable import columns
from rvaft.values import Json

_ALL: Final = 1_000
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
        if number > _ALL and not changed:
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
        for line in (*columns(self._rows), *self._reasons):
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
