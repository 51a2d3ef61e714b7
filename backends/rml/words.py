"""What every writer of RML text has to know of the language: words that no name may be, strings, the largest integer.

Facts, not translation: the readers keep their own account of the language.
"""

from typing import Final

KEYWORDS: Final = frozenset(["not", "matches", "with", "empty", "all", "let", "var", "if", "else"])
FUNCTIONS: Final = frozenset(["abs", "sin", "cos", "tan", "min", "max"])
VALUES: Final = frozenset(["true", "false", "null"])
TYPES: Final = frozenset(["any", "none"])
"""Event types that the compiler declares itself; to declare one again widens it."""
RESERVED: Final = KEYWORDS | FUNCTIONS | VALUES | TYPES
"""The words that no name may be."""
LARGEST: Final = 2**31 - 1
"""The largest integer that the compiler reads."""
_ESCAPES: Final = str.maketrans({"\\": "\\\\", "'": "\\'", "\n": "\\n", "\t": "\\t", "\r": "\\r"})


def quoted(text: str) -> str:
    """A string or a field name."""
    return f"'{text.translate(_ESCAPES)}'"
