"""Names that are legal in Spot's LTLf, one for each thing: an injective renaming."""

import re
from typing import Final

RESERVED: Final = frozenset({"true", "false", "xor", "rvaft", "atom", "relevant", "ignored"})
_ILLEGAL: Final = re.compile(r"[^a-z0-9_]+")


class Names:
    """Gives out names `[a-z_][a-z0-9_]*`, never one twice."""

    def __init__(self) -> None:
        self._taken: set[str] = set(RESERVED)

    def fresh(self, wanted: str) -> str:
        """The wanted name itself where it is legal and free, else one like it."""
        name = _ILLEGAL.sub("_", wanted.lower()) or "_"
        if name[0].isdigit():
            name = f"_{name}"
        candidate, number = name, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{name}_{number}"
        self._taken.add(candidate)
        return candidate
