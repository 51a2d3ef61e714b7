"""Entry points of installed packages and the version of this one, which are looked up on use.

Importing `importlib.metadata` takes a tenth of the start of a command.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints


def entry_points(**chosen: Any) -> "EntryPoints":
    """Return the entry points of a `group`, or that with a `name`."""
    found: EntryPoints = import_module("importlib.metadata").entry_points(**chosen)
    return found


def version() -> str:
    """Return the version of rvaft."""
    found: str = import_module("importlib.metadata").version("rvaft")
    return found


def display(name: str) -> Any:
    """Return the function of a higher layer that displays a value of a lower one, such as a tree."""
    (found,) = entry_points(group="rvaft.displays", name=name)
    return found.load()
