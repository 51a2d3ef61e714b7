"""What one connection has read: the monitor of the tree, and where they are asked for those of its parts."""

from collections.abc import Iterator, Mapping
from enum import StrEnum
from itertools import islice
from typing import Final, Self

from rvaft.api import monitor
from rvaft.branches import branches
from rvaft.errors import TooLarge
from rvaft.model import Kind
from rvaft.monitors import Explanation, Monitor
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

MOST: Final = 1_000
"""How many branches are monitored one by one."""


class Per(StrEnum):
    """What has a verdict of its own."""

    TREE = "tree"
    BRANCH = "branch"
    KIND = "kind"


class Watched:
    """A monitor that gives up where it would raise `TooLarge`; `failure` then says why."""

    def __init__(self, monitor: Monitor, failure: str | None = None) -> None:
        self._monitor = monitor
        self.failure = failure

    def fork(self) -> Self:
        """An independent one that has read the same events."""
        return type(self)(self._monitor.fork(), self.failure)

    def read(self, event: Json) -> None:
        """Read one event."""
        if self.failure is None:
            try:
                self._monitor.step(event)
            except TooLarge as error:
                self.failure = str(error)

    @property
    def verdict(self) -> Verdict | None:
        """The verdict so far, or None after it gave up."""
        return None if self.failure is not None else self._monitor.verdict

    @property
    def explanation(self) -> Explanation | None:
        """After detection, how the tree matched."""
        return self._monitor.explanation


class Session:
    """Monitors that read the same events: `whole` of the tree, `parts` of its branches or kinds, by number or name."""

    def __init__(self, whole: Watched, parts: Mapping[str, Watched]) -> None:
        self.whole = whole
        self.parts = parts

    def fork(self) -> Self:
        """An independent session that has read the same events."""
        return type(self)(self.whole.fork(), {label: part.fork() for label, part in self.parts.items()})

    def read(self, event: Json) -> None:
        """Read one event."""
        self.whole.read(event)
        for part in self.parts.values():
            part.read(event)


def session(tree: RVAFT, semantics: Semantics | str = Semantics.PROJECTED, *, per: Per = Per.TREE) -> Session:
    """A session that has read nothing; the tree may be the part for one branch or kind.

    Raises `TreeError` for a tree that breaks a rule, and `TooLarge` beyond `MOST` branches to monitor one by one.
    """
    parts = {label: Watched(part) for label, part in _parts(tree, semantics, per)}
    return Session(Watched(monitor(tree, semantics=semantics)), parts)


def _parts(tree: RVAFT, semantics: Semantics | str, per: Per) -> Iterator[tuple[str, Monitor]]:
    match per:
        case Per.TREE:
            return
        case Per.BRANCH:
            numbers = [branch.number for branch in islice(branches(tree), MOST + 1)]
            if len(numbers) > MOST:
                raise TooLarge(f"a monitor for each branch of {tree.root}", limit=MOST)
            for number in numbers:
                yield str(number), monitor(tree, semantics=semantics, branch=number)
        case Per.KIND:
            present = {node.kind for node in tree.top_down()}
            for kind in Kind:
                if kind in present:
                    yield kind.value, monitor(tree, semantics=semantics, kind=kind)
