"""Random traces that are led through a tree: they detect it, nearly detect it, or did before something disturbed them."""

from cross_check.generate.disturbances import (
    Disturbance,
    NearMiss,
    disturbed,
    disturbed_by,
    near_miss,
    with_constant,
)
from cross_check.generate.traces import PLAIN, WILD, Manner, NoTraceFound, detecting, guided

__all__ = [
    "PLAIN",
    "WILD",
    "Disturbance",
    "Manner",
    "NearMiss",
    "NoTraceFound",
    "detecting",
    "disturbed",
    "disturbed_by",
    "guided",
    "near_miss",
    "with_constant",
]
