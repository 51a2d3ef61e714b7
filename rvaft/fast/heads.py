"""What is decoded of a line: the fields that some pattern of a tree mentions, where they hold no objects or lists."""

from collections.abc import Iterable
from typing import Any, Final, Protocol, TypedDict

import msgspec

from rvaft.patterns import ObjectPattern, Pattern
from rvaft.values import Scalar

ABSENT: Final = msgspec.UNSET
REFUSED: Final = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What a decoder raises for a line that is not for it, malformed or not."""


def fields_of(patterns: Iterable[Pattern]) -> tuple[str, ...] | None:
    """The fields of events that patterns mention; None for patterns that the fast decoder is not for.

    Such want more than fields, or fields whose names a line could write in more ways than one, escapes of ASCII by their number aside.
    """
    found: dict[str, None] = {}
    for pattern in patterns:
        if not isinstance(pattern, ObjectPattern):
            return None
        found.update(dict.fromkeys(field for field, _ in pattern.fields))
    simple = all(name.isascii() and name.isprintable() and not set(name) & set('"\\/') for name in found)
    return tuple(found) if simple else None


def quoted(field: str) -> bytes:
    """A field as it stands in a line."""
    return f'"{field}"'.encode()


class Decoder(Protocol):
    """A decoder of msgspec; raises one of `REFUSED`."""

    def decode(self, line: bytes) -> Any:
        """The value on a line."""

    def decode_lines(self, text: bytes) -> list[Any]:
        """The values in a text, whatever lines they are on."""


def event_decoder(fields: Iterable[str]) -> Decoder:
    """Decodes objects to events with these fields alone; refuses those in which one of them is an object or a list."""
    event: Any = TypedDict("event", dict.fromkeys(fields, Scalar), total=False)  # type: ignore[misc] # the names come with the tree
    return msgspec.json.Decoder(event)


def head_decoder(fields: Iterable[str]) -> Decoder:
    """Decodes objects to such with attributes `f0`, `f1`, … for these fields; `ABSENT` stands for one that is not there.

    Refuses objects in which one of them is an object or a list.
    """
    names = {f"f{number}": field for number, field in enumerate(fields)}
    # Not to be looked at by the garbage collector: heads live for one block, and hold nothing that could refer to them.
    head = msgspec.defstruct(
        "Head",
        [(name, Scalar | msgspec.UnsetType, ABSENT) for name in names],
        rename=names.__getitem__,
        gc=False,
        module=__name__,
    )
    return msgspec.json.Decoder(head)
