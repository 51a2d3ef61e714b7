"""Wording that messages share: counts, lists of names, and a similar name for an unknown one."""

from collections.abc import Iterable, Sequence
from typing import Final

_SHOWN: Final = 8
_COMPARED: Final = 2_000


def counted(count: int, what: str = "event") -> str:
    """Return a count with its noun.

    >>> counted(2), counted(1, "detection")
    ('2 events', '1 detection')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"


def listing(names: Sequence[str], conjunction: str = "and") -> str:
    """Return `a`, `a and b`, or `a, b and c`; long lists are cut."""
    if len(names) > _SHOWN:
        return f"{', '.join(names[:_SHOWN])} {conjunction} {len(names) - _SHOWN} more"
    return f" {conjunction} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def did_you_mean(name: str, known: Iterable[str], *, cutoff: float = 0.6) -> str:
    """Return `; did you mean NAME?` for a similar known name, ignoring case, or an empty string."""
    found = similar(name, known, cutoff=cutoff)
    return f"; did you mean {found}?" if found else ""


def similar(name: str, known: Iterable[str], *, cutoff: float = 0.6) -> str:
    """Return a similar known name, ignoring case, or an empty string."""
    candidates = [other for other in known if abs(len(other) - len(name)) <= 2][:_COMPARED]
    if not candidates:
        return ""
    from difflib import get_close_matches  # noqa: PLC0415 -- imported on use

    folded = {other.casefold(): other for other in reversed(candidates)}
    close = get_close_matches(name.casefold(), folded, n=1, cutoff=cutoff)
    return folded[close[0]] if close else ""
