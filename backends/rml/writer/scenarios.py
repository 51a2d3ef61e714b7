"""The feasible scenarios of a tree as sets of bits: bit i stands for the i-th occurrence or scenario (semantics, section 2).

Under `scattered` a VOT keeps exactly K children: one more never helps, since any position may be skipped.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from backends.rml.writer.observations import own_variables
from rvaft.analysis.normal_form import Op, body
from rvaft.analysis.scenarios import Kept, resolutions
from rvaft.errors import TreeError
from rvaft.model.guards import variables
from rvaft.model.nodes import Causality
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, mask_of, union


@dataclass(frozen=True, slots=True)
class BitScenario:
    """Its occurrences, what comes before each of them (generators of the precedence), and its nodes with a guard to check."""

    occurrences: int
    before: Mapping[int, int]
    guards: frozenset[str]


def feasible_scenarios(tree: RVAFT, semantics: Semantics, *, limit: int) -> list[BitScenario]:
    """The feasible scenarios, each once.

    Raises `TooLarge` beyond `limit`; `TreeError` where there is none, where one has no occurrence, or leaves a guard unbound.
    """
    index = {name: position for position, name in enumerate(tree.occurrences)}
    found: dict[object, BitScenario] = {}
    for kept in resolutions(tree, minimal=semantics is Semantics.SCATTERED, limit=limit):
        one = _scenario(tree, kept, index)
        if not tree.shared or _is_acyclic(one):
            found.setdefault((one.occurrences, tuple(one.before.items()), one.guards), one)
    if not found:
        raise TreeError("no scenario is feasible", rule="no-scenario", nodes=[tree.root])
    for scenario in found.values():
        _check(tree, scenario)
    return list(found.values())


def _scenario(tree: RVAFT, kept: Kept, index: Mapping[str, int]) -> BitScenario:
    """One pass up for the events in each part, one pass down for what comes before it."""
    events: dict[str, int] = {}
    for name in reversed(tuple(kept)):
        own = 1 << index[name] if name in index else 0
        events[name] = own | union(events[child] for child in kept[name])
    top_down = tree.causality is Causality.TOP_DOWN
    earlier, before = dict.fromkeys(kept, 0), dict[int, int]()
    for name, children in kept.items():
        above, joined = earlier[name], body(tree.nodes[name])
        if name in index:
            own = 1 << index[name]
            before[index[name]] = above if top_down else above | events[name] & ~own
            above |= own if top_down else 0
        for child in joined.children if joined.op is Op.SEQUENCE else children:
            earlier[child] |= above
            above |= events[child] if joined.op is Op.SEQUENCE else 0
    guards = {name for name in kept if (when := tree.nodes[name].when) is not None and variables(when)}
    return BitScenario(events[tree.root], before, frozenset(guards))


def _is_acyclic(scenario: BitScenario) -> bool:
    """Whether its occurrences have an order in which they can happen."""
    left = scenario.occurrences
    while left:
        now = mask_of(index for index in bits(left) if not scenario.before[index] & left)
        if not now:
            return False
        left &= ~now
    return True


def _check(tree: RVAFT, scenario: BitScenario) -> None:
    if not scenario.occurrences:
        raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario", nodes=[tree.root])
    ons = [tree.nodes[tree.occurrences[index]].on for index in bits(scenario.occurrences)] if scenario.guards else []
    bound = {name for on in ons for name in own_variables(on)}
    for name in sorted(scenario.guards):
        when = tree.nodes[name].when
        unbound = [variable for variable in (variables(when) if when is not None else ()) if variable not in bound]
        if unbound:
            message = f"the guard of {name} speaks of {unbound[0]}, which nothing binds in one of its scenarios"
            raise TreeError(message, rule="unbound-variable", nodes=[name])
