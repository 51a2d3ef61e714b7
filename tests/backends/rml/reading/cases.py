"""The table `cases.txt` of RML texts with the verdicts of the published tools."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rvaft.model.values import Json

LETTERS: Final = """\
a matches {e:'a'};
b matches {e:'b'};
c matches {e:'c'};
av(x) matches {e:'a', v:x};
bv(x) matches {e:'b', v:x};
"""
"""Event types that every text may use: a letter, alone or with its field v."""


@dataclass(frozen=True, slots=True)
class Case:
    """A text without the letters, and traces (see `events`) with their verdicts."""

    name: str
    text: str
    runs: dict[str, str]

    @property
    def whole(self) -> str:
        """The text with the letters."""
        return LETTERS + self.text


def events(trace: str) -> list[Json]:
    """`a` is {"e": "a"}, `a1` has v as well, `a1/2` has v and w; a trace in square brackets is JSON."""
    if trace.startswith("["):
        found: list[Any] = json.loads(trace)
        return found
    return [_event(word) for word in trace.split()]


def _event(word: str) -> dict[str, Json]:
    match = re.fullmatch(r"([a-z])(-?\d+)?(?:/(\d+))?", word)
    assert match
    letter, v, w = match.groups()
    return {"e": letter, **({} if v is None else {"v": int(v)}), **({} if w is None else {"w": int(w)})}


def _case(block: str) -> Case:
    """A title behind `#`, the text, and lines of `=`, the verdicts and the trace."""
    title, *lines = block.strip().splitlines()
    runs = [line.removeprefix("= ").partition(" ") for line in lines if line.startswith("= ")]
    text = "\n".join(line for line in lines if not line.startswith("= "))
    return Case(title, text, {trace: verdicts for verdicts, _, trace in runs})


_TABLE: Final = Path(__file__).with_name("cases.txt").read_text(encoding="utf-8")
CASES: Final = tuple(map(_case, re.split(r"^# ", _TABLE, flags=re.MULTILINE)[1:]))
