"""A configuration: one partial match, and what its future depends on.

`taken` are the occurrences that have their event. `dead` are the nodes whose guard does not hold, `closed` those whose guard
waits for nothing. `binding` keeps the variables that still matter. `inversions` says which orders between two shared elements of the
tree the match has broken: harmless while some scenario does not demand them (always empty where no node is shared).
`flags` and `tallies` are what `Progress` knows, where it differs from the start; both follow from the rest. `witness` is how the
match came about and no part of the state.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final, NamedTuple, Optional

from rvaft.engine.compiled_tree import fingerprint
from rvaft.model.values import Json


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


# Configurations in a form to be pickled: flat, since the chain of a long match is deeper than Python can recurse.
#
# Configurations share the beginnings of their matches; a step that several share is written once.

_FIELDS: Final = tuple(field.name for field in fields(Configuration) if field.name != "witness")


@dataclass(frozen=True, slots=True)
class Packed:
    """Groups of configurations: the fields of each with the number of its last step; -1 stands for no step."""

    steps: tuple[tuple[int, int, int, Mapping[str, Json]], ...]
    """For each step the number of the one before, the node, the position, the values."""
    groups: tuple[tuple[tuple[tuple[Any, ...], int], ...], ...]


def packed(groups: Iterable[Iterable[Configuration]]) -> Packed:
    """What `unpacked` makes the same groups of."""
    steps: list[tuple[int, int, int, Mapping[str, Json]]] = []
    number: dict[int, int] = {}

    def last(configuration: Configuration) -> int:
        new: list[Witness] = []
        for step in configuration.history():
            if id(step) in number:
                break
            new.append(step)
        for step in reversed(new):
            before = -1 if step.before is None else number[id(step.before)]
            number[id(step)] = len(steps)
            steps.append((before, step.node, step.position, step.values))
        return -1 if configuration.witness is None else number[id(configuration.witness)]

    made = tuple(tuple((tuple(getattr(c, name) for name in _FIELDS), last(c)) for c in group) for group in groups)
    return Packed(tuple(steps), made)


def unpacked(pack: Packed) -> list[list[Configuration]]:
    """The groups again."""
    steps: list[Witness] = []
    for before, node, position, values in pack.steps:
        steps.append(Witness(None if before < 0 else steps[before], node, position, dict(values)))
    return [
        [
            Configuration(**dict(zip(_FIELDS, parts, strict=True)), witness=None if last < 0 else steps[last])
            for parts, last in group
        ]
        for group in pack.groups
    ]
