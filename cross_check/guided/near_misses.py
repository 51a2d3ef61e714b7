"""Random traces that are one edit away from a detection."""

from random import Random
from typing import NamedTuple

from cross_check.guided.detection import ATTEMPTS, WILD, Manner, detecting
from cross_check.guided.disturbing import Disturbance, disturbed_by
from rvaft.engine import engine
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

_TRIES = 3


class NearMiss(NamedTuple):
    """A trace in which the tree is not detected, the detecting one it came from, and the edit that lies between."""

    trace: list[Json]
    detecting: list[Json]
    edit: Disturbance


def near_miss(
    random: Random,
    tree: RVAFT,
    semantics: Semantics = Semantics.PROJECTED,
    *,
    manner: Manner = WILD,
    longest: int | None = None,
    attempts: int = ATTEMPTS,
) -> NearMiss:
    """A near miss; raises `NoTraceFound` where no detecting trace is found, and what the monitor raises (`TooLarge`)."""
    detected = detecting(random, tree, semantics, manner=manner, longest=longest, attempts=attempts)
    for kind in random.sample(list(Disturbance), len(Disturbance)):
        for _ in range(_TRIES):
            edited = disturbed_by(kind, random, detected, tree)
            if edited is None:
                break
            if (longest is None or len(edited) <= longest) and not _detected(tree, semantics, edited):
                return NearMiss(edited, detected, kind)
    # The tree is detected at the last event and not before.
    return NearMiss(detected[:-1], detected, Disturbance.MISSING)


def _detected(tree: RVAFT, semantics: Semantics, trace: list[Json]) -> bool:
    return Verdict.TRUE in engine(tree, semantics).run(trace)
