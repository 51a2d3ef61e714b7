"""The reference evaluator: the definition of the semantics as a program, slow and independent.

Each function quotes the clause of the definition that it implements. Only `cross_check` and tests
may import it. It implements equality, matching, guards, scenarios, branches and relevance again.
"""

from rvaft.semantics.matches import matches
from rvaft.semantics.reference import Reference
from rvaft.semantics.scenarios import ReferenceScenario, branches, feasible_scenarios, scenarios

__all__ = ["Reference", "ReferenceScenario", "branches", "feasible_scenarios", "matches", "scenarios"]
