"""What may be left out of a tree, if the probability of its root may fall by a little (`prune`)."""

from dataclasses import dataclass, replace

from rvaft.risk.model import Op, RiskError, RiskTree, without
from rvaft.risk.probability import Analysis


@dataclass(frozen=True, slots=True)
class Pruning:
    """The nodes to prune, and the probability of the root before and after.

    >>> Pruning(("a", "b"), 0.5, 0.25).lost
    0.25
    """

    nodes: tuple[str, ...]
    before: float
    after: float

    @property
    def lost(self) -> float:
        """By how much the probability falls: the error that the pruned tree makes."""
        return self.before - self.after


def prunable(tree: RiskTree, time: float, most: float) -> Pruning:
    """Return nodes without which the probability of the root falls by at most `most`, the least likely first.

    Only children of `or` are among them: another gate without a child would mean something else. One
    child of each `or` stays. Raises the errors of `Analysis`.

    >>> import rvaft
    >>> from rvaft.risk.model import of_tree
    >>> form = of_tree(rvaft.loads("t or a b c; a prob=.1; b prob=1e-9; c prob=1e-12;"))
    >>> prunable(form, 0.0, 1e-6).nodes
    ('b', 'c')
    """
    if tree.dependencies or tree.restrictions:
        raise RiskError("dependencies and restrictions of Galileo are not pruned")
    before = Analysis(tree).at(time)
    parents: dict[str, list[str]] = {}
    for name in tree.order():
        for child in tree.children(name):
            parents.setdefault(child, []).append(name)
    candidates = [name for name, above in parents.items() if all(tree.gates[one].op is Op.OR for one in above)]
    losses = {name: before - Analysis(without(tree, name)).at(time) for name in candidates}
    kept, after, pruned = tree, before, list[str]()
    for name in sorted((name for name in candidates if losses[name] <= most), key=lambda name: (losses[name], name)):
        gone = {*pruned, name}
        if any(all(child in gone for child in tree.children(above)) for above in parents[name]):
            continue
        if name not in kept.order():
            continue
        fewer = without(kept, name)
        now = Analysis(fewer).at(time)
        if before - now <= most:
            kept, after = fewer, now
            pruned.append(name)
    cut = {name: replace(gate, children=()) for name, gate in tree.gates.items() if name in pruned}
    met = replace(tree, gates={**tree.gates, **cut}).order()
    return Pruning(tuple([name for name in met if name in pruned]), before, after)
