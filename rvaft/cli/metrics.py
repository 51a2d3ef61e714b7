"""`--metrics FILE`: counts of a run for Prometheus, in the text format that its node exporter collects."""

from collections.abc import Sequence
from pathlib import Path
from time import monotonic, time
from typing import Final

from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.stream.listeners import Listener
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.support.files import write_whole

PERIOD: Final = 5.0
"""Seconds between two versions of the file."""
_HELP: Final = {
    "rvaft_events_total": ("counter", "Events read."),
    "rvaft_detections_total": ("counter", "Detections reported."),
    "rvaft_last_detection_timestamp_seconds": (
        "gauge",
        "When the last detection was made, by the clock of the machine.",
    ),
    "rvaft_traces": ("gauge", "Traces and keys that are monitored."),
    "rvaft_running": ("gauge", "1 while events are read, 0 at the end."),
}


class MetricsFile:
    """The counts of all trees of a run, written to a file every few seconds and at the end."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._values: dict[tuple[str, str], float] = {}
        self._due = 0.0

    def of(self, tree: str) -> "TreeMetrics":
        """Return the listener that counts for a tree."""
        return TreeMetrics(self, tree)

    def put(self, name: str, tree: str, value: float) -> None:
        """Set a value, and write the file if it is time to."""
        self._values[name, tree] = value
        if monotonic() >= self._due:
            self.write()

    def write(self) -> None:
        """Write the file at once; raises `OSError`."""
        self._due = monotonic() + PERIOD
        write_whole(self._path, self.text.encode())

    @property
    def text(self) -> str:
        """The text in the format of Prometheus."""
        lines: list[str] = []
        for name, (kind, what) in _HELP.items():
            rows = [(tree, value) for (one, tree), value in self._values.items() if one == name]
            if rows:
                lines += [f"# HELP {name} {what}", f"# TYPE {name} {kind}"]
                lines += [f'{name}{{tree="{_escaped(tree)}"}} {value:.17g}' for tree, value in rows]
        return "\n".join([*lines, ""])


class TreeMetrics(Listener):
    """Counts the events and detections of one tree."""

    every = True
    each_key = False

    def __init__(self, file: MetricsFile, tree: str) -> None:
        self._file, self._tree = file, tree
        self._events = self._detections = self._watches = 0

    def begin(self, watch: MonitoredTrace) -> None:  # noqa: ARG002
        """Count a trace or key."""
        self._watches += 1
        self._file.put("rvaft_traces", self._tree, self._watches)
        self._file.put("rvaft_running", self._tree, 1)

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:  # noqa: ARG002
        """Count an event."""
        self._count(1)

    def events(self, watch: MonitoredTrace, first: int, last: int, verdicts: Sequence[Verdict]) -> None:  # noqa: ARG002
        """Count a range of events."""
        self._count(last - first + 1)

    def change(self, change: VerdictChange) -> None:
        """Count an event that changed a verdict."""
        if 0 in change.detected:
            self._detections += 1
            self._file.put("rvaft_last_detection_timestamp_seconds", self._tree, time())
            self._file.put("rvaft_detections_total", self._tree, self._detections)
        self._count(not change.passed)

    def _count(self, events: int) -> None:
        self._events += events
        self._file.put("rvaft_events_total", self._tree, self._events)
        self._file.put("rvaft_detections_total", self._tree, self._detections)

    def end(self, watch: MonitoredTrace) -> None:  # noqa: ARG002
        """Note the end of a trace."""
        self._file.put("rvaft_running", self._tree, 0)

    stop = end


def _escaped(label: str) -> str:
    return label.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
