"""Hand-written cases, the rows of `cases.txt`: a tree, a trace, the verdict after every prefix, and
the clause of the definition it shows.

The table feeds the reference, the engine and every backend.
"""

import json
from dataclasses import dataclass
from typing import Any

from tests.tables import rows

VALUES = {"T": "true", "F": "false", "?": "unknown"}


@dataclass(frozen=True)
class Case:
    """One row; `part` is the number of a branch or a kind."""

    name: str
    tree: str
    semantics: str
    trace: str | list[dict[str, Any]]
    verdicts: str
    part: int | str | None = None

    @property
    def branch(self) -> int | None:
        """The branch that is monitored, if one is."""
        return self.part if isinstance(self.part, int) else None

    @property
    def kind(self) -> str | None:
        """The kind that is monitored, if one is."""
        return self.part if isinstance(self.part, str) else None

    @property
    def values(self) -> list[str]:
        """The verdict after every event, in words."""
        return [VALUES[sign] for sign in self.verdicts]

    @property
    def events(self) -> list[dict[str, Any]]:
        """The trace as events: `"a b@5"` is `[{"event": "a"}, {"event": "b", "t": 5}]`."""
        if not isinstance(self.trace, str):
            return self.trace
        words = [word.partition("@") for word in self.trace.split()]
        return [{"event": name, "t": json.loads(time)} if at else {"event": name} for name, at, time in words]


CASES = [Case(*row) for row in rows(__file__, "cases.txt")]
