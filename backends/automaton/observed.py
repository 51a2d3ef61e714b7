"""What a HOA text asks of events: the patterns of its propositions, and the lines that say what is relevant."""

from collections.abc import Iterator, Mapping

from backends.automaton.header import Fit, Meaning
from backends.automaton.letters import apart
from rvaft.backend import Observed
from rvaft.guards import Guard, Operation
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Pattern, Variable, rigid_variables, variables


def questions(said: Meaning, events: Mapping[int, Pattern]) -> tuple[Observed, ...]:
    """The questions of a text that says this, its propositions standing for these events."""
    return tuple(dict.fromkeys(_questions(said, events)))


def _questions(said: Meaning, events: Mapping[int, Pattern]) -> Iterator[Observed]:
    for pattern in events.values():
        yield Observed(pattern)
        shared = set(rigid_variables(pattern))
        for guard in said.guards.values():  # a proposition of its own, about values that an event gives variables
            if shared & set(guard_variables(guard)):
                yield Observed(pattern, guard)
    if said.relevant:
        yield from map(_apart, (*said.alphabet, *said.ignored))


def _apart(fit: Fit) -> Observed:
    """With variables of its own: some values will do."""
    own = {name for name in variables(fit.pattern) if not name.startswith("_")}
    return Observed(apart(fit.pattern), None if fit.guard is None else _renamed(fit.guard, own))


def _renamed(guard: Guard, own: set[str]) -> Guard:
    match guard:
        case Variable(name):
            return Variable(f"_{name}") if name in own else guard
        case Operation(operator, operands):
            return Operation(operator, tuple(_renamed(operand, own) for operand in operands))
        case _:
            return guard
