"""The branches of a tree that logs exercised, and the progress in the others.

A branch *needs* n events: the occurrences of its smallest feasible scenario. A log *reached* m of n
if n - m is the minimum number of missing occurrences, over all prefixes and all partial matches. So
m is n if and only if the branch was detected.
"""

from rvaft.coverage.measure import DEFAULT_BRANCHES, BranchCoverage, Coverage, CoverageReport
from rvaft.coverage.report import json_text, table_text

__all__ = ["DEFAULT_BRANCHES", "BranchCoverage", "Coverage", "CoverageReport", "json_text", "table_text"]
