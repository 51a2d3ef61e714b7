"""How specification languages compare: sizes, seconds and events per second of the same tree in each; what `rvaft compare` runs."""

from cross_check.benchmark.measurement import (
    Cell,
    Measurement,
    Outcome,
    Settings,
    Subject,
    cells_of,
    default_languages,
    gate_subjects,
    measured,
)

__all__ = [
    "Cell",
    "Measurement",
    "Outcome",
    "Settings",
    "Subject",
    "cells_of",
    "default_languages",
    "gate_subjects",
    "measured",
]
