"""The default monitor: incremental, explained, and built without enumerating scenarios.

A tree is compiled (`compiled_tree`). One of three strategies follows its partial matches:
`Contiguous` under `strict`, `projected` and `consecutive`; `LinearMonitor` under `scattered` if no
variables or events are contended; `ScatteredMatches` otherwise.
"""

from rvaft.engine.monitor import Engine

__all__ = ["Engine"]
