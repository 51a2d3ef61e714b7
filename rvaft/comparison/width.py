"""How wide a figure or a table is in a paper."""

from enum import StrEnum


class Width(StrEnum):
    """A page of A4 with usual margins, or one of its two columns."""

    PAGE = "page"
    COLUMN = "column"
