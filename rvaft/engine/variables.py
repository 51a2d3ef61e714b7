"""Which variables tie the nodes of a tree together, and which concern one event alone.

A variable that only one node's event and that node's own guard mention is no variable of the tree at all: whether the event fits
can be said from the event. The guard then is a *filter* of the event; what remains are the *exported* variables, which a
configuration has to remember, and the guards that wait for them.
"""

from collections import Counter
from collections.abc import Hashable, Mapping
from typing import Final

from rvaft.guards import Guard
from rvaft.guards import variables as guard_variables
from rvaft.model import Node
from rvaft.patterns import rigid_variables
from rvaft.tree import RVAFT
from rvaft.values import Json, key

_PLAIN: Final = (str, int, float, bool, type(None))


class Uses:
    """Who mentions which variable in a tree."""

    def __init__(self, tree: RVAFT) -> None:
        self._bound: dict[str, tuple[str, ...]] = {}
        mentioned: Counter[str] = Counter()
        for node in tree.top_down():
            pattern = tree.pattern(node.name)
            self._bound[node.name] = () if pattern is None else rigid_variables(pattern)
            mentioned.update({*self._bound[node.name], *_of_guard(node)})
        self._mentioned = mentioned

    def _private(self, node: Node) -> frozenset[str]:
        """The variables that nothing but this node mentions."""
        return frozenset(name for name in self._bound[node.name] if self._mentioned[name] == 1)

    def filter(self, node: Node) -> Guard | None:
        """The node's guard where its event alone decides it."""
        names = _of_guard(node)
        return node.when if names and names <= self._private(node) else None

    def waiting(self, node: Node) -> Guard | None:
        """The node's guard where it is constant or needs variables that a configuration remembers."""
        return None if self.filter(node) is not None else node.when

    def exported(self, node: Node) -> tuple[str, ...]:
        """The variables of the node's event that a configuration has to remember."""
        waits = self.waiting(node)
        local = self._private(node) - (frozenset() if waits is None else frozenset(guard_variables(waits)))
        return tuple(name for name in self._bound[node.name] if name not in local)


def _of_guard(node: Node) -> frozenset[str]:
    return frozenset() if node.when is None else frozenset(guard_variables(node.when))


def fingerprint(binding: Mapping[str, Json]) -> Hashable:
    """A hashable stand-in for a binding. Finer than equality of values: a guard may tell 2**60 from 2.0**60, since whole
    numbers are exact and the rest are IEEE doubles.
    """  # noqa: D205
    return frozenset((name, exact(value)) for name, value in binding.items())


def exact(value: Json) -> Hashable:
    """The same for one value."""
    kind = type(value)
    return (kind, value) if kind in _PLAIN else (key(value), _kinds(value))


def _kinds(value: Json) -> Hashable:
    """The types of the numbers in a value."""
    if not isinstance(value, (Mapping, list)):
        return (type(value),)
    found: list[Hashable] = []
    agenda = [value]
    while agenda:
        part = agenda.pop()
        if isinstance(part, Mapping):
            agenda.extend(part[name] for name in sorted(part))
        elif isinstance(part, list):
            agenda.extend(part)
        else:
            found.append(type(part))
    return tuple(found)
