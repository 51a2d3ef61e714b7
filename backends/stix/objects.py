"""How events become objects of observed data: the names of properties, and the header that a pattern begins with.

`type` and `id`, and names that end in `_ref`, `_refs`, `_hex` or `_bin`, have a meaning of their own in STIX. A field that is called so, or would be
taken for such a field, gets one more underscore at the end.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from rvaft.errors import LanguageError, OptionError
from rvaft.language.parser import parse_time
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import time_text

EVENT: Final = "x-rvaft"
"""The type of the object that an event is unless a mapping says otherwise."""
Way: TypeAlias = tuple[str, ...]
"""The names of fields from the outside in."""

_MEANT: Final = re.compile(r"(type|id|.*(_refs?|_hex|_bin))_*", re.DOTALL)
_PATH: Final = re.compile(r"[a-z][a-z0-9-]*:[a-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
_HEADER: Final = re.compile(r"\s*/\*\s*rvaft\b(.*?)\*/", re.DOTALL)


def property_of(name: str) -> str:
    """The property that a field of an event is.

    >>> property_of("user"), property_of("type"), property_of("type_"), property_of("pid_hex")
    ('user', 'type_', 'type__', 'pid_hex_')
    """
    return f"{name}_" if _MEANT.fullmatch(name) else name


@dataclass(frozen=True, slots=True)
class StixHeader:
    """What a pattern says of its observations: where events have their time, and of each object path the field.

    `types` has of each event type the object path of each field; it is known only where a user gives a mapping.
    """

    time: EventTime | None = None
    objects: Mapping[str, Way] = field(default_factory=dict)
    types: Mapping[str, Mapping[Way, str]] = field(default_factory=dict)

    @classmethod
    def mapped(cls, mapping: Mapping[str, Any]) -> "StixHeader":
        """What a mapping of a user says; raises `OptionError`."""
        types = {name: {way: path for path, way in _paths(name, below, ())} for name, below in mapping.items()}
        objects: dict[str, Way] = {}
        for name, paths in types.items():
            for way, path in paths.items():
                if objects.setdefault(path, way) != way:
                    raise OptionError(
                        f"the mapping has two fields for {path}: {'.'.join(objects[path])}, {'.'.join(way)}"
                    )
            if len({path.partition(":")[0] for path in paths.values()}) > 1:
                raise OptionError(f"the mapping of {name} has objects of two types, and an event is one object")
        if inside := [path for path in objects for other in objects if path.startswith(f"{other}.")]:
            raise OptionError(f"the mapping has {inside[0]} inside of what is a field itself")
        return cls(None, objects, types)

    def path(self, kind: str, way: Way) -> str:
        """The object path of a field of an event type; raises `OptionError` where the mapping lacks it."""
        if kind not in self.types:
            raise OptionError(f"the mapping lacks the event type {kind}: say which property each of its fields is")
        if way not in self.types[kind]:
            raise OptionError(f"the mapping of {kind} lacks the field {'.'.join(way)}: say which property it is")
        return self.types[kind][way]

    def __str__(self) -> str:
        said: dict[str, Any] = {} if self.time is None else {"time": time_text(self.time)}
        said |= {"objects": self.objects} if self.objects else {}
        text = json.dumps(said, separators=(",", ":")).replace("/", r"\u002f")
        return f"/* rvaft {text} */ " if said else ""

    @classmethod
    def of(cls, text: str) -> "StixHeader":
        """The header that a text begins with, if any; raises `LanguageError`."""
        found = _HEADER.match(text)
        try:
            said = json.loads(found[1]) if found else {}
            objects = {_checked(path): tuple(map(str, way)) for path, way in said.get("objects", {}).items()}
            return cls(parse_time(said["time"]) if "time" in said else None, objects)
        except (ValueError, AttributeError, TypeError) as error:
            reason = error.message if isinstance(error, LanguageError) else str(error)
            raise LanguageError(f"the comment at the beginning cannot be read: {reason}", file="<stix>") from None


def _paths(name: str, below: Any, above: Way) -> Iterator[tuple[str, Way]]:
    if isinstance(below, Mapping):
        for step, inner in below.items():
            yield from _paths(name, inner, (*above, step))
    else:
        yield _checked(below), above


def _checked(path: Any) -> str:
    if not isinstance(path, str) or not _PATH.fullmatch(path):
        raise OptionError(f"{path!r} is no object path such as user-account:account_login")
    if odd := [step for step in re.split("[:.]", path)[1:] if property_of(step) != step]:
        raise OptionError(
            f"{path} has {odd[0]}, which STIX gives a meaning of its own: map the field to another property"
        )
    return path
