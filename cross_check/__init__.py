"""Comparison of specifications by proofs and differential tests over traces.

>>> import rvaft
>>> from cross_check import cross_check
>>> for result in cross_check(rvaft.loads("top or a s; s sand b c;"), "strict", backends=["rml"]):
...     print(result.participant, result.text)
reference baseline
engine proved
rml proved
"""

from cross_check.comparison import cross_check
from cross_check.results import Difference, Job, Result, Status
from cross_check.traces import Effort

__all__ = ["Difference", "Effort", "Job", "Result", "Status", "cross_check"]
