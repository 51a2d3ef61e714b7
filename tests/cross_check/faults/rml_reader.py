"""Faults in the reader of RML."""

import operator
from typing import Final

from tests.cross_check.faults.mistaken import confused, python_equal, told_apart
from tests.cross_check.faults.planting import Fault, Plant, edit, entry, put

_AT: Final = "backends.rml.reader."


def _other(name: str, why: str, plant: Plant) -> Fault:
    return Fault(f"rml reader: {name}", "rml", why, plant)


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return _other(name, why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "left preference dropped",
        r"`\/` takes the last operand that can take the event, so that an alternative for fewer letters hides one for more.",
        "transitions:_Step._union",
        "for part in term.parts[:-1]:\n"
        "        ways = yield part, True\n"
        "        if ways:\n"
        "            return ways\n"
        "    return (yield term.parts[-1], first)",
        "for part in term.parts[:0:-1]:\n"
        "        ways = yield part, True\n"
        "        if ways:\n"
        "            return ways\n"
        "    return (yield term.parts[0], first)",
    ),
    _fault(
        "a sequence goes on too early",
        "The second part takes an event before the first one may end.",
        "transitions:_Step._sequence",
        "if may_halt(self.terms, head) else []",
        "",
    ),
    _fault(
        "an operand of `|` is taken twice",
        "What has begun stays beside its rest, so that a node can be served again.",
        "transitions:_Step._shuffle",
        "(*before, after, *behind)",
        "(*before, after, part, *behind)",
    ),
    _fault(
        "`?` again and again",
        "A child of a vote that is counted may come twice, and counts as two.",
        "transitions:_Step._repeated",
        "return ways",
        "return [(self.forms.then(after, term), bound) for after, bound in ways]",
    ),
    _fault(
        "an event outside a filter is refused",
        "An irrelevant event ends the match under `projected`.",
        "transitions:_Step._filter",
        "ways = yield outside, first",
        "ways = []",
    ),
    _fault(
        "an event inside a filter passes",
        "A filter lets every event pass when what it filters cannot take it.",
        "transitions:_Step._filter",
        "return found[:1] if first else found",
        "return found[:1] or [(term, {})]",
    ),
    _fault(
        "⊥ never",
        "An event that no rule takes is skipped.",
        "transitions:Transitions.step",
        "return None",
        "return term",
    ),
    _fault(
        "⊥ one event late",
        "After the event that no rule takes, the term waits for another one.",
        "reader:RmlMonitor._advance",
        "self._term = self._rules.step(self._term, event)\n    if self._term is None:",
        "after = self._rules.step(self._term, event)\n"
        "        late, self._term = self._term, after\n"
        '        if after is None and late.operator != "nothing":\n'
        "            self._term = self._rules._transitions.terms.nothing\n"
        "    if self._term is None:",
    ),
    _fault(
        "⊤ as soon as one operand of `|` may end",
        "A shuffle is over when one of its parts is.",
        "halting:_rule",
        'case "or":',
        'case "or" | "shuffle":',
    ),
    _fault(
        "⊤ as soon as one operand of `/\\` may end",
        "A conjunction is over when one of its parts is.",
        "halting:_rule",
        'case "or":',
        'case "or" | "and":',
    ),
    _fault(
        "`not` dropped from an event type",
        "A negated type matches what it should not.",
        "matching:Types._one",
        "if not declaration.negated:",
        "if True:",
    ),
    _fault(
        "a guard without a value counts as true",
        "A text passes a guard that compares numbers.",
        "matching:Types._one",
        "truth(guard, found) is True",
        "truth(guard, found) is not False",
    ),
    _fault(
        "a variable that stands twice may have two values",
        "The second value is not compared with the first.",
        "matching:_ways",
        "elif equal(bound[name], value):",
        "else:",
    ),
    _fault(
        "`let` forgets the value",
        "A variable that an event has bound is bound again by the next one.",
        "transitions:_Step._block",
        "return [(self.terms.substituted(after, {variable: value}), others)]",
        "return [(self.terms.block(variable, after), others)]",
    ),
    _fault(
        "steps of true and 1 taken for the same",
        "The step on a number is remembered and taken on the truth value that Python finds equal.",
        "marks:mark",
        "out.append((type(scalar), scalar))",
        "out.append(scalar)",
    ),
    _other("`>=` for `>`", "A value on a bound passes.", entry(f"{_AT}data:_COMPARE", ">", operator.ge)),
    _other("`>` for `>=`", "A value on a bound is refused.", entry(f"{_AT}data:_COMPARE", ">=", operator.gt)),
    _other("1 is not 1.0", "A number with a decimal point misses a literal.", put(f"{_AT}matching:equal", told_apart)),
    _other("numbers and texts confused", "The text of a number is a literal.", put(f"{_AT}matching:equal", confused)),
    _other("true is 1", "A truth value is taken for a number.", put(f"{_AT}matching:equal", python_equal)),
)
