"""The monitor that people run: incremental, explained, and built without enumerating scenarios.

Two strategies share what is compiled from the tree (`plan`, `letters`): the general one follows the set of all partial matches
(`following`), the linear one serves `scattered` where nothing competes for events (`earliest`).
"""

from rvaft.engine.monitor import Engine, engine

__all__ = ["Engine", "engine"]
