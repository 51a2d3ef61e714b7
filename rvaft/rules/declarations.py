"""Rules about event types and their use, on drafts."""

from collections.abc import Iterable, Iterator

from rvaft.findings import Severity
from rvaft.guards import variables as guard_variables
from rvaft.language.draft import Draft
from rvaft.model import EventType, Ignore, On, Place
from rvaft.patterns import Variable
from rvaft.patterns import variables as pattern_variables
from rvaft.rules.rule import Report, Rule
from rvaft.rules.words import did_you_mean, listing


def duplicate_event(draft: Draft) -> Iterator[Report]:
    """An event type is declared once, in whichever file."""
    first: dict[str, EventType] = {}
    for event in draft.events:
        if first.setdefault(event.name, event) is not event:
            before = first[event.name].place
            yield Report(event.place, f"event type {event.name} is declared twice, first at {before}; remove one")


def unused_parameter(draft: Draft) -> Iterator[Report]:
    """Every parameter occurs in the pattern."""
    for event in draft.events:
        used = set(pattern_variables(event.pattern))
        for parameter in event.parameters:
            if parameter not in used:
                message = f"parameter {parameter} of event {event.name} is not in its pattern; use it there or drop it"
                yield Report(event.place, message)


def unknown_event(draft: Draft) -> Iterator[Report]:
    """Every event type that is applied is declared."""
    known = {event.name for event in draft.events}
    for on, place, nodes in _calls(draft):
        if on.event not in known:
            guess = did_you_mean(on.event, known) or f"; declare it with `event {on.event}(...) = {{ ... }};`"
            yield Report(place, f"unknown event type {on.event}{guess}", nodes)


def event_arity(draft: Draft) -> Iterator[Report]:
    """An event type is applied to as many arguments as it has parameters."""
    known: dict[str, EventType] = {}
    for event in draft.events:
        known.setdefault(event.name, event)
    for on, place, nodes in _calls(draft):
        if on.event in known and len(on.arguments) != len(known[on.event].parameters):
            parameters = known[on.event].parameters
            count = f"{len(parameters)} argument{'s' * (len(parameters) != 1)}, not {len(on.arguments)}"
            message = (
                f"event {on.event} takes {count}; write {on.event}({', '.join(parameters)}) with `_` for any value"
            )
            yield Report(place, message, nodes)


def ignore_variable(draft: Draft) -> Iterable[Report]:
    """The guard of an `ignore` speaks of the event that is ignored, and of nothing else."""
    return foreign_variables(draft.ignores)


def foreign_variables(ignores: Iterable[Ignore]) -> Iterator[Report]:
    """The `ignore` declarations whose guard uses a variable that their event does not bind."""
    for ignore in ignores:
        own = {argument.name for argument in ignore.on.arguments if isinstance(argument, Variable)}
        missing = [] if ignore.when is None else [name for name in guard_variables(ignore.when) if name not in own]
        if missing:
            message = (
                f"the guard of this `ignore` uses {listing(missing)}, which {ignore.on.event}(...) does not bind; "
                "the variables of an `ignore` are its own"
            )
            yield Report(ignore.place, message)


def _calls(draft: Draft) -> Iterator[tuple[On, Place, tuple[str, ...]]]:
    for node in draft.nodes.values():
        for said in node.ons:
            yield said.value, said.place, (node.name,)
    for ignore in draft.ignores:
        yield ignore.on, ignore.place, ()


RULES = (
    Rule(
        "duplicate-event",
        Severity.ERROR,
        "event type declared twice",
        duplicate_event,
        "An event type has one declaration in all files of a tree. The message names both places.",
        "event go(x) = { goal: x };\nevent go(x) = { target: x };\ntop and a b;\na on go(1);\nb;\n",
        "event go(x) = { goal: x };\nevent aim(x) = { target: x };\ntop sand a b;\na on go(1);\nb on aim(1);\n",
    ),
    Rule(
        "unused-parameter",
        Severity.ERROR,
        "parameter not in the pattern",
        unused_parameter,
        "A parameter that its pattern does not contain would never get a value from an event.",
        "event go(x, y) = { goal: x };\ntop and a b;\na on go(1, 2);\nb;\n",
        "event go(x, y) = { goal: x, from: y };\ntop sand a b;\na on go(1, 2);\nb;\n",
    ),
    Rule(
        "unknown-event",
        Severity.ERROR,
        "unknown event type",
        unknown_event,
        "What stands after `on` and `ignore` is a declared event type. A similar name is suggested.",
        "event radiation(v) = { value: v };\ntop and a b;\na on radiation(1);\nb on radiaton(2);\n",
        "event radiation(v) = { value: v };\ntop and a b;\na on radiation(1);\nb on radiation(2);\n",
    ),
    Rule(
        "event-arity",
        Severity.ERROR,
        "wrong number of arguments",
        event_arity,
        "An event type takes one argument for each of its parameters; `_` is an argument that any value will do for.",
        "event radiation(v, t) = { value: v, time: t };\ntop and a b;\na on radiation(1);\nb;\n",
        "event radiation(v, t) = { value: v, time: t };\ntop sand a b;\na on radiation(1, _);\nb;\n",
    ),
    Rule(
        "ignore-variable",
        Severity.ERROR,
        "guard of an ignore uses a foreign variable",
        ignore_variable,
        "Whether an event is ignored depends on that event alone: every variable in the guard of an `ignore` is an argument of the "
        "event type it applies.",
        "event radiation(v) = { value: v };\nignore radiation(V) when W < 250;\ntop and a b;\na;\nb;\n",
        "event radiation(v) = { value: v };\nignore radiation(V) when V < 250;\ntop and a b;\na;\nb;\n",
    ),
)
