"""Tables 2 and 3, computed: the verdict of every monitor after every event.

The verdicts are those of the engine. A different verdict of the reference or of a faithful backend
raises `Disagreement`.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cross_check.comparison import Roster
from cross_check.participants import ENGINE, Absent, Outside, Participant, faithful_backends
from cross_check.results import Job
from papers.fmas2022 import printed
from rvaft.api import branches
from rvaft.backend import backend
from rvaft.errors import RvaftError
from rvaft.export.property_text import property_sign
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict

Monitors = Mapping[str, int | None]
"""Sign of a monitor -> the number of its branch, None for the whole tree."""
Everybody = Mapping[str, Participant | Outside | Absent]
Enlisted = Mapping[str, Everybody]
"""Sign of a monitor -> participants by name."""
Verdicts = Mapping[str, tuple[Verdict, ...]]
"""Sign of a monitor -> its verdicts after every event."""


class Disagreement(RvaftError):
    """Two participants give different verdicts; one of them has a fault."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One completed trace of a table; `as_printed` has the verdicts without the event missing in
    print.
    """

    table: int
    number: int
    events: tuple[Json, ...]
    verdicts: Verdicts
    as_printed: Verdicts

    def left_out(self, event: int) -> bool:
        """Return whether the event with this number, from 1, is missing in print."""
        return printed.LEFT_OUT.get(self.number) == event

    def printed(self, branch: int | None, event: int) -> Verdict | None:
        """Return the printed verdict, or None."""
        return printed.cell(self.table, self.number, branch, event, len(self.events))


def monitors(tree: RVAFT) -> Monitors:
    """Return φ for the tree and φ₁, φ₂, … for its branches."""
    return {property_sign(tree): None, **{property_sign(one): one.number for one in branches(tree)}}


def enlist(tree: RVAFT) -> Enlisted:
    """Return the participants with full verdicts for tree and branches, under `projected`."""
    full_verdicts = tuple(name for name in faithful_backends() if Verdict.FALSE in backend(name).verdicts)
    roster = Roster(full_verdicts)
    return {
        sign: {name: make() for name, make in roster.candidates(tree, Job("tree", Semantics.PROJECTED, branch=branch))}
        for sign, branch in monitors(tree).items()
    }


def present(enlisted: Enlisted) -> list[str]:
    """Return the names of participants available for every monitor."""
    missing = absent(enlisted)
    return list(dict.fromkeys(name for everybody in enlisted.values() for name in everybody if name not in missing))


def absent(enlisted: Enlisted) -> Mapping[str, str]:
    """Return the names of participants that are absent for some monitor, with reasons."""
    return {
        name: str(one.error)
        for everybody in enlisted.values()
        for name, one in everybody.items()
        if isinstance(one, Absent)
    }


def listed(names: Iterable[str]) -> str:
    """Return the names as `a, b and c`."""
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def traces(enlisted: Enlisted, folder: Path) -> Iterator[Trace]:
    """Yield the traces of both tables from files table2_row1.jsonl and so on; raises
    `Disagreement`, `OSError`.
    """
    for table in printed.LAST:
        for number in printed.TRACES:
            text = (folder / f"table{table}_row{number}.jsonl").read_text(encoding="utf-8")
            events = [json.loads(line) for line in text.splitlines()]
            left_out = printed.LEFT_OUT.get(number)
            shorter = [event for place, event in enumerate(events, 1) if place != left_out]
            as_printed = _agreed(enlisted, shorter) if left_out else {}
            yield Trace(table, number, tuple(events), _agreed(enlisted, events), as_printed)


def verdicts_after(one: Participant | Outside | Absent, events: Sequence[Json]) -> tuple[Verdict, ...] | None:
    """Return the verdicts of a participant after every event, or None if it cannot run."""
    return tuple(one.start().run(events)) if isinstance(one, Participant) else None


def symbols(verdicts: Sequence[Verdict]) -> str:
    """Return verdicts as one word: `???⊤`."""
    return "".join(verdict.symbol for verdict in verdicts)


def _agreed(enlisted: Enlisted, events: Sequence[Json]) -> Verdicts:
    found: dict[str, tuple[Verdict, ...]] = {}
    for sign, everybody in enlisted.items():
        words = {name: word for name, one in everybody.items() if (word := verdicts_after(one, events)) is not None}
        found[sign] = words[ENGINE]
        for name, word in words.items():
            if word != words[ENGINE]:
                differ = f"{ENGINE} says {symbols(words[ENGINE])}, {name} says {symbols(word)}"
                raise Disagreement(f"{sign} on {json.dumps(list(events))}: {differ}")
    return found
