"""The default monitor: incremental, explained, and built without enumerating scenarios.

A compiled tree is monitored by one of three strategies: `Contiguous` under `strict`, `projected`
and `consecutive`; `LinearMonitor` under `scattered` if it applies; else `ScatteredMatches`.
"""

from rvaft.engine.monitor import Engine

__all__ = ["Engine"]
