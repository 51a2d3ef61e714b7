"""Entry points of installed packages, which are looked up on use.

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
