"""What `rvaft monitor` prints: text for people or one JSON object per event."""

import json
import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final

from rvaft.language import pattern_text
from rvaft.monitors import Explanation, Monitor
from rvaft.printable import visible
from rvaft.statistics import NearMiss, Statistics
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Verdict

_LISTED: Final = 20
"""Event types that are listed one by one."""


class Reporter(ABC):
    """Told of every trace and every event in turn; the monitor has already read the event."""

    def __init__(self, several: bool, tree: RVAFT) -> None:
        self.several = several
        self.tree = tree
        self.trace = ""
        self.monitor: Monitor
        self.before = Verdict.UNKNOWN

    def begin(self, trace: str, monitor: Monitor) -> None:
        """A trace begins."""
        self.trace, self.monitor, self.before = trace, monitor, Verdict.UNKNOWN

    def step(self, number: int, event: Json) -> None:
        """An event was read, the `number`-th of its trace."""
        self.show(number, event, changed=self.monitor.verdict is not self.before)
        self.before = self.monitor.verdict

    def variables(self, explanation: Explanation) -> dict[str, Json]:
        """The variables of a match in the order of the tree."""
        return {name: explanation.variables[name] for name in self.tree.variables if name in explanation.variables}

    @abstractmethod
    def show(self, number: int, event: Json, *, changed: bool) -> None:
        """Print what there is to say about an event."""

    @abstractmethod
    def end(self) -> None:
        """The trace ends, and was not malformed."""

    @abstractmethod
    def finish(self) -> None:
        """All traces have been read."""


class JsonLines(Reporter):
    """One object per event, and nothing else."""

    def end(self) -> None:
        """Print nothing."""

    def finish(self) -> None:
        """Print nothing."""

    def show(self, number: int, event: Json, *, changed: bool) -> None:  # noqa: ARG002 (the interface)
        """Print the verdict, and where it becomes ⊤ the explanation."""
        said: dict[str, Json] = {"trace": self.trace} if self.several else {}
        said |= {"event": number, "verdict": self.monitor.verdict.value}
        explanation = self.monitor.explanation if changed else None
        if explanation is not None:
            said |= {
                "branch": explanation.branch,
                "kinds": sorted(kind.value for kind in explanation.kinds),
                "matched": [{"node": node, "event": at} for node, at in explanation.matched.items()],
                "variables": self.variables(explanation),
            }
        sys.stdout.write(f"{json.dumps(said)}\n")


class Text(Reporter):
    """A line per change of verdict with the explanation, and at the end what the traces held."""

    def __init__(self, several: bool, tree: RVAFT, statistics: Statistics) -> None:
        super().__init__(several, tree)
        self.statistics = statistics
        self.count = 0

    def begin(self, trace: str, monitor: Monitor) -> None:
        """A trace begins."""
        super().begin(trace, monitor)
        self.count = 0

    def show(self, number: int, event: Json, *, changed: bool) -> None:
        """Print a change of verdict."""
        self.count = number
        where = f"{self._where()}event {number}"
        self.statistics.add(event, where)
        if changed:
            _print(f"{where}: {self.monitor.verdict}")
            if self.monitor.explanation is not None:
                self._explain(self.monitor.explanation)

    def end(self) -> None:
        """Print the last verdict of the trace."""
        events = "1 event" if self.count == 1 else f"{self.count} events"
        _print(f"{self._where()}verdict {self.monitor.verdict} after {events}")

    def finish(self) -> None:
        """Print what all traces held, and what looks like a mistake in them or in the tree."""
        types, counts = self.statistics.types, self.statistics.relevant
        listed = [name for name in types if len(types) <= _LISTED or counts[name]]
        relevant = ", ".join([*(f"{name} {counts[name]}" for name in listed), *_and_others(types, listed, "0")])
        _print(f"events read: {self.statistics.events}; relevant: {relevant or 'none'}")
        never = self.statistics.never_seen
        for name in never[:_LISTED]:
            _print(f"warning: no event of type {name}")
        for others in _and_others(never, never[:_LISTED], "never seen"):
            _print(f"warning: {others}")
        for miss in self.statistics.near_misses.values():
            _print(f"warning: {_near(miss)}")

    def _where(self) -> str:
        return f"{self.trace}: " if self.several else ""

    def _explain(self, explanation: Explanation) -> None:
        kinds = ", ".join(sorted(kind.value for kind in explanation.kinds))
        branch = "" if explanation.branch is None else f"branch {explanation.branch}"
        if branch or kinds:
            _print(f"  {': '.join(part for part in (branch, kinds) if part)}")
        for name, number in explanation.matched.items():
            label = self.tree.nodes[name].label if name in self.tree.nodes else None
            _print(f"  event {number} is {name}{f' ({label})' if label else ''}")
        for variable, value in self.variables(explanation).items():
            _print(f"  {variable} = {json.dumps(value, ensure_ascii=False)}")


def _and_others(names: Sequence[str], listed: Sequence[str], what: str) -> list[str]:
    """The names that are not listed, as a number."""
    others = len(names) - len(listed)
    return [f"{others} other types {what}"] if others else []


def _near(miss: NearMiss) -> str:
    events = "1 event" if miss.count == 1 else f"{miss.count} events"
    field = ".".join(miss.field)
    has = "is missing" if miss.found is None else f"is {miss.found}, not {pattern_text(miss.expected)}"
    return f"near miss: {events} would be {miss.type} but for the field {field}, which {has} (first: {miss.first})"


def _print(line: str) -> None:
    sys.stdout.write(f"{visible(line)}\n")
