"""Faults in the reader of LTLf."""

from typing import Final

from tests.cross_check.faults.mistaken import (
    always_holds,
    loosely_holds,
    match_confused,
    match_like_python,
    match_telling_apart,
    step_without_latch,
)
from tests.cross_check.faults.planting import Fault, Plant, edit, put

_AT: Final = "backends.ltlf."


def _other(name: str, why: str, plant: Plant) -> Fault:
    return Fault(f"ltlf reader: {name}", "ltlf", why, plant)


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return _other(name, why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "`X[!]` read as no operator",
        "What should hold at the next event is asked of this one.",
        "spot_text:_operator",
        "return f.next(a)",
        "return a",
    ),
    _fault(
        "`F` for `U`",
        "The left side of an until is not looked at.",
        "residuals:Residuals._until",
        "self.diagrams.conjunction(stay.residual, self.diagrams.variable(formula))",
        "self.diagrams.variable(formula)",
    ),
    _fault(
        "`F` looks at the next event alone",
        "A match may not begin later.",
        "residuals:Residuals._progress",
        "Progress(inner.accepted, again)",
        "inner",
    ),
    _fault(
        "`U` takes its right side for the next event alone",
        "No irrelevant event may come before a relevant one.",
        "residuals:Residuals._until",
        "later = self.diagrams.conjunction(stay.residual, self.diagrams.variable(formula))",
        "later = FALSE",
    ),
    _other(
        "⊤ not final",
        "After a detection the verdict changes again.",
        put(f"{_AT}monitor:LtlfMonitor.step", step_without_latch),
    ),
    _fault(
        "⊥ one event late",
        "The slices before the event decide whether there is hope.",
        "monitor:LtlfMonitor._advance",
        "self._slices = slices\n    return Verdict.UNKNOWN if slices else Verdict.FALSE",
        "before, self._slices = self._slices, slices\n    return Verdict.UNKNOWN if before else Verdict.FALSE",
    ),
    _fault(
        "⊥ never",
        "A slice without hope is kept.",
        "monitor:LtlfMonitor._advance",
        "if accepted or liveness.satisfiable(rest):",
        "if True:",
    ),
    _fault(
        "slices merged whatever their values",
        "Of two assignments that have come equally far, one is lost.",
        "monitor:LtlfMonitor._advance",
        "slices[_assignment(kept), rest]",
        "slices[frozenset(), rest]",
    ),
    _fault(
        "values forgotten",
        "A variable that an event has bound is bound again by the next one.",
        "monitor:LtlfMonitor._advance",
        "if name in names",
        "if False",
    ),
    _fault(
        "no slice passes over an event it could use",
        "A match that takes its values from a later event is lost.",
        "monitor:LtlfMonitor._extensions",
        "seen.add(_assignment(extended))",
        "return (yield extended)",
    ),
    _fault(
        "`ignored` not looked at",
        "An ignored event is relevant.",
        "atoms:RelevanceAtom.holds",
        "fits and not any(_fits(o, event) for o in self.ignored.at(event))",
        "fits",
    ),
    _fault(
        "an atom with an unbound variable is true",
        "An event serves a node without the values that it has to have.",
        "atoms:EventAtom.holds",
        "self.binds <= binding.keys() and",
        "",
    ),
    _other("`>=` for `>`", "A value on a bound passes.", put(f"{_AT}atoms:holds", loosely_holds)),
    _other("guards not looked at", "Every value passes.", put(f"{_AT}atoms:holds", always_holds)),
    _other(
        "1 is not 1.0", "A number with a decimal point misses a literal.", put(f"{_AT}atoms:match", match_telling_apart)
    ),
    _other("literals looked up by their text", "1.0 is not found where 1 is filed.", put(f"{_AT}candidates:key", repr)),
    _other(
        "numbers and texts confused", "Two values of a variable pass for one.", put(f"{_AT}atoms:match", match_confused)
    ),
    _other("true is 1", "Two values of a variable pass for one.", put(f"{_AT}atoms:match", match_like_python)),
)
