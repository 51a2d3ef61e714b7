"""Publishers: listeners that report verdicts and detections to other programs, live from a port or as a file.

They are found by the entry points `rvaft.publishers` and imported when an option of `rvaft monitor` names one.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from types import TracebackType
from typing import Final, Self

from rvaft.errors import ToolFailed, ToolMissing
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitoring.run import Listener, MonitoredTrace

GROUP: Final = "rvaft.publishers"


class Publisher(Listener):
    """A listener that reports to a file, or to the clients of a port; a context manager.

    `name` names the tree in messages, `key` gives the key of a trace, and `warn` is called with each failure to report.
    """

    url = ""
    """The address that clients connect to, if there is a server."""

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
        """Whether the target is a port, not a file; raises `OptionError` for anything else."""

    @abstractmethod
    def close(self) -> None:
        """End the server, or write the rest of the file; raises `OSError` where this fails."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def publisher_class(name: str) -> type[Publisher]:
    """Import the publisher of that name; raises `ToolMissing` where there is none, and `ToolFailed` where it is broken."""
    for entry in entry_points(group=GROUP, name=name):
        try:
            made: type[Publisher] = entry.load()
        except Exception as error:  # a third party's module may fail in any way
            reason = f"it cannot be loaded: {type(error).__name__}: {error}"
            raise ToolFailed(f"the publisher {name}", reason=reason) from error
        return made
    raise ToolMissing(f"the publisher {name}", remedy="install rvaft again, in a checkout with pip install -e .")
