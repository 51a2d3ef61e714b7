"""A configuration: one partial match, what its future depends on, and its form in a pickle."""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Optional

from rvaft.model.values import Json, fingerprint


class Witness(NamedTuple):
    """The last occurrence taken, the position of its event, the values it saw, and what was before."""

    before: Optional["Witness"]
    node: int
    position: int
    values: Mapping[str, Json]


@dataclass(slots=True)
class Configuration:
    """One partial match.

    `taken` are the occurrences that have their event. `dead` are the nodes whose guard does not hold, `closed` those whose guard
    waits for nothing. `binding` keeps the variables that still matter. `inversions` says which orders between two shared elements of
    the tree the match has broken: harmless while some scenario does not demand them (always empty where no node is shared).
    `flags` and `tallies` are what `PartProgress` knows, where it differs from the start; both follow from the rest. `witness` is how
    the match came about and no part of the state.
    """

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
            self.binding.copy(),
            self.inversions,
            self.flags.copy(),
            self.tallies.copy(),
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


class Snapshot(NamedTuple):
    """Groups of configurations in a form to be pickled: flat, since the chain of a long match is deeper than Python can recurse.

    A step that several matches share is written once: the number of the one before (-1 for none), node, position, values. Each
    configuration stands without its witness, with the number of its last step.
    """

    steps: list[tuple[int, int, int, Mapping[str, Json]]]
    groups: list[list[tuple[Configuration, int]]]

    @classmethod
    def of(cls, groups: Iterable[Iterable[Configuration]]) -> "Snapshot":
        """What `groups_again` makes the same groups of."""
        found = cls([], [])
        numbers: dict[int, int] = {}
        for group in groups:
            found.groups.append([])
            for one in group:
                new: list[Witness] = []
                for step in one.history():
                    if id(step) in numbers:
                        break
                    new.append(step)
                for step in reversed(new):
                    before = -1 if step.before is None else numbers[id(step.before)]
                    numbers[id(step)] = len(found.steps)
                    found.steps.append((before, step.node, step.position, step.values))
                kept = one.copy()  # monitors go on while a snapshot waits to be written
                kept.witness = None
                found.groups[-1].append((kept, -1 if one.witness is None else numbers[id(one.witness)]))
        return found

    def groups_again(self) -> list[list[Configuration]]:
        """The groups."""
        steps: list[Witness | None] = []
        for before, node, position, values in self.steps:
            steps.append(Witness(None if before < 0 else steps[before], node, position, values))
        steps.append(None)  # found by -1
        found = []
        for group in self.groups:
            found.append([one.copy() for one, _ in group])
            for made, (_, last) in zip(found[-1], group, strict=True):
                made.witness = steps[last]
        return found
