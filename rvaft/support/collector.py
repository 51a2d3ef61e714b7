"""The garbage collector, where it costs time and finds nothing."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


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


def exempt_all() -> None:
    """Exempt all objects from later collections; at the end of a process these take a sixth of a short run."""
    gc.freeze()
