"""When a partial match under `scattered` need not be kept without the event it could take.

Under `scattered` a configuration may pass over every event. Passing over is of no use where the occurrence belongs to all that
the configuration can still become and taking it costs nothing: no variable is bound by it, no choice made. Then whatever the
configuration could do later, it can do with the event taken, within the same branch (so that the explanation still finds the lowest).
"""

from rvaft.engine.configuration import Configuration
from rvaft.engine.matching import Matching
from rvaft.engine.progress import MORE, POSSIBLE, SURE, TOUCHED
from rvaft.model import Gate


def commits(matching: Matching, before: Configuration, after: Configuration, node: int) -> bool:
    """Whether the configuration after a node's event can do all that the one before it can."""
    plan, progress = matching.plan, matching.progress
    if after.binding != before.binding or after.closed != before.closed:
        return False
    if plan.core and matching.core.free:
        return False
    if any(name not in before.binding for name in plan.exported[node]):
        return False
    if node not in matching.core.members:
        if plan.own[node] and not plan.top_down and not _ends(matching, node, progress.inner(after, node)):
            return False
        child = node
        while plan.parent[child] >= 0:
            if not _keeps(matching, before, after, child):
                return False
            child = plan.parent[child]
    return not plan.core or matching.core.settled(before, node)


def _ends(matching: Matching, node: int, flags: int) -> bool:
    """Whether what stands before the event has nothing more to come in the same branch."""
    return bool(flags & SURE) and not (flags & MORE and matching.plan.chooses >> node & 1)


def _keeps(matching: Matching, before: Configuration, after: Configuration, child: int) -> bool:
    """Whether a child's parent loses nothing by what happened below the child."""
    plan, progress = matching.plan, matching.progress
    gate = plan.parent[child]
    siblings = plan.children[gate]
    match plan.gates[gate]:
        case Gate.AND | None:
            return True
        case Gate.SAND | Gate.SAND_RL:
            elders = siblings[: plan.slot[child]]
            return all(_ends(matching, elder, progress.flags(before, elder)) for elder in elders)
        case Gate.OR | Gate.VOT as kind:
            if progress.flags(before, child) & TOUCHED:
                return True
            able = sum(bool(progress.flags(before, sibling) & POSSIBLE) for sibling in siblings)
            if able <= (1 if kind is Gate.OR else plan.thresholds[gate]):
                return True
            whole = bool(progress.flags(after, child) & SURE) and not plan.chooses >> child & 1
            return kind is Gate.VOT and whole
