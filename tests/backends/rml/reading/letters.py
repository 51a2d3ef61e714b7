"""Verdicts as one letter for each event."""

from collections.abc import Iterable

from backends.rml.reader.monitor import read
from rvaft.model.values import Json


def letters(text: str, events: Iterable[Json]) -> str:
    """What this reader says: T, F or ? after each event."""
    return "".join({"⊤": "T", "⊥": "F"}.get(verdict.symbol, "?") for verdict in read(text).run(events))
