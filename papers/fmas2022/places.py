"""Paths of the trees and of the default output folder."""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
"""The folder of the project, in which commands run."""
TREES: Final = ROOT / "trees" / "remote_inspection"
PRUNED: Final = TREES / "pruned.rvaft"
"""The tree of Figure 4b; its traces are in the same folder."""
GATES: Final = ROOT / "trees" / "gates"
OUT: Final = Path(__file__).parent / "out"
