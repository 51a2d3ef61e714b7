"""A conformance suite for backends.

    from backends.conformance import run

    report = run(MyBackend(), oracle, required=without_variables)
    assert report.passed, report

The oracle returns a monitor for a tree and a semantics, and shares nothing with the backend.
Refusals (`NotExpressible`) and too large texts (`TooLarge`) are counted separately; a refusal of a
required tree is a failure. If a backend is not `readable`, only its texts are checked.

Every operator of guards and every construct has an example: a tree, a detecting trace, and a trace
that fails only this operator or construct. A backend refuses the tree, or its text gives both
verdicts.
"""

from backends.conformance.requirements import (
    Required,
    everything,
    no_texts_of_several,
    no_variables_of_items,
    scattered_by_single_events,
    without_variables,
    without_variables_or_determinate,
)
from backends.conformance.suite import ConformanceFailure, Oracle, Report, run, traces
from backends.conformance.trees import Example, examples, rows

__all__ = [
    "ConformanceFailure",
    "Example",
    "Oracle",
    "Report",
    "Required",
    "everything",
    "examples",
    "no_texts_of_several",
    "no_variables_of_items",
    "rows",
    "run",
    "scattered_by_single_events",
    "traces",
    "without_variables",
    "without_variables_or_determinate",
]
