"""The abstract syntax of automata without variables, for the validator of `proofs/`."""

from functools import cache
from typing import Any

from backends.automaton.hoa_reader import parsed, program, tools
from backends.automaton.hoa_writer import ALIVE
from rvaft.backend import Observed
from rvaft.errors import NotExpressible
from rvaft.export.verified import EventConditions
from rvaft.model.values import Json


def formal(text: str) -> Json:
    """Return a Büchi automaton with marked states; raises `NotExpressible` and `LanguageError`."""
    known, events = program(text, None), EventConditions()
    spot, buddy = tools()
    automaton = parsed(spot, text)
    if known.time is not None or known.guards or any(shared for _, shared in known.events.values()):
        raise NotExpressible("the events of the text have variables or times")
    if not automaton.is_existential() or not automaton.prop_state_acc() or not automaton.acc().is_buchi():
        raise NotExpressible("the text is no Büchi automaton with marks on states")
    tests: dict[int, Json] = {}
    for number, name in enumerate(known.table.names):
        variable = automaton.register_ap(name)
        if number in known.events:
            tests[variable] = events.of(Observed(known.events[number][0]))
        else:
            tests[variable] = ["alive"] if name == ALIVE else events.relevance(known.alphabet, known.ignored)
    if ["alive"] not in tests.values():
        raise NotExpressible(f"the text has no proposition {ALIVE}")

    @cache
    def label(condition: Any) -> Json:
        if condition in (buddy.bddtrue, buddy.bddfalse):
            return ["and"] if condition == buddy.bddtrue else ["or"]
        test, low = tests[buddy.bdd_var(condition)], label(buddy.bdd_low(condition))
        return ["or", ["and", test, label(buddy.bdd_high(condition))], ["and", ["not", test], low]]

    states: list[Json] = [
        {
            "marked": bool(automaton.state_is_accepting(state)),
            "edges": [[label(edge.cond), edge.dst] for edge in automaton.out(state)],
        }
        for state in range(automaton.num_states())
    ]
    return events.text("automaton", {"start": automaton.get_init_state_number(), "states": states})
