"""Which branches of a tree some logs exercised, and how far they came in the others.

A branch *needs* n events: as many as the smallest of its feasible scenarios has occurrences. It was
*reached* m of n by a log when, over all prefixes and all partial matches of the branch in them
(semantics, section 4), the fewest occurrences that one of them lacked to the end of a scenario were
n - m. So m is n exactly where the branch was detected, and without KofN it is the largest number of
its occurrences that were matched.
"""

from rvaft.coverage.measure import DEFAULT_BRANCHES, BranchCoverage, Coverage, CoverageReport
from rvaft.coverage.report import json_text, table_text

__all__ = ["DEFAULT_BRANCHES", "BranchCoverage", "Coverage", "CoverageReport", "json_text", "table_text"]
