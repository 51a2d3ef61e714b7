"""Faults in the translation into LTLf."""

from typing import Final

from tests.cross_check.faults.mistaken import loose_text
from tests.cross_check.faults.planting import Fault, edit, put

_AT: Final = "backends.ltlf."


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return Fault(f"ltlf translation: {name}", "ltlf", why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "sand reversed",
        "The last child of a `sand` is wanted first.",
        "parts:_body",
        "return Part(Op.SEQUENCE, tuple(parts))",
        "return Part(Op.SEQUENCE, tuple(reversed(parts)))",
    ),
    _fault(
        "K-1 for K",
        "One child fewer than K is enough.",
        "parts:_body",
        "Part(Op.AT_LEAST, tuple(parts), node.threshold)",
        "Part(Op.AT_LEAST, tuple(parts), node.threshold - 1)",
    ),
    _fault(
        "exactly K for at least K",
        "What follows a vote is refused after one child more than K.",
        "windows:window",
        "[need] if after == TRUE else range(need, len(events) + 1)",
        "[need]",
    ),
    _fault(
        "the threshold counts one too few",
        "Under `scattered` K-1 children are enough.",
        "compose:Composer._threshold",
        "return row[need]",
        "return row[need - 1]",
    ),
    _fault(
        "a dropped guard",
        "The guard of a node without an event counts nowhere.",
        "parts:parts_of",
        "guards.append((body, node.when))",
        "guards.append((body, node.when)) if node.has_event else None",
    ),
    _fault(
        "a guard at the wrong binder",
        "A guard is asked at the first event alone, where its other variable has no value yet.",
        "guarding:_placed",
        "placed.setdefault(node, []).append(guard)",
        "placed.setdefault(node, []).append(guard)\n                break",
    ),
    _fault(
        "a guard at every event",
        "A guard of one branch counts in the others too.",
        "guarding:_placed",
        "if graph.implies(event, number):",
        "if True:",
    ),
    Fault(
        "ltlf translation: `>=` for `>`",
        "ltlf",
        "A value on the bound of a guard is taken.",
        put(f"{_AT}header:guard_text", loose_text),
    ),
    _fault(
        "a shared node doubled",
        "A node below two parents is matched twice, by different events.",
        "shape:entangled",
        "if shape.events[inner] & seen:",
        "if False:",
    ),
    _fault(
        "what follows an `and` forgotten",
        "Under `scattered` a match is complete when the children of a nested `and` are.",
        "compose:Composer._anywhere",
        "found.append((yield self._of(group[0], after)))",
        "found.append((yield self._of(group[0], TRUE)))",
    ),
    _fault(
        "what follows a window forgotten",
        "A match is complete when the children of a nested gate are.",
        "compose:Composer._in_place",
        "need, after)",
        "need, TRUE)",
    ),
    _fault(
        "precedence lost through a nested gate",
        "What is nested in a `sand` in a `sand` is put beside it.",
        "terms:Terms._made",
        "yield event, self._sequence([left, *row.inner[index + 1 :]])  # the rest begins, or goes on",
        "yield event, self._all([left, *row.inner[index + 1 :]])",
    ),
    _fault(
        "causality swapped",
        "A gate's own event comes on the wrong side of those below it.",
        "parts:parts_of",
        "is Causality.TOP_DOWN",
        "is Causality.BOTTOM_UP",
    ),
    _fault(
        "bottom-up, the own event before the children",
        "The causality of the tree is not looked at.",
        "parts:parts_of",
        "pair[::-1]",
        "pair",
    ),
    _fault(
        "relevance of one branch only",
        "An event of another branch no longer breaks a match.",
        "translation:_Translator._relevance",
        "for entry in self.tree.alphabet",
        "for entry in self.tree.alphabet if entry.pattern in self.patterns.values()",
    ),
    _fault(
        "relevance without the node's own guard",
        "An event that fits a pattern but breaks its node's guard breaks a match too.",
        "translation:_Translator._relevance",
        "_guards(entry.when)",
        "()",
    ),
    _fault(
        "`ignore` forgotten",
        "An ignored event breaks a match.",
        "translation:_Translator._relevance",
        "{name: list(dict.fromkeys(ignored))} if ignored else {}",
        "{}",
    ),
    _fault(
        "`X` dropped",
        "What should come later is wanted at once.",
        "positions:Positions.later",
        "self.formulas.next(self.begin(formula))",
        "self.begin(formula)",
    ),
    _fault(
        "`F` dropped",
        "Under `scattered` no event may be skipped.",
        "positions:Positions.step",
        "self.formulas.eventually(found) if self.monotone else found",
        "found",
    ),
    _fault(
        "`F` for `!rel U`",
        "Under `projected` relevant events may be skipped.",
        "positions:Positions.begin",
        "return f.until(f.negation(self.relevant), f.conjunction([self.relevant, formula]))",
        "return f.eventually(f.conjunction([self.relevant, formula]))",
    ),
    _fault(
        "one event serves two parts at once",
        "`F a & F b` is met by one event that is both.",
        "shape:rivals_apart",
        "if shape.rivals[inner] & seen:",
        "if False:",
    ),
    _fault(
        "an event twice within a window",
        "The same child is counted for two.",
        "windows:window",
        "[whole, *never_twice]",
        "[whole]",
    ),
    _fault(
        "the sum over orders stops as soon as it may",
        "What follows a vote is refused after one child more than K.",
        "sums:total",
        "formulas.disjunction([after, taken]) if ends else taken",
        "after if ends else taken",
    ),
    _fault(
        "an exclusive choice taken for one that may be more",
        "Two children of an `or` that one event begins are followed as if both were wanted.",
        "terms:Terms._made",
        "case Op.ONE:\n                    yield event, left",
        "case Op.ONE:\n                    yield event, self._all([left, *others])",
    ),
)
