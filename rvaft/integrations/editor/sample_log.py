"""The first events of a log beside a tree, for counts and for the completion of fields and values."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Final

from rvaft.errors import RvaftError
from rvaft.model.expressions import literal_text, word_text
from rvaft.model.guards import Guard, holds, time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Pattern, match, variables, ways
from rvaft.model.values import Json, JsonObject, at
from rvaft.readers.log import scheme
from rvaft.readers.registry import read_log
from rvaft.support.wording import counted

EVENTS: Final = 1_000
"""The maximum number of events in a sample."""
FILES: Final = 20
"""The maximum number of files in a sample."""
LONGEST: Final = 80
"""The maximum length of a value that is suggested."""


@dataclass(frozen=True)
class Sample:
    """Some events, and the name of their log.

    >>> sample = Sample("log.jsonl", ({"event": "a", "n": 1}, {"event": "a"}))
    >>> sample.fields(()), sample.values(("event",))
    (['event', 'n'], ['"a"'])
    """

    name: str = ""
    events: tuple[JsonObject, ...] = ()

    def count(self, pattern: Pattern, when: Guard | None = None) -> str:
        """Return how many events match a pattern, and satisfy a guard, as a sentence; nothing without events.

        >>> from rvaft.language.parser import parse_guard, parse_pattern
        >>> sample = Sample("log.jsonl", ({"n": 1}, {"n": 9}, {}))
        >>> sample.count(parse_pattern("{ n: N }"), parse_guard("N > 5"))
        '2 of the first 3 events of log.jsonl match, 1 of them satisfies the guard'
        """
        if not self.events:
            return ""
        matching = [event for event in self.events if match(pattern, event, {}) is not None]
        read = counted(len(self.events), "event")
        text = f"{len(matching)} of the first {read} of {self.name} {'match' if len(matching) != 1 else 'matches'}"
        if when is None or not matching:
            return text
        if time_points(when) or not {*guard_variables(when)} <= {*variables(pattern)}:
            return f"{text}; the guard depends on other events, too"
        passing = sum(any(holds(when, bound) for bound in ways(pattern, event, {})) for event in matching)
        return f"{text}, {passing} of them {'satisfies' if passing == 1 else 'satisfy'} the guard"

    def fields(self, path: Sequence[str]) -> list[str]:
        """Return the names of fields at a path as the language writes them, the most frequent first."""
        found = (at(event, path) for event in self.events)
        return [
            word_text(name) for name in _frequent(name for one in found if isinstance(one, Mapping) for name in one)
        ]

    def values(self, path: Sequence[str]) -> list[str]:
        """Return the literals at a path, the most frequent first."""
        return _frequent(chain.from_iterable(_literals(at(event, path, missing=())) for event in self.events))


def _frequent(found: Iterator[str]) -> list[str]:
    return [text for text, _ in Counter(found).most_common()]


def _literals(value: Json) -> Iterator[str]:
    if value is None or isinstance(value, (str, bool, int, float)):
        try:
            text = literal_text(value)
        except RvaftError:
            return
        if len(text) <= LONGEST:
            yield text


def files_of(file: str, log: str = "") -> list[Path]:
    """Return the files of the sample of a tree: `log`, or those in the folder of its traces.

    The name of a log is relative to the folder of the tree.
    """
    if log:
        path = Path(os.path.dirname(file), log)  # noqa: PTH120 - of a text, the current folder
        return [path] if not scheme(log) and path.is_file() else []
    return sorted(one for one in Path(file).with_suffix(".traces").glob("*.jsonl") if one.is_file())[:FILES]


def read(files: Sequence[Path]) -> Sample:
    """Return a sample of logs; one that cannot be read has no events, or those before the error."""
    name = files[0].name if len(files) == 1 else f"{len(files)} logs"
    return Sample(name, tuple(islice(chain.from_iterable(map(_events, files)), EVENTS)))


def _events(file: Path) -> Iterator[JsonObject]:
    try:
        yield from read_log(file, warn=lambda _: None)
    except (RvaftError, OSError):
        return
