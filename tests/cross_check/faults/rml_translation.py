"""Faults in the translation into RML."""

from typing import Final

from rvaft.model.guards import Operator
from tests.cross_check.faults.planting import Fault, edit, entry

_AT: Final = "backends.rml.writer."


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return Fault(f"rml translation: {name}", "rml", why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "sand reversed",
        "The last child of a `sand` is wanted first.",
        "plain:Plain.children",
        "node.gate is Gate.SAND_RL",
        "node.gate is Gate.SAND",
    ),
    _fault(
        "exactly K for at least K",
        "What follows a vote is refused after one child more than K.",
        "scenarios:_options",
        "most = least if semantics is Semantics.SCATTERED else len(children)",
        "most = least",
    ),
    _fault(
        "a vote over many orders wants one more",
        "Where a vote is written as a shuffle, K children are not enough.",
        "composition:Composition._enough",
        "[ANY] * (node.threshold or 0)",
        "[ANY] * ((node.threshold or 0) + 1)",
    ),
    _fault(
        "a vote counts every event of a child",
        "Two events of one child count as two children.",
        "composition:Composition._enough",
        "self.plain.single_events(node)",
        "True",
    ),
    _fault(
        "a dropped guard",
        "A scenario matches although a guard of it does not hold.",
        "scenarios:_scenario",
        "frozenset(guards)",
        "frozenset()",
    ),
    _fault(
        "a node's own guard dropped",
        "An event serves a node whose guard it breaks.",
        "plain:Plain._prepared",
        "[name] if guarded else []",
        "[]",
    ),
    _fault(
        "a shared node doubled",
        "A node below two parents wants two events.",
        "plain:Plain._prepared",
        " or self.tree.shared",
        "",
    ),
    _fault(
        "precedence lost through a nested gate",
        "What comes before a gate does not come before what is below its children.",
        "scenarios:_scenario",
        "above = earlier[name]",
        "above = 0",
    ),
    _fault(
        "sequence lost in the equations",
        "The children of a `sand` may come in any order.",
        "scenarios:_scenario",
        "above |= part[child]",
        "pass",
    ),
    _fault(
        "causality swapped",
        "A gate's own event comes on the wrong side of those below it.",
        "composition:Composition.contiguous",
        "is Causality.TOP_DOWN",
        "is Causality.BOTTOM_UP",
    ),
    _fault(
        "causality swapped under scattered",
        "A gate's own event comes on the wrong side of those below it.",
        "composition:Composition._awaited",
        "is Causality.BOTTOM_UP",
        "is Causality.TOP_DOWN",
    ),
    _fault(
        "relevance of one branch only",
        "An event of another branch no longer breaks a match.",
        "relevance:relevant",
        "tree.part_of.tree if tree.part_of is not None else tree",
        "tree",
    ),
    _fault(
        "relevance without the node's own guard",
        "An event that fits a pattern but breaks its node's guard breaks a match too.",
        "observations:closed_call",
        "closed(node.on, node.when)",
        "closed(node.on, None)",
    ),
    _fault(
        "`ignore` forgotten",
        "An ignored event breaks a match.",
        "relevance:relevant",
        "if not unwanted:",
        "if True:",
    ),
    _fault(
        "the guard of `ignore` forgotten",
        "An event that breaks the guard of an `ignore` is ignored.",
        "relevance:relevant",
        "closed(ignore.on, ignore.when)",
        "closed(ignore.on, None)",
    ),
    _fault(
        "left preference where branches begin alike",
        "RML commits to the first branch that can take the event, and the other one is lost.",
        "plain:Plain._gate_fits",
        "_apart((self._touched_first[child], self.first[child]) for child in children)",
        "True",
    ),
    _fault(
        "left preference where one event can serve two children",
        "RML gives the event to the child on the left, though the other one needed it.",
        "plain:Plain._gate_fits",
        "case Gate.AND:\n            return _apart((self._touched[child], self.part[child]) for child in children)",
        "case Gate.AND:\n            return True",
    ),
    _fault(
        "smaller sets of letters first",
        "RML takes the alternative of one letter where an event was two, and forgets the other.",
        "combining:Combinations.all",
        "-combination.fits.bit_count()",
        "combination.fits.bit_count()",
    ),
    _fault(
        "an alternative dropped because of any that leads to the same",
        "An event that only the dropped alternative takes is refused.",
        "minimising:_needed",
        "if not less & ~fits",
        "if less",
    ),
    _fault(
        "a partial match dropped for a larger one of another scenario",
        "The scenario that only the smaller one belongs to can no longer complete.",
        "automaton:_undominated",
        "left &= ~others",
        "left = 0",
    ),
    Fault(
        "rml translation: `>` for `not <`",
        "rml",
        "A value on the bound of a negated comparison is refused.",
        entry(f"{_AT}conditions:_OPPOSITE", Operator.LT, Operator.GT),
    ),
    _fault(
        "`>=` for `>`",
        "A value on the bound of a guard is taken.",
        "scopes:Scope.condition",
        "case Compare(operator, left, right):",
        "case Compare(operator, left, right):\n"
        "            operator = {Operator.GT: Operator.GE, Operator.LT: Operator.LE}.get(operator, operator)",
    ),
    _fault(
        "numbers in quotes",
        "The text of a number is taken for the number.",
        "literals:spellings",
        'return (str(whole), f"{whole}.0")',
        "return (quoted(str(whole)),)",
    ),
    _fault(
        "the equations go back to where a set of events began",
        "An event that only passes is taken for one that leads on.",
        "equations:_Writer._body",
        'STAY: Name(self.names.get(number, ""))',
        "STAY: ALL",
    ),
)
