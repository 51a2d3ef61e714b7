"""What is done on detection beside saying so: commands are run, and the tree is drawn with the path that fired."""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Final

from rvaft.cli.sink import Sink
from rvaft.errors import RvaftError, ToolMissing
from rvaft.model import Kind
from rvaft.monitoring.told import apart, matched_events
from rvaft.monitoring.watch import Listener, Watch
from rvaft.monitors import Explanation
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Verdict

if TYPE_CHECKING:
    from rvaft.monitoring.hooks import Hooks

TERMINAL: Final = "-"
"""In place of a file: draw among the text."""
PICTURES: Final = ("svg", "pdf", "png")
SUFFIXES: Final = (".svg", ".dot", ".gv", ".pdf", ".png", ".txt")
"""Of the files that the path that fired is drawn to."""


@dataclass(frozen=True, slots=True)
class Detection:
    """One match that was found, the events in it that are known, and the kinds whose monitors it detected."""

    explanation: Explanation | None
    events: Mapping[int, Json]
    kinds: frozenset[Kind] = frozenset()


def detections(watch: Watch, number: int, event: Json, changed: Sequence[int]) -> Iterator[Detection]:
    """What an event detected, each match once: those of branches or kinds where these are monitored, else that of the tree."""
    fired = [column for column in changed if watch.bank.verdicts[column] is Verdict.TRUE]
    parts = [column for column in fired if column] or fired
    explanations = [watch.bank.explanation(column) for column in parts]
    if parts and not any(explanations):
        yield Detection(None, {})  # a backend does not explain
    for which, explanation in apart(explanations):
        known = watch.recall.events(matched_events([explanation]) - {number})
        wholes = [watch.bank.columns[parts[place]].part.part_of for place in which]
        kinds = frozenset(whole.kind for whole in wholes if whole is not None and whole.kind is not None)
        yield Detection(explanation, {**known, number: event}, kinds)


class Commands(Listener):
    """Runs commands on detection; `name` is that of the tree."""

    def __init__(self, hooks: "Hooks", tree: RVAFT, name: str, sink: Sink) -> None:
        self._hooks = hooks
        self._tree = tree
        self._name = name
        self._sink = sink

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Run them for what this event detected; what was printed before is seen before they start."""
        from rvaft.monitoring.hooks import detection  # noqa: PLC0415 -- imported on use

        for found in detections(watch, number, event, changed):
            with suppress(BrokenPipeError):  # that nobody reads what is printed is no reason not to run the command
                self._sink.flush()
            told = detection(
                found.explanation,
                self._tree,
                name=self._name,
                trace=watch.trace,
                event=number,
                key=watch.key,
                events=found.events,
            )
            for failure in self._hooks.run(told, found.kinds):
                self._sink.warn(str(failure))


class Drawing(Listener):
    """Draws the first detection for a file, and counts them; a failure is reported and stops nothing."""

    def __init__(self, tree: RVAFT, file: str, sink: Sink, deliver: Callable[[bytes, str], None] | None) -> None:
        self.count = 0
        self.first: bytes | None = None
        self.failed = False
        self._tree = tree
        self._file = file
        self._sink = sink
        self._deliver = deliver

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """Draw what this event detected."""
        for found in detections(watch, number, event, changed):
            self.count += 1
            if self.first is None and found.explanation is not None and not self.failed:
                try:
                    self.first = drawn(self._tree, found.explanation, found.events, PurePath(self._file).suffix.lower())
                    if self._deliver is not None:
                        self._deliver(self.first, self._file)
                except (RvaftError, OSError) as error:
                    self._sink.report(error)
                    self.failed = True


def drawn(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json], suffix: str) -> bytes:
    """The tree with the path that fired, in the format of a suffix; raises `ToolMissing` and `ToolFailed`."""
    from rvaft.drawing.fired import fired_dot, fired_text  # noqa: PLC0415 -- imported on use

    if suffix == ".txt":
        return fired_text(tree, explanation, events).encode()
    dot = fired_dot(tree, explanation, events)
    if suffix.removeprefix(".") not in PICTURES:
        return dot.encode()
    from rvaft.drawing.graphviz import picture  # noqa: PLC0415 -- imported on use

    return picture(dot, suffix.removeprefix("."))


def require_drawable(file: str) -> None:
    """Raise `ToolMissing` now rather than at a detection, hours from here."""
    if PurePath(file).suffix.lower().removeprefix(".") in PICTURES and shutil.which("dot") is None:
        raise ToolMissing("dot", remedy="install Graphviz (apt-get install graphviz), or name a file .dot or .txt")
