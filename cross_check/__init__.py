"""Comparison of specifications by proofs and differential tests over traces.

>>> import rvaft
>>> from cross_check import cross_check
>>> for result in cross_check(rvaft.loads("top or a s; s sand b c;"), "strict", backends=["rml"]):
...     print(result.participant, result.text)
reference baseline
engine proved
rml proved
"""

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from cross_check.comparison import cross_check
    from cross_check.results import Difference, Job, Result, Status
    from cross_check.traces import Effort

__all__ = ["Difference", "Effort", "Job", "Result", "Status", "cross_check"]

_MODULE_OF: Final = {
    "cross_check": "comparison",
    **dict.fromkeys(("Difference", "Job", "Result", "Status"), "results"),
    "Effort": "traces",
}
"""The modules of the names, which are imported on first use: generated traces need no programs of others."""


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'cross_check' has no attribute {name!r}")
    value: object = getattr(import_module(f"cross_check.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
