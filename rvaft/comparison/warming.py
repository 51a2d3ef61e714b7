"""What is no part of any time: to import a backend, and to touch for the first time what a fork shares with its parent.

A fork copies each page of memory that it writes to first, and Python writes to whatever it looks at. So a process that is to be timed first runs
something else in the same language, which has all gates but knows nothing of what is measured.
"""

from contextlib import suppress
from functools import cache
from typing import Final

from rvaft.backend import Specification, backend
from rvaft.model import Gate, Node
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

_SMALLEST: Final = RVAFT("a", [Node("a")])
_OTHER: Final = RVAFT(
    "top",
    [
        Node("top", Gate.OR, ("all", "one after the other", "some")),
        Node("all", Gate.AND, ("a", "b")),
        Node("one after the other", Gate.SAND, ("c", "d", "e")),
        Node("some", Gate.VOT, ("f", "g", "h"), 2),
        *(Node(name) for name in "abcdefgh"),
    ],
)
_EVENTS: Final = "cfadgb"


def prepare(language: str, semantics: Semantics) -> None:
    """Import everything that a translation and a run need; for the process from which those that measure are forked."""
    with suppress(Exception):  # whatever is wrong with a backend shows in its rows
        backend(language).translate(_SMALLEST, semantics).monitor().step({"event": "a"})
        _other(language, semantics)


def warm_up(language: str, semantics: Semantics) -> None:
    """Read and run the other tree; for a fork."""
    with suppress(Exception):
        reader = _other(language, semantics).monitor()
        for start in range(len(_EVENTS)):
            monitor = reader.fork()
            for name in _EVENTS[start:]:
                monitor.step({"event": name})


@cache
def _other(language: str, semantics: Semantics) -> Specification:
    return backend(language).translate(_OTHER, semantics)
