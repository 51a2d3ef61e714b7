"""Topic and service names with and without the leading slash.

ROS takes `/command` and `command` for one name (at the root namespace), and the versions of ROSMonitoring write it either way.
A tree takes them for two values, so this holds on the wire alone: an event is read under the spelling that the tree uses.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Self

from rvaft.patterns import Literal, ObjectPattern, Pattern
from rvaft.tree import RVAFT
from rvaft.values import Json

FIELDS: Final = ("topic", "service")
"""The fields of an event, at its top level, that hold such a name."""


@dataclass(frozen=True, slots=True)
class Names:
    """The names that a tree spells out, per field."""

    known: Mapping[str, frozenset[str]]

    @classmethod
    def of(cls, tree: RVAFT) -> Self:
        """The names in the runtime events and `ignore` declarations of a tree."""
        patterns = [relevant.pattern for relevant in tree.alphabet]
        patterns += [tree.instantiate(ignore.on) for ignore in tree.ignores]
        return cls({field: frozenset(_literals(patterns, field)) for field in FIELDS})

    def as_written(self, event: Mapping[str, Json]) -> Mapping[str, Json]:
        """The event with its names as the tree spells them; one that the tree spells both ways, or not at all, stays as it is."""
        renamed: dict[str, Json] = {}
        for field, known in self.known.items():
            name = event.get(field)
            if isinstance(name, str) and name not in known and (other := _other(name)) in known:
                renamed[field] = other
        return {**event, **renamed} if renamed else event


def _other(name: str) -> str:
    """The other spelling of a name: with one leading slash or with none; a name with more has no other."""
    if name.startswith("//"):
        return name
    return name[1:] if name.startswith("/") else f"/{name}"


def _literals(patterns: list[Pattern], field: str) -> Iterator[str]:
    for pattern in patterns:
        if isinstance(pattern, ObjectPattern):
            for name, inner in pattern.fields:
                if name == field and isinstance(inner, Literal) and isinstance(inner.value, str):
                    yield inner.value
