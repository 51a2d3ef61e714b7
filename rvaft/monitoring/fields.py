"""A field of an event by its dotted path: `robot.id` is the field `id` of the object in the field `robot`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from rvaft.errors import OptionError
from rvaft.values import Json


@dataclass(frozen=True, slots=True)
class Field:
    """Where a value stands in an event. A field whose own name has dots is found under its whole name."""

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
        for name in self.path:
            if not isinstance(event, Mapping) or name not in event:
                return None
            event = event[name]
        return (event,)
