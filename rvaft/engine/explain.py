"""The explanation of a detection: one match of the lowest-numbered branch that has one (semantics, section 4)."""

from itertools import islice

from rvaft.branches import branches
from rvaft.engine.earliest import Earliest
from rvaft.engine.finders import EarliestMatches, Finder, FollowedMatches, Found, whole
from rvaft.engine.following import Following
from rvaft.engine.numbers import lowest_number, or_gates
from rvaft.model import Gate, Kind
from rvaft.monitors import Explanation
from rvaft.tree import RVAFT
from rvaft.values import Json

BRANCHES = 20_000
"""How many branches of a kind are looked at."""

EFFORT = 20_000_000
"""How many nodes are looked at in search of a lower branch."""


def explain(tree: RVAFT, strategy: Following | Earliest) -> Explanation:
    """The explanation after detection; its branch is None where there are too many to find the lowest."""
    finder: Finder
    finder = EarliestMatches(tree, strategy) if isinstance(strategy, Earliest) else FollowedMatches(tree, strategy)
    part = tree.part_of
    number: int | None
    if part is None:
        found, certain = _lowest(tree, finder)
        number = lowest_number(tree, _choices(tree, found)) if certain else None
    elif part.branch is None and part.kind is not None:
        found, number = _lowest_of_kind(part.tree, finder, part.kind)
    else:
        found, number = _any(finder), part.branch
    return _explanation(whole(tree), found, number)


def _any(finder: Finder) -> Found:
    found = finder.find({})
    assert found is not None
    return found


def _choices(tree: RVAFT, found: Found) -> dict[str, str]:
    """What the scenario of a match chooses."""
    return {
        name: kept[0] for name, kept in found.kept.items() if name in tree.nodes and tree.nodes[name].gate is Gate.OR
    }


def _lowest(tree: RVAFT, finder: Finder) -> tuple[Found, bool]:
    """The match whose branch has the lowest number, and whether that is certain.

    The digit that counts most is made as small as it can be, then the next. A gate that the best match so far does not reach has
    digit 0 in its branch already.
    """
    found = _any(finder)
    fixed: dict[str, str] = {}
    effort = 0
    for name in reversed(or_gates(tree)):
        children = tree.nodes[name].children
        digit = children.index(found.kept[name][0]) if name in found.kept else 0
        for lower in range(digit):
            if finder.possible(name, children[lower]):
                effort += len(tree.nodes)
                if effort > EFFORT:
                    return found, False
                better = finder.find({**fixed, name: children[lower]})
                if better is not None:
                    found, digit = better, lower
                    break
        fixed[name] = children[digit]
    return found, True


def _lowest_of_kind(tree: RVAFT, finder: Finder, kind: Kind) -> tuple[Found, int | None]:
    """The same among the branches of a kind, which a match may be in with what its scenario does not contain."""
    for branch in islice(branches(tree), BRANCHES):
        if kind in branch.kinds:
            found = finder.find(branch.choices)
            if found is not None:
                return found, branch.number
    return _any(finder), None


def _explanation(tree: RVAFT, found: Found, number: int | None) -> Explanation:
    nodes = ((tree.nodes[name], set(kept)) for name, kept in found.kept.items() if name in tree.nodes)
    scenario = {node.name: tuple(child for child in node.children if child in kept) for node, kept in nodes}
    kinds = (tree.nodes[name].kind for name in scenario)
    variables: dict[str, Json] = {}
    for step in found.steps:
        variables = {**step.values, **variables}
    return Explanation(
        branch=number,
        kinds=frozenset(kind for kind in kinds if kind is not None),
        matched={step.node: step.position for step in found.steps},
        variables=variables,
        scenario=scenario,
    )
