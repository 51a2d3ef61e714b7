"""Steps that make a tree and a trace smaller together: each yields smaller candidates, and does not know what they are for."""

from cross_check.reductions.annotations import (
    plain_ignores,
    plain_nodes,
    top_down,
    without_events,
    without_guards,
    without_unused,
)
from cross_check.reductions.events import shorter_trace, simpler_values, smaller_events
from cross_check.reductions.names import plain_event_names, plain_names
from cross_check.reductions.pair import Pair, Reduction
from cross_check.reductions.structure import (
    child_for_gate,
    fewer_children,
    gates_to_leaves,
    lower_gates,
    other_root,
    unshared_leaves,
)
from cross_check.reductions.terms import constant_variables, simpler_literals, simpler_patterns, smaller_arguments

__all__ = ["REDUCTIONS", "Pair", "Reduction"]

REDUCTIONS: tuple[Reduction, ...] = (
    shorter_trace,
    other_root,
    child_for_gate,
    gates_to_leaves,
    fewer_children,
    unshared_leaves,
    shorter_trace,
    plain_nodes,
    without_guards,
    without_events,
    plain_ignores,
    without_unused,
    top_down,
    lower_gates,
    constant_variables,
    smaller_arguments,
    simpler_patterns,
    smaller_events,
    simpler_literals,
    plain_event_names,
    plain_names,
    simpler_values,
)
"""All of them, those first that take most away."""
