"""Faults in the engine."""

from functools import partial
from typing import Final

from rvaft.model.guards import Guard, Predicate
from rvaft.model.values import Json
from tests.cross_check.faults.mistaken import (
    always_holds,
    confused,
    loosely_holds,
    python_equal,
    step_without_latch,
    told_apart,
)
from tests.cross_check.faults.planting import Fault, Plant, edit, put

_AT: Final = "rvaft.engine."


def always(guard: Guard) -> Predicate:
    """No guard is looked at."""
    return partial(always_holds, guard)


def unchanged(value: Json) -> Json:
    """Python's own equality."""
    return value


def loosely(guard: Guard) -> Predicate:
    """`>=` for `>` and `<=` for `<`."""
    return partial(loosely_holds, guard)


def _other(name: str, why: str, plant: Plant) -> Fault:
    return Fault(f"engine: {name}", "engine", why, plant)


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return _other(name, why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "sand reversed",
        "The last child of a `sand` is wanted first.",
        "plan:plan_of",
        "node.gate is Gate.SAND_RL",
        "node.gate is Gate.SAND",
    ),
    _fault(
        "K-1 for K",
        "One child fewer than K is enough.",
        "plan:plan_of",
        "thresholds=tuple(node.threshold or 0 for",
        "thresholds=tuple((node.threshold or 1) - 1 for",
    ),
    _fault(
        "K+1 for K where every node has one start",
        "Under `scattered` K children are not enough.",
        "plan:Plan.least",
        "return self.thresholds[node]",
        "return self.thresholds[node] + 1",
    ),
    _fault(
        "exactly K for at least K",
        "A vote is no longer done after one child more than K.",
        "progress:Progress._choice",
        "touched_sure == touched and sure >= threshold",
        "touched_sure == touched and sure == threshold",
    ),
    _fault(
        "an `or` of which two children have begun",
        "A match may be put together from two branches.",
        "progress:Progress._choice",
        "if touched == 1 else",
        "if touched else",
    ),
    _fault(
        "a guard on one event dropped",
        "An event serves a node whose guard it breaks.",
        "plan:plan_of",
        "filters=tuple(uses.filter(node) for",
        "filters=tuple(None for",
    ),
    _other("a guard over two events not looked at", "Every value passes.", put(f"{_AT}matching:predicate", always)),
    _other("`>=` for `>` over two events", "A value on a bound passes.", put(f"{_AT}matching:predicate", loosely)),
    _other(
        "`>=` for `>` on one event",
        "A value on a bound passes.",
        put("rvaft.analysis.pattern_index:predicate", loosely),
    ),
    _fault(
        "a guard at the wrong binder",
        "A guard is asked when its first variable is bound, and never again.",
        "plan:Plan.guarded_by",
        "for name in guard_variables(guard) if guard is not None else ():",
        "for name in guard_variables(guard)[:1] if guard is not None else ():",
    ),
    _fault(
        "a shared node with two starts",
        "A node below two parents starts when the first of them does.",
        "starts:starts_of",
        "if child in known and found[child] != start:",
        "if False:",
    ),
    _fault(
        "orders between shared parts not remembered",
        "A match that has taken events in the wrong order is kept.",
        "matching:Matching.extended",
        "new.inversions |= self.core.inverted(configuration, node)",
        "pass",
    ),
    _fault(
        "precedence lost through a nested gate",
        "What is below a child of an ordered gate comes after what should follow it.",
        "progress:Progress._ended",
        "self._tally(configuration, gate)[0] > slot",
        "False",
    ),
    _fault(
        "causality swapped",
        "A gate's own event comes on the wrong side of those below it.",
        "plan:plan_of",
        "is Causality.TOP_DOWN",
        "is Causality.BOTTOM_UP",
    ),
    _fault(
        "bottom-up, the own event before the children",
        "A gate's event is taken while its children are still to come.",
        "progress:Progress._with_own",
        "return TOUCHED | (inner & (DONE | SURE))",
        "return TOUCHED | inner",
    ),
    _fault(
        "relevance of one branch only",
        "An event of another branch no longer breaks a match.",
        "letters:Letters.__init__",
        "for entry in tree.alphabet)",
        "for entry in tree.alphabet if any(entry.pattern == letter.pattern for letter in serves))",
    ),
    _fault(
        "relevance without the node's own guard",
        "An event that fits a pattern but breaks its node's guard breaks a match too.",
        "letters:Letters.__init__",
        "Letter(entry.pattern, entry.when)",
        "Letter(entry.pattern, None)",
    ),
    _fault(
        "`ignore` forgotten",
        "An ignored event breaks a match.",
        "letters:Letters.read",
        "relevant and not sketch.ignores(event)",
        "relevant",
    ),
    _fault(
        "⊥ one event late",
        "The partial matches before the event decide whether there is hope.",
        "consuming:Consuming.advance",
        "self.follow(found.values())\n    return self._verdict()",
        "late = self._verdict()\n    self.follow(found.values())\n    return late",
    ),
    _fault(
        "⊥ never",
        "Every semantics has hope for ever.",
        "consuming:Consuming._verdict",
        "if self._configurations",
        "if True",
    ),
    _other(
        "⊤ not final",
        "After a detection the verdict changes again.",
        put(f"{_AT}monitor:Engine.step", step_without_latch),
    ),
    _fault(
        "one event serves two nodes at once",
        "Nodes that compete for an event are followed as if they did not.",
        "suits:linear_starts",
        "if starts is None or _Contest(plan, letters).found():",
        "if starts is None:",
    ),
    _fault(
        "partial matches merged whatever their values",
        "Of two assignments that have come equally far, one is lost.",
        "stages:Stage.key",
        "exact(binding[name])",
        "None",
    ),
    _fault(
        "values forgotten too early",
        "A variable that two events share may have two values.",
        "matching:Matching._forget",
        "if not waiting and not self.plan.mentions[name] & ~configuration.taken:",
        "if not waiting:",
    ),
    _fault(
        "no partial match passes over an event it could use",
        "A match that needs a later event is lost.",
        "skipping:Skipping._answer",
        "if step.commits:",
        "if True:",
    ),
    _fault(
        "a guard on an event asked for another partial match",
        "What an event can do is said once for all outcomes of its guards.",
        "stages:Stages.step",
        "key = (held & move.mask, outcomes)",
        "key = (0, outcomes)",
    ),
    _other(
        "1 is not 1.0 in a literal", "1.0 is not found where 1 is filed.", put("rvaft.analysis.pattern_index:key", repr)
    ),
    _other("1 is not 1.0 in a variable", "A value is not found again.", put(f"{_AT}matching:equal", told_apart)),
    _other(
        "numbers and texts confused in a variable", "Two values pass for one.", put(f"{_AT}matching:equal", confused)
    ),
    _other(
        "numbers and texts confused in a literal",
        "Two values pass for one.",
        put("rvaft.analysis.pattern_index:key", str),
    ),
    _other("true is 1 in a literal", "Two values pass for one.", put("rvaft.analysis.pattern_index:key", unchanged)),
    _other("true is 1 in a variable", "Two values pass for one.", put(f"{_AT}matching:equal", python_equal)),
)
