"""The monitor that people run: incremental, explained, and built without enumerating scenarios.

A tree is compiled (`compiled_tree`), and one of three strategies follows its partial matches:
`Contiguous` (`partial_matches`) under `strict` and `projected`; under `scattered` the general one,
or the linear one where nothing competes for events.
"""

from rvaft.engine.monitor import Engine

__all__ = ["Engine"]
