"""The default monitor: incremental, explained, and built without enumerating scenarios.

A compiled tree is monitored by one of these strategies (see `selection`): `ContiguousMatches` under
`strict`, `projected` and `consecutive`, except for large trees under the first two, which
`LargeContiguousMatches` follows; `LinearMonitor` under `scattered` if it applies; else
`ScatteredMatches`.
"""

from rvaft.engine.monitor import Engine

__all__ = ["Engine"]
