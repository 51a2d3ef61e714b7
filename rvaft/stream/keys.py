"""Fields of events by their paths, and keys: the fields whose values say which of many an event is about."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Self

from rvaft.errors import OptionError
from rvaft.model.values import Json, at

_ABSENT: Final = object()


@dataclass(frozen=True, slots=True)
class Field:
    """A field of an event by its dotted path; one whose own name has dots is found under its whole name.

    >>> Field.parse("robot.id").of({"robot": {"id": 7}})
    (7,)
    """

    text: str
    path: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Raises `OptionError` for what is no path."""
        path = tuple(text.split("."))
        if not all(path):
            raise OptionError(f"{text!r} is no field: write a name, or names with dots between")
        return cls(text, path)

    def of(self, event: Json) -> tuple[Json] | None:
        """The value, in a tuple since it may be null, or None where the event has none."""
        if isinstance(event, Mapping) and self.text in event:
            return (event[self.text],)
        found = at(event, self.path, _ABSENT)
        return None if found is _ABSENT else (found,)


@dataclass(frozen=True, slots=True)
class Key:
    """The fields that together say which of many an event is about.

    >>> Key.parse(["user", "src"]).of({"user": "bob", "src": 1, "x": 2})
    ('bob', 1)
    """

    fields: tuple[Field, ...]

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Self:
        """Raises `OptionError` for what is no path."""
        return cls(tuple(map(Field.parse, dict.fromkeys(texts))))

    def of(self, event: Json) -> tuple[Json, ...] | None:
        """The value of each field, or None where the event lacks one of them."""
        found = [field.of(event) for field in self.fields]
        return None if None in found else tuple(value[0] for value in found if value is not None)

    def told(self, values: tuple[Json, ...]) -> Json:
        """The key as JSON: the value of a single field, or an object with those of several."""
        if len(self.fields) == 1:
            return values[0]
        return {field.text: value for field, value in zip(self.fields, values, strict=True)}
