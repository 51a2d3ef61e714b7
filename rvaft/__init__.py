"""Attack-fault trees with runtime events.

`load` or `loads` reads a tree, `translate` makes a specification of it, `monitor` watches events for it.
Names are imported on first use: `import rvaft` alone costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rvaft.analysis.branches import Branch
    from rvaft.api import check, load, loads, monitor, translate
    from rvaft.asynchronous import on_detection, watch
    from rvaft.backend import Backend, Metrics, Specification, UnknownBackend, all_backends
    from rvaft.errors import (
        CheckpointError,
        LanguageError,
        NotExpressible,
        OptionError,
        RvaftError,
        TooLarge,
        ToolFailed,
        ToolMissing,
        TraceError,
        TreeError,
        WrongType,
    )
    from rvaft.language.printer import dumps
    from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Topic
    from rvaft.model.tree import RVAFT
    from rvaft.model.verdict import Semantics, Verdict
    from rvaft.monitors import Awaited, Ended, Explanation, Monitor, Pending, Repetition
    from rvaft.readers.bag import message_event
    from rvaft.readers.log import LogReader
    from rvaft.readers.registry import UnknownFormat, all_readers, live_events, read_log
    from rvaft.rules.rule import Finding, Severity

    __version__: str

__all__ = [
    "RVAFT",
    "Awaited",
    "Backend",
    "Branch",
    "Causality",
    "CheckpointError",
    "Ended",
    "EventType",
    "Explanation",
    "Finding",
    "Gate",
    "Ignore",
    "Kind",
    "LanguageError",
    "LogReader",
    "Metrics",
    "Monitor",
    "Node",
    "NotExpressible",
    "On",
    "OptionError",
    "Pending",
    "Repetition",
    "RvaftError",
    "Semantics",
    "Severity",
    "Specification",
    "TooLarge",
    "ToolFailed",
    "ToolMissing",
    "Topic",
    "TraceError",
    "TreeError",
    "UnknownBackend",
    "UnknownFormat",
    "Verdict",
    "WrongType",
    "__version__",
    "all_backends",
    "all_readers",
    "check",
    "dumps",
    "live_events",
    "load",
    "loads",
    "message_event",
    "monitor",
    "on_detection",
    "read_log",
    "translate",
    "watch",
]

_NAMES: Final = {
    "rvaft.api": ("check", "load", "loads", "monitor", "translate"),
    "rvaft.backend": ("Backend", "Metrics", "Specification", "UnknownBackend", "all_backends"),
    "rvaft.analysis.branches": ("Branch",),
    "rvaft.errors": (
        "LanguageError",
        "NotExpressible",
        "OptionError",
        "RvaftError",
        "ToolFailed",
        "ToolMissing",
        "TooLarge",
        "CheckpointError",
        "TraceError",
        "TreeError",
        "WrongType",
    ),
    "rvaft.readers.log": ("LogReader",),
    "rvaft.readers.bag": ("message_event",),
    "rvaft.readers.registry": ("UnknownFormat", "all_readers", "live_events", "read_log"),
    "rvaft.rules.rule": ("Finding", "Severity"),
    "rvaft.language.printer": ("dumps",),
    "rvaft.model.nodes": ("Causality", "EventType", "Gate", "Ignore", "Kind", "Node", "On", "Topic"),
    "rvaft.monitors": ("Awaited", "Ended", "Explanation", "Monitor", "Pending", "Repetition"),
    "rvaft.model.tree": ("RVAFT",),
    "rvaft.model.verdict": ("Semantics", "Verdict"),
    "rvaft.asynchronous": ("on_detection", "watch"),
}
_MODULE_OF: Final = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name == "__version__":
        value: object = import_module("importlib.metadata").version("rvaft")
    elif name in _MODULE_OF:
        value = getattr(import_module(_MODULE_OF[name]), name)
    else:
        raise AttributeError(f"module 'rvaft' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
