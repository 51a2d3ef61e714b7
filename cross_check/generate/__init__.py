"""Random traces that are led through a tree: they detect it, nearly detect it, or did before something disturbed them.

A scenario is drawn without enumerating scenarios (`scenarios`), its occurrences are put in a random order that keeps the
precedence (`orders`), and the variables get values under which the guards hold (`values`).
"""

from cross_check.generate.detections import PLAIN, WILD, Manner, NoTraceFound, detecting, guided
from cross_check.generate.disturb import Disturbance, NearMiss, disturbed, disturbed_by, near_miss, with_constant

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
