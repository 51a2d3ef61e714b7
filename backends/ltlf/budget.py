"""Work that may be done before something is too large: memory is not gone when it is refused."""

from typing import Final

from rvaft.errors import TooLarge

CELLS: Final = 20
"""How many cells (members of states and scenarios) may be made for each subformula that the limit allows."""


class Budget:
    """Cells that may still be made; `TooLarge` names what they are and the caller's limit."""

    def __init__(self, what: str, limit: int) -> None:
        self._what = what
        self._limit = limit
        self._left = limit * CELLS

    def spend(self, cells: int) -> None:
        """Make some cells; raises `TooLarge` when there were not so many left."""
        self._left -= cells
        if self._left < 0:
            raise TooLarge(self._what, limit=self._limit)
