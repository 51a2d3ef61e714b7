"""The reference: what a tree means, written out as the definition reads.

Short, slow, obvious. Every function quotes the clause of the definition it implements. Nothing but
`cross_check` and tests may import it, and it shares nothing with what it is held against except the
tree itself: equality, matching, guards, scenarios, branches and relevance are all written here a
second time.
"""

from rvaft.semantics.matches import matches
from rvaft.semantics.reference import Reference
from rvaft.semantics.scenarios import Scenario, branches, feasible_scenarios, scenarios

__all__ = ["Reference", "Scenario", "branches", "feasible_scenarios", "matches", "scenarios"]
