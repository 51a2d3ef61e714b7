"""How specification languages compare: sizes, seconds and events per second of the same tree in each.

A *cell* is a tree under a semantics in a language (`plan`). Each is measured in a process of its own (`running`, `measuring`) and
gives a `Row`, which the other modules write: as text, CSV, LaTeX, and plots.
"""

from cross_check.benchmark.measurement import Outcome, Row, measured
from cross_check.benchmark.plan import Cell, Settings, Subject, cells_of, default_languages, gate_subjects

__all__ = [
    "Cell",
    "Outcome",
    "Row",
    "Settings",
    "Subject",
    "cells_of",
    "default_languages",
    "gate_subjects",
    "measured",
]
