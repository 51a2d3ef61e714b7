"""Publishers: listeners that report to a file or to clients of a port, found by entry points."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Final, Self

from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.stream.listeners import Listener
from rvaft.stream.verdict_change import MonitoredTrace
from rvaft.support.plugins import entry_points

GROUP: Final = "rvaft.publishers"


class Publisher(Listener):
    """A context manager that reports to a file or to clients of a port.

    `name` names the tree in messages, `key` returns the key of a trace, `warn` receives failures.
    """

    url = ""

    @abstractmethod
    def __init__(
        self,
        tree: RVAFT,
        target: str,
        *,
        name: str = "tree",
        key: Callable[[MonitoredTrace], Mapping[str, Json]] = lambda _: {},
        warn: Callable[[str], object] = lambda _: None,
    ) -> None: ...

    @classmethod
    @abstractmethod
    def serves(cls, target: str) -> bool:
        """Whether the target is a port, not a file; raises `OptionError`."""

    @abstractmethod
    def close(self) -> None:
        """Stop the server or finish the file; raises `OSError`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def publisher_class(name: str) -> type[Publisher]:
    """Import the publisher of that name; raises `ToolMissing` and `ToolFailed`."""
    for entry in entry_points(group=GROUP, name=name):
        try:
            made: type[Publisher] = entry.load()
        except Exception as error:
            reason = f"it cannot be loaded: {type(error).__name__}: {error}"
            raise ToolFailed(f"the publisher {name}", reason=reason) from error
        return made
    raise ToolMissing(f"the publisher {name}", remedy="install rvaft again, in a checkout with pip install -e .")
