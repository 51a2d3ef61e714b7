"""The translation of a tree to a property.

Besides the language, the model and the reference, only this module reads gates and causality.
"""

from functools import lru_cache
from typing import assert_never

from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    Ignored,
    One,
    Part,
    Property,
    Sequence,
    Source,
    Times,
    Within,
    WithoutEvent,
)
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT, own_name


@lru_cache(maxsize=16)
def build(tree: RVAFT) -> Property:
    """Return the property of a whole tree, without simplification.

    >>> import rvaft
    >>> build(rvaft.loads("top sand a b;")).root.parts[0].source
    Source(node='a', number=1)
    """
    wholes: dict[Source, Part] = {}
    for node in tree.bottom_up():
        source = Source(node.name)
        own = _event(tree, node)
        below = _below(node, tuple(wholes[Source(child)] for child in node.children))
        both = [part for part in (own, below) if part is not None]
        if tree.causality is Causality.BOTTOM_UP:
            both.reverse()
        ordered: list[Part] = [Sequence(source, tuple(both))] if len(both) > 1 else both
        if node.when is not None:
            ordered.append(Condition(source, tree.guard(node.name) or node.when))
        whole = ordered[0] if len(ordered) == 1 else All(source, tuple(ordered))
        whole = whole if node.within is None else Within(source, (whole,), node.within)
        for number, clause in enumerate(node.without, 1):
            pattern, local = tree.instantiate(clause.on), tree.own_variables(clause)
            whole = WithoutEvent(source, (whole,), pattern, clause.when, local, clause.side, clause.duration, number)
        wholes[source] = whole
    ignored = tuple(Ignored(tree.instantiate(ignore.on), ignore.when) for ignore in tree.ignores)
    return Property(wholes[Source(tree.root)], tree, tree.alphabet, ignored, tree.time, wholes)


def _event(tree: RVAFT, node: Node) -> Event | Times | None:
    pattern = tree.pattern(node.name)
    if pattern is None:
        return None
    if node.times == 1 and not node.own_values:
        return Event(Source(node.name, 1), pattern)
    own, distinct = (tuple(map(own_name, names)) for names in (node.own_values, node.distinct))
    return Times(Source(node.name), pattern, node.times, own, distinct)


def _below(node: Node, parts: tuple[Part, ...]) -> Part | None:
    source = Source(node.name)
    match node.gate:
        case None:
            return None
        case Gate.AND:
            return All(source, parts)
        case Gate.OR:
            return One(source, parts)
        case Gate.SAND:
            return Sequence(source, parts)
        case Gate.SAND_RL:
            return Sequence(source, parts[::-1])
        case Gate.PAND:
            return EndInOrder(source, parts)
        case Gate.VOT:
            assert node.threshold is not None
            return AtLeast(source, parts, node.threshold)
        case _:
            assert_never(node.gate)
