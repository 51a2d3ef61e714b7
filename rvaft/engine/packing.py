"""Configurations in a form to be pickled: flat, since the chain of a long match is deeper than Python can recurse.

Configurations share the beginnings of their matches; a step that several share is written once.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

from rvaft.engine.configuration import Configuration, Witness
from rvaft.values import Json

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
