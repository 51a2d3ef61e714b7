"""Questions that a text asks of events, held against a monitor of the text."""

from collections.abc import Iterable, Sequence

from rvaft.backend import Observed
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import match, variables
from rvaft.model.values import Json
from rvaft.monitors import Monitor


def answer(question: Observed, event: Json) -> object:
    """The answer; where other events share variables, all values that the event gives."""
    binding = match(question.pattern, event, {})
    if binding is None:
        return False
    names = (*variables(question.pattern), *(() if question.when is None else guard_variables(question.when)))
    if any(not name.startswith("_") for name in names):
        return tuple((name, repr(value)) for name, value in binding.items())
    return question.when is None or holds(question.when, binding)


def differing(monitor: Monitor, questions: Sequence[Observed], events: Iterable[Json]) -> list[tuple[Json, Json]]:
    """Pairs of events with equal answers after which the monitor is not the same."""
    first: dict[tuple[object, ...], tuple[Json, object]] = {}
    found = []
    for event in events:
        after = monitor.fork()
        effect = after.step(event), after.state
        known = first.setdefault(tuple(answer(question, event) for question in questions), (event, effect))
        if known[1] != effect:
            found.append((known[0], event))
    return found
