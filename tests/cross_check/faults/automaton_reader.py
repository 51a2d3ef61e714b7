"""Faults in the reader of automata."""

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

_AT: Final = "backends.automaton."


def _other(name: str, why: str, plant: Plant) -> Fault:
    return Fault(f"automaton reader: {name}", "automaton", why, plant)


def _fault(name: str, why: str, where: str, old: str, new: str) -> Fault:
    return _other(name, why, edit(f"{_AT}{where}", old, new))


FAULTS: Final = (
    _fault(
        "`alive` taken for its negation",
        "What is said of the end of a word is read as what may happen in it.",
        "table:table",
        "alive = buddy.bdd_ithvar(variables[names.index(ALIVE)])",
        "alive = buddy.bdd_nithvar(variables[names.index(ALIVE)])",
    ),
    _fault(
        "acceptance without the end of the word",
        "A word is accepted where the automaton accepts some word that goes on.",
        "finite:after_the_end",
        "if edge.cond & silence != buddy.bddfalse:",
        "if True:",
    ),
    _other(
        "⊤ not final",
        "After a detection the verdict changes again.",
        put(f"{_AT}monitor:AutomatonMonitor.step", step_without_latch),
    ),
    _fault(
        "⊥ one event late",
        "The slices before the event decide whether there is hope.",
        "monitor:AutomatonMonitor._advance",
        "self._slices = {one: binding for one, binding in after.items() if not _redundant(one, after)}",
        "before = self._slices\n"
        "    self._slices = {one: binding for one, binding in after.items() if not _redundant(one, after)}\n"
        "    if before and not self._slices:\n"
        "        return Verdict.UNKNOWN",
    ),
    _fault(
        "⊥ never",
        "A state without hope is one like others.",
        "table:_verdicts",
        "Verdict.FALSE if state not in hopeful else",
        "",
    ),
    _fault(
        "slices merged whatever their values",
        "Of two assignments that have come equally far, one is lost.",
        "monitor:AutomatonMonitor._advance",
        "after[_assignment(binding), to]",
        "after[frozenset(), to]",
    ),
    _fault(
        "a slice dropped for a smaller one in any state",
        "An assignment that has come further is lost.",
        "monitor:_redundant",
        "(frozenset(part), state) in slices",
        "frozenset(part) in {smaller for smaller, _ in slices}",
    ),
    _fault(
        "no slice passes over an event it could use",
        "A match that takes its values from a later event is lost.",
        "monitor:AutomatonMonitor._bindings",
        "yield bound\n    seen: set[Assignment] = set()",
        "seen: set[Assignment] = set()\n"
        "    if not any(\n"
        "        (more := _matched(self._events[number], event, bound)) is not None and len(more) > len(bound)\n"
        "        for number in self._run.seen(state)\n"
        "        if number in self._events\n"
        "    ):\n"
        "        yield bound",
    ),
    _fault(
        "an atom with an unbound variable is true",
        "An event serves a node without the values that it has to have.",
        "monitor:AutomatonMonitor._holds",
        "more is not None and len(more) == len(bound)",
        "more is not None",
    ),
    _fault(
        "a guard with an unbound variable is false",
        "A guard is broken before it can be asked.",
        "monitor:AutomatonMonitor._holds",
        "not all(name in bound for name in guard_variables(guard)) or holds(guard, bound)",
        "all(name in bound for name in guard_variables(guard)) and holds(guard, bound)",
    ),
    _fault(
        "`ignore` not looked at",
        "An ignored event is relevant.",
        "header:Meaning.is_relevant",
        "and not any(fit.fits(event) for fit in self.ignored)",
        "",
    ),
    _fault(
        "guards of the alphabet not looked at",
        "An event that breaks its node's guard breaks a match too.",
        "header:Fit.fits",
        "bound.keys() >= set(variables(self.guard)) and holds(self.guard, bound)",
        "True",
    ),
    _fault(
        "every event is relevant",
        "An event that nothing in the tree asks for breaks a match.",
        "monitor:AutomatonMonitor._advance",
        "bool(self._said.relevant) and self._said.is_relevant(event)",
        "True",
    ),
    _other("`>=` for `>`", "A value on a bound passes.", put(f"{_AT}monitor:holds", loosely_holds)),
    _other("guards not looked at", "Every value passes.", put(f"{_AT}monitor:holds", always_holds)),
    _other(
        "1 is not 1.0",
        "A number with a decimal point misses a literal.",
        put(f"{_AT}monitor:match", match_telling_apart),
    ),
    _other("numbers and texts confused", "Two values pass for one.", put(f"{_AT}monitor:match", match_confused)),
    _other("true is 1", "Two values pass for one.", put(f"{_AT}monitor:match", match_like_python)),
)
