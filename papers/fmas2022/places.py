"""Where things are: the trees that everything is computed from, and where what is made goes unless
another folder is named.
"""

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
"""The folder of the project, in which commands run."""
TREES: Final = ROOT / "trees" / "remote_inspection"
PRUNED: Final = TREES / "pruned.rvaft"
"""The tree of Figure 4b, with its traces beside it."""
GATES: Final = ROOT / "trees" / "gates"
OUT: Final = Path(__file__).parent / "out"
