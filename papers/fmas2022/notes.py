"""Notes on differences between computed and printed cells, with letters."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from string import ascii_lowercase

import rvaft
from papers.fmas2022 import tex
from rvaft.export.latex import escaped
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor, Pending


@dataclass
class Notes:
    """The notes of one table; equal texts share a letter."""

    letters: dict[str, str] = field(default_factory=dict)

    def letter(self, text: str) -> str:
        """Return the letter of a note."""
        return self.letters.setdefault(text, _letter(len(self.letters)))

    def lines(self) -> list[str]:
        """Return the notes with their letters."""
        return [rf"\textsuperscript{{{letter}}}\,{text}" for text, letter in self.letters.items()]


def difference(tree: RVAFT, branch: int | None, events: Sequence[Json], printed: Verdict) -> str:
    """Return why the verdict after these events differs from the printed one."""
    monitor = rvaft.monitor(tree, branch=branch)
    for event in events:
        monitor.step(event)
    return f"The print has {tex.math(tex.SIGNS[printed])}. {_because(monitor)}"


def _because(monitor: Monitor) -> str:
    match monitor.verdict:
        case Verdict.TRUE:
            explanation = monitor.explanation
            assert explanation is not None, "the engine knows the tree"
            matched = ", ".join(f"{escaped(node)} by event {number}" for node, _, number in explanation.matched)
            return f"{tex.math(tex.phi(explanation.branch))} is complete: {matched}."
        case Verdict.FALSE:
            ended = monitor.ended
            assert ended is not None, "the engine knows the tree"
            return f"Nothing can complete it after event {ended.event}; before it {_waiting(ended.pending, 'awaited')}."
        case Verdict.UNKNOWN:
            return f"It is still open: {_waiting(monitor.pending(), 'awaits')}."


def _waiting(pending: Sequence[Pending], awaits: str) -> str:
    return " and ".join(
        f"{tex.math(tex.phi(one.branch))} {awaits} "
        + " or ".join(f"{tex.typewriter(wanted.event)} ({escaped(wanted.node)})" for wanted in one.awaited)
        for one in pending
    )


def _letter(number: int) -> str:
    letters = ""
    while True:
        letters = ascii_lowercase[number % 26] + letters
        number = number // 26 - 1
        if number < 0:
            return letters
