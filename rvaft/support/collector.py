"""The garbage collector, where it costs time and finds nothing."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

RARE: Final = 50_000
"""The number of new objects after which rare collections look at these."""


@contextmanager
def no_collections() -> Iterator[None]:
    """Disable the collector, as while modules are imported or a large tree is read: nothing is cyclic garbage."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@contextmanager
def rare_collections() -> Iterator[None]:
    """Exempt the present objects from collections and make these rare, as while a log is monitored: events live
    briefly, monitors live long, and few objects are cyclic garbage.
    """
    thresholds = gc.get_threshold()
    gc.freeze()
    if thresholds[0]:
        gc.set_threshold(RARE, *thresholds[1:])
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
        gc.unfreeze()


def exempt_all() -> None:
    """Exempt all objects from later collections; at the end of a process these take a sixth of a short run."""
    gc.freeze()
