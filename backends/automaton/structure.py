"""The parts and propositions of a property, prepared for the automaton construction.

Nested parts of one kind are flattened, so that a chain of thousands of gates becomes one sequence.
A shared node stays one part.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import assert_never

from backends.absences import breaking_event, without_absences
from rvaft.core.part_numbers import NumberedPart, NumberedParts, numbered
from rvaft.core.property import Condition, Event, PartKind, Property
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import guard_text, name_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern


@dataclass(frozen=True)
class Structure:
    """The parts of a property and its propositions: event patterns (*atoms*), then guards, one bit
    each.

    `atoms` numbers the patterns. `names` and `nodes` hold for each pattern a name and a node of the
    tree. `written` holds each guard as the tree writes it.
    """

    form: NumberedParts
    atoms: Mapping[Pattern, int]
    patterns: tuple[Pattern, ...]
    nodes: tuple[str, ...]
    names: tuple[str, ...]
    guards: tuple[Guard, ...]
    written: tuple[str, ...]

    @cached_property
    def guard_bits(self) -> Mapping[Guard, int]:
        """The proposition number of each guard."""
        return {guard: number for number, guard in enumerate(self.guards, len(self.patterns))}

    def atom_of(self, number: int) -> int:
        """Return the atom of an event part."""
        return self.atoms[self.form.parts[number].event.pattern]


def structure(prop: Property) -> Structure:
    """Return the parts and propositions of a property; absent events have propositions, but no parts."""
    form = numbered(without_absences(prop, lambda _: True))
    parts: list[NumberedPart] = []
    of: list[int] = []
    kept: set[int] = set()  # shared parts are not flattened
    for number, part in enumerate(form.parts):
        children = [of[child] for child in part.parts]
        match part.op:
            case PartKind.EVENT | PartKind.CONDITION | PartKind.AT_LEAST:
                pass
            case PartKind.ALL | PartKind.SEQUENCE | PartKind.ONE:
                children = [
                    inner
                    for child in children
                    for inner in (parts[child].parts if parts[child].op is part.op and child not in kept else (child,))
                ]
                if part.op is not PartKind.SEQUENCE:
                    children = list(dict.fromkeys(children))
            case _:
                assert_never(part.op)
        of.append(children[0] if len(children) == 1 and part.op is not PartKind.AT_LEAST else number)
        need = len(children) if part.op is PartKind.ALL or part.op is PartKind.SEQUENCE else part.need
        parts.append(replace(part, parts=tuple(children), need=need))
        if part.of in prop.shared:
            kept.add(of[-1])
    events: dict[Pattern, Event] = {}
    for event in prop.events:
        events.setdefault(event.pattern, event)
    conditions: dict[Guard, Condition] = {}
    for one in reversed(prop.parts):
        if isinstance(one, Condition):
            conditions.setdefault(one.guard, one)
    nodes = [event.source.node for event in events.values()]
    several = {node for node, count in Counter(nodes).items() if count > 1}
    names = [
        f"{node}_{event.source.number}" if (node := event.source.node) in several else node for event in events.values()
    ]
    patterns = dict.fromkeys(events)
    for clause in prop.absences:
        if (pattern := breaking_event(clause).pattern) not in patterns:
            patterns[pattern] = None
            nodes.append(clause.source.node)
            names.append(f"{clause.source.node}_absent")
    return Structure(
        NumberedParts(tuple(parts[: of[-1] + 1])),
        {pattern: number for number, pattern in enumerate(patterns)},
        tuple(patterns),
        tuple(nodes),
        tuple(names),
        tuple(conditions),
        tuple(map(written, conditions.values())),
    )


def written(condition: Condition) -> str:
    """Return a condition as the tree writes it.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> from rvaft.core.time_order import windows_to_guards
    >>> prop = windows_to_guards(build(rvaft.loads("time t as s; top sand a b within 90 s;")))
    >>> written(prop.root.parts[-1])
    'top within 90 s'
    """
    if condition.window is not None:
        return f"{name_text(condition.source.node)} within {duration_text(condition.window)}"
    return guard_text(condition.written or condition.guard)
