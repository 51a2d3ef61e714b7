"""Faults in the translation into automata."""

from typing import Final

from tests.cross_check.faults.mistaken import loose_text
from tests.cross_check.faults.planting import Fault, both, edit, put

_AT: Final = "backends.automaton."


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return Fault(f"automaton translation: {name}", "automaton", why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "sand as and",
        "The children of a `sand` may come in any order.",
        "structure:_Builder._gate",
        "return self._group(How.SEQUENCE, feasible)\n",
        "return self._group(How.ALL, feasible)\n",
    ),
    _fault(
        "sand_rl from left to right",
        "The first child of a `sand_rl` is wanted first.",
        "structure:_Builder._gate",
        "feasible[::-1]",
        "feasible",
    ),
    _fault(
        "K+1 for K",
        "K children are not enough.",
        "structure:_Builder._vote",
        "tuple(feasible), least)",
        "tuple(feasible), least + 1)",
    ),
    _fault(
        "exactly K for at least K",
        "What follows a vote is refused after one child more than K.",
        "plan:_Layout._choices",
        "several and self.at_least",
        "False",
    ),
    _fault(
        "a dropped guard",
        "A node with a guard is a node without one.",
        "structure:_Builder._node",
        "[condition, *sequence]",
        "sequence or [condition]",
    ),
    _fault(
        "a guard at the wrong binder",
        "A guard is asked at the first event alone, where its other variable has no value yet.",
        "plan:_Layout.plan",
        "if events >> index & 1)",
        "if events & -events == 1 << index)",
    ),
    Fault(
        "automaton translation: `>=` for `>`",
        "automaton",
        "A value on the bound of a guard is taken.",
        put(f"{_AT}hoa:guard_text", loose_text),
    ),
    _fault(
        "a guard that is broken on a choice to come forgotten",
        "A choice brings in a guard that did not hold when its variable was bound.",
        "configurations:Moves.breaking",
        "broken=move.target.broken | broken",
        "broken=move.target.broken",
    ),
    _fault(
        "a shared node doubled",
        "A node below two parents wants two events.",
        "structure:_Builder.build",
        "[of[child] for child in node.children]",
        "[None if of[child] is None else self._new(self.parts[of[child]]) for child in node.children]",
    ),
    _fault(
        "precedence lost through a nested gate",
        "What comes before a gate does not come before what is below its children.",
        "plan:_Layout._around",
        "outside = around[part]",
        "outside = Inside()",
    ),
    _fault(
        "causality swapped",
        "A gate's own event comes on the wrong side of those below it.",
        "structure:_Builder._node",
        "is Causality.BOTTOM_UP",
        "is Causality.TOP_DOWN",
    ),
    _fault(
        "a choice between shared parts left to the events",
        "The decision adds an order between events that have happened.",
        "choices:decided",
        "choice = _urgent(order, graph)",
        "choice = None",
    ),
    _fault(
        "relevance of one branch only",
        "An event of another branch no longer breaks a match.",
        "backend:_relevance",
        "for entry in tree.alphabet",
        "for entry in tree.alphabet if entry.pattern in [tree.pattern(name) for name in tree.occurrences]",
    ),
    _fault(
        "relevance without the node's own guard",
        "An event that fits a pattern but breaks its node's guard breaks a match too.",
        "backend:_relevance",
        "(entry.pattern, entry.when)",
        "(entry.pattern, None)",
    ),
    _fault(
        "`ignore` forgotten",
        "An ignored event breaks a match.",
        "backend:_relevance",
        "tuple(ignored)",
        "()",
    ),
    _fault(
        "no edge for an event that fits two nodes",
        "Such an event ends the match.",
        "letters:Letters.over",
        "if closed is not None and",
        "if not letter and closed is not None and closed.bit_count() == 1 and",
    ),
    Fault(
        "automaton translation: negation dropped from labels",
        "automaton",
        "Of nodes that exclude each other an edge wants both.",
        both(
            edit(f"{_AT}labels:Writer._alias", 'f"!{self.atoms[other]}"', 'f"{self.atoms[other]}"'),
            edit(f"{_AT}hoa:write", "state-acc deterministic", "state-acc"),
        ),
    ),
    Fault(
        "automaton translation: negation of guards dropped from labels",
        "automaton",
        "The edge for a guard that is broken wants it to hold.",
        both(
            edit(f"{_AT}labels:Writer.label", 'f"!{self.guards[guard]}"', 'f"{self.guards[guard]}"'),
            edit(f"{_AT}hoa:write", "state-acc deterministic", "state-acc"),
        ),
    ),
    _fault(
        "minimisation merges states with the same successors",
        "By which events a state is left is not compared.",
        "minimise:_Classes._same",
        "return all(one.target(*letter) == other.target(*letter) for letter in self._joint(one, other))",
        "return True",
    ),
    _fault(
        "the word may end in every state with hope",
        "Under `scattered` a word is accepted before anything has happened.",
        "hoa:write",
        "if state == DETECTED:",
        "if state != HOPELESS:",
    ),
    _fault(
        "a configuration with an undecided choice dropped",
        "Under `scattered` a choice that was made keeps out the one that can still be made otherwise.",
        "configurations:Moves.dominates",
        "return not any(choices[choice].mask & behind for choice in bits(one.undecided))",
        "return True",
    ),
    _fault(
        "the smaller of two partial matches kept",
        "Under `scattered` what has come is forgotten.",
        "subsets:Subsets._best",
        "if not any(self.moves.dominates(other, one) for other in best):",
        "if not best:",
    ),
    _fault(
        "an `or` completes by its guards alone",
        "Alternatives that need no event are not asked for theirs.",
        "plan:_Layout._silent",
        "return smallest(guards for way in ways for guards in way)",
        "return (0,)",
    ),
)
