"""A configuration: one partial match, and what its future depends on.

`taken` are the occurrences that have their event. `dead` are the nodes whose guard does not hold, `closed` those whose guard
waits for nothing. `binding` keeps the variables that still matter. `inversions` says which orders between two shared elements of the
tree the match has broken: harmless while some scenario does not demand them (always empty where no node is shared).
`flags` and `tallies` are what `Progress` knows, where it differs from the start; both follow from the rest. `witness` is how the
match came about and no part of the state.
"""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Optional

from rvaft.engine.variables import fingerprint
from rvaft.values import Json


class Witness(NamedTuple):
    """The last occurrence taken, the position of its event, the values it saw, and what was before."""

    before: Optional["Witness"]
    node: int
    position: int
    values: dict[str, Json]


@dataclass(slots=True)
class Configuration:
    """One partial match; see the module."""

    dead: int
    closed: int
    taken: int = 0
    binding: dict[str, Json] = field(default_factory=dict)
    inversions: frozenset[tuple[int, int]] = frozenset()
    flags: dict[int, int] = field(default_factory=dict)
    tallies: dict[int, tuple[int, ...]] = field(default_factory=dict)
    witness: Witness | None = None

    def copy(self) -> "Configuration":
        """An independent copy."""
        return Configuration(
            self.dead,
            self.closed,
            self.taken,
            dict(self.binding),
            self.inversions,
            dict(self.flags),
            dict(self.tallies),
            self.witness,
        )

    @property
    def key(self) -> Hashable:
        """Equal for configurations with equal futures."""
        return self.taken, self.dead, self.inversions, fingerprint(self.binding)

    def history(self) -> Iterator[Witness]:
        """The steps of the match, the last first."""
        step = self.witness
        while step is not None:
            yield step
            step = step.before
