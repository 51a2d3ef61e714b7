"""Pickles of what monitors know, and of nothing else.

A pickle can be made to run code when it is read. Only classes that hold data are let in, and what is written is held against the
same list, since it is better to fail at once than after the crash. This stops what is known to do harm; it is no reason to read
a pickle from somebody who is not trusted.
"""

import io
import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from rvaft.monitoring.reader import MAX_DEPTH

_MODULES: Final = frozenset(
    {
        "rvaft.analysis.pattern_index",
        "rvaft.model.guards",
        "rvaft.model.nodes",
        "rvaft.monitoring.monitor_set",
        "rvaft.monitoring.stream",
        "rvaft.monitoring.event_buffer",
        "rvaft.monitors",
        "rvaft.model.patterns",
        "rvaft.monitoring.near_misses",
        "rvaft.model.tree",
        "rvaft.model.verdict",
    }
)
"""Modules whose classes hold data. What runs commands, writes files or listens is not among them, and must not be: a pickle can
set the attributes of a class that it can name."""
_PACKAGE: Final = "rvaft.engine."
_OTHERS: Final = frozenset(
    {
        ("builtins", "dict"),
        ("builtins", "frozenset"),
        ("builtins", "list"),
        ("builtins", "set"),
        ("collections", "Counter"),
        ("collections", "OrderedDict"),
        ("collections", "defaultdict"),
        ("collections", "deque"),
        ("pathlib", "PosixPath"),
        ("pathlib", "WindowsPath"),
        ("rvaft.monitoring.reader", "_Repeating"),
        ("rvaft.model.tree", "_rebuilt"),
    }
)


def _admitted(module: str, name: str) -> bool:
    return (module, name) in _OTHERS or module in _MODULES or module.startswith(_PACKAGE)


class _Pickler(pickle.Pickler):
    """Writes what `_Unpickler` lets in and nothing else: better to fail at once than after the crash."""

    def reducer_override(self, obj: Any) -> Any:
        """Leave everything as it is, or raise `PicklingError`."""
        kind = obj if hasattr(obj, "__qualname__") else type(obj)
        if not _admitted(kind.__module__, kind.__qualname__):
            raise pickle.PicklingError(f"{kind.__module__}.{kind.__qualname__} has no place in a checkpoint")
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    """Lets in what a checkpoint consists of and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """A class by its name; raises `UnpicklingError` for anything that a checkpoint does not need."""
        if _admitted(module, name):
            found = super().find_class(module, name)
            # neither a function nor what a module has imported itself
            if (module, name) in _OTHERS or (isinstance(found, type) and found.__module__ == module):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} has no place in a checkpoint")


def pickled(state: object) -> bytes:
    """The state as bytes; raises `PicklingError` for what has no place there, and what `pickle` raises."""
    buffer = io.BytesIO()
    with _room():
        _Pickler(buffer, protocol=5).dump(state)
    return buffer.getvalue()


def unpickled(data: bytes | memoryview) -> Any:
    """The state again; raises `UnpicklingError` for what has no place there, and anything at all for what is damaged."""
    return _Unpickler(io.BytesIO(data)).load()


@contextmanager
def _room() -> Iterator[None]:
    """Let values be as deep as a trace may have them: `pickle` recurses twice for each level."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(limit + 4 * MAX_DEPTH)
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)
