"""The fields that tell event types apart: in a robot's log mostly one, `topic`.

Whatever else an event holds, its values there say which patterns of a tree it can fit at all. So they decide what is read of it.
"""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping
from typing import Final

from rvaft.patterns import Pattern
from rvaft.shapes import LONGEST, literals_of
from rvaft.values import Json

_OTHER: Final = ("other",)
"""In place of a value that no pattern asks for, or of none."""


class Discriminators:
    """The discriminating fields of some patterns: every pattern that asks for a string in some field asks for one in one of these."""

    def __init__(self, patterns: Iterable[Pattern]) -> None:
        strings = [_strings(pattern) for pattern in patterns]
        self.fields = tuple(_cover(strings))
        self._asked = tuple({field: one[field] for field in self.fields if field in one} for one in strings)
        self._filed: dict[tuple[str, Hashable], list[int]] = {}
        """The numbers of the patterns that ask for a value in a field, each under the first field that it asks about."""
        self._rest: list[int] = []
        for number, asked in enumerate(self._asked):
            first = next(iter(asked.items()), None)
            (self._rest if first is None else self._filed.setdefault(first, [])).append(number)
        self._values = {field: frozenset(one[field] for one in strings if field in one) for field in self.fields}

    def values(self, event: Mapping[str, Json]) -> tuple[Hashable, ...]:
        """What tells the event from others: its values in the discriminating fields, as far as patterns ask for them."""
        return tuple([self.value(field, event.get(field)) for field in self.fields])

    def value(self, field: str, value: Json) -> Hashable:
        """The same for one field."""
        return value if isinstance(value, str) and value in self._values[field] else _OTHER

    def apart(self, values: Iterable[Json]) -> tuple[Hashable, ...]:
        """What tells events apart that fit no pattern: the strings, if not too long, that they have in the discriminating fields."""
        return tuple([value if isinstance(value, str) and len(value) <= LONGEST else _OTHER for value in values])

    def candidates(self, values: tuple[Hashable, ...]) -> tuple[int, ...]:
        """The numbers of the patterns that an event with these values may fit, in order."""
        by_field = dict(zip(self.fields, values, strict=True))
        near = [*self._rest, *(number for item in by_field.items() for number in self._filed.get(item, ()))]
        return tuple(
            sorted(n for n in near if all(by_field[field] == value for field, value in self._asked[n].items()))
        )


def _strings(pattern: Pattern) -> dict[str, str]:
    return {field: value for field, value in literals_of(pattern).items() if isinstance(value, str)}


def _cover(literals: Iterable[Mapping[str, str]]) -> Iterable[str]:
    """Fields, as few as can be told at once, of which each of these has one if it has any; the most frequent first."""
    left = [fields for fields in literals if fields]
    while left:
        field, _ = Counter(field for fields in left for field in fields).most_common(1)[0]
        yield field
        left = [fields for fields in left if field not in fields]
