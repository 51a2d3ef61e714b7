"""Patterns sorted by a literal, so that an event is held only against those that it can fit."""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Generic, TypeVar

from rvaft.patterns import Literal, ObjectPattern, Pattern
from rvaft.values import Json, key

T = TypeVar("T")


class Candidates(Generic[T]):
    """Things with their patterns, found again by events."""

    def __init__(self, items: Iterable[tuple[T, Pattern]]) -> None:
        self._by_field: dict[str, dict[Hashable, list[T]]] = {}
        self._others: list[T] = []
        for item, pattern in items:
            field = _literal_field(pattern)
            if field is None:
                self._others.append(item)
            else:
                name, value = field
                self._by_field.setdefault(name, {}).setdefault(value, []).append(item)

    def at(self, event: Json) -> Iterator[T]:
        """The things whose patterns the event may fit."""
        yield from self._others
        for name, by_value in self._by_field.items():
            if isinstance(event, Mapping) and name in event:
                yield from by_value.get(key(event[name]), ())


def _literal_field(pattern: Pattern) -> tuple[str, Hashable] | None:
    """The first field of a pattern that asks for a literal, and the key of that literal."""
    if isinstance(pattern, ObjectPattern):
        for name, inner in pattern.fields:
            if isinstance(inner, Literal):
                return name, key(inner.value)
    return None
