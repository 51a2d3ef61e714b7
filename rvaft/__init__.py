"""Attack-fault trees with runtime events.

`load` and `loads` read a tree, `translate` makes a specification of it, and `monitor` makes a
monitor. Names are imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rvaft.api import (
        RVAFT,
        Absence,
        Awaited,
        AwaitedAbsence,
        Backend,
        Branch,
        Causality,
        CheckpointError,
        Ended,
        EventType,
        Explanation,
        Finding,
        Gate,
        Ignore,
        Kind,
        LanguageError,
        Metrics,
        Monitor,
        Node,
        NotExpressible,
        NoVerdict,
        On,
        OptionError,
        Pending,
        Repetition,
        RvaftError,
        Semantics,
        Severity,
        Side,
        Specification,
        TooLarge,
        ToolFailed,
        ToolMissing,
        ToolTimeout,
        Topic,
        TraceError,
        TreeError,
        UnknownBackend,
        Verdict,
        Without,
        WrongType,
        all_backends,
        analysis,
        attacks,
        branches,
        check,
        cut_sets,
        dumps,
        load,
        loads,
        log,
        monitor,
        near_misses,
        risk_monitor,
        to_dot,
        translate,
    )
    from rvaft.asynchronous import on_detection, watch
    from rvaft.readers.bag import message_event
    from rvaft.readers.registry import LogReader, UnknownFormat, all_readers, live_events, read_log

    __version__: str

__all__ = [
    "RVAFT",
    "Absence",
    "Awaited",
    "AwaitedAbsence",
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
    "NoVerdict",
    "Node",
    "NotExpressible",
    "On",
    "OptionError",
    "Pending",
    "Repetition",
    "RvaftError",
    "Semantics",
    "Severity",
    "Side",
    "Specification",
    "TooLarge",
    "ToolFailed",
    "ToolMissing",
    "ToolTimeout",
    "Topic",
    "TraceError",
    "TreeError",
    "UnknownBackend",
    "UnknownFormat",
    "Verdict",
    "Without",
    "WrongType",
    "__version__",
    "all_backends",
    "all_readers",
    "analysis",
    "attacks",
    "branches",
    "check",
    "cut_sets",
    "dumps",
    "live_events",
    "load",
    "loads",
    "log",
    "message_event",
    "monitor",
    "near_misses",
    "on_detection",
    "read_log",
    "risk_monitor",
    "to_dot",
    "translate",
    "watch",
]

_ELSEWHERE: Final = {
    "rvaft.asynchronous": ("on_detection", "watch"),
    "rvaft.readers.bag": ("message_event",),
    "rvaft.readers.registry": (
        "LogReader",
        "UnknownFormat",
        "all_readers",
        "live_events",
        "read_log",
    ),
}
_MODULE_OF: Final = {name: "rvaft.api" for name in __all__ if name != "__version__"} | {
    name: module for module, names in _ELSEWHERE.items() for name in names
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        value: object = import_module("rvaft.support.plugins").version()
    elif name in _MODULE_OF:
        value = getattr(import_module(_MODULE_OF[name]), name)
    else:
        raise AttributeError(f"module 'rvaft' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
