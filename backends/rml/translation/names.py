"""Names that RML allows: an injective renaming of the names of a tree.

Event types and variables start with a lower-case ASCII letter, equations with an upper-case one; some words are taken.
"""

import re

from backends.rml.words import RESERVED


class Names:
    """Gives out names of one kind; no name twice."""

    def __init__(self, *taken: str) -> None:
        self._taken = {*RESERVED, *taken}

    def fresh(self, wanted: str, *, otherwise: str = "e") -> str:
        """A new name that resembles the wanted one."""
        base = identifier(wanted, otherwise=otherwise)
        name, number = base, 2
        while name in self._taken:
            name, number = f"{base}_{number}", number + 1
        self._taken.add(name)
        return name


def identifier(text: str, *, otherwise: str = "e") -> str:
    """A lower-case identifier that resembles the text; different texts may give the same one."""
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_")
    if not plain:
        return otherwise
    return plain[0].lower() + plain[1:] if plain[0].isalpha() else f"{otherwise}{plain}"
