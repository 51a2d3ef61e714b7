"""A tree laid out for the construction of its automaton: its parts, flattened, and its propositions.

The parts are those of the normal form; what is nested for no reason is flattened, so that a chain
of thousands of gates is one sequence. A node that several parents share stays one part.

A choice can wait when everything below each of its alternatives is reached through that alternative
alone: then an event below it is the decision. Where an alternative reaches a part that is also
reached otherwise, the decision may add an order between events that have happened by then, so it is
taken before anything happens, each way in a graph of its own.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from typing import Final, assert_never

from rvaft.core.part_numbers import NumberedPart, NumberedParts, PartKind, divided, numbered
from rvaft.core.property import Condition, Event, Property
from rvaft.errors import TooLarge
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import guard_text, name_text
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.support.bits import union

STEPS: Final = 1000
"""How many steps of the construction the limit allows for each state it allows."""
QUICK: Final = 10_000_000
"""So many steps take about a second, and are allowed under any limit."""
CHARACTERS: Final = 100
"""How long the text may be for each state that the limit allows."""
SHORT: Final = 1_000_000
"""A text of so many characters is allowed under any limit."""


class Work:
    """What is built and done, counted; raises `TooLarge` beyond `limit` states, and what goes with them."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._steps = 0

    def step(self, many: int) -> None:
        """So many more steps are done; each takes about a tenth of a microsecond."""
        self._steps += many
        if self._steps > QUICK:
            self.check(self._steps, f"steps of the construction, {STEPS} allowed for each state", STEPS)

    def size(self, characters: int) -> None:
        """Refuse a text that is longer."""
        if characters > SHORT:
            self.check(characters, f"characters of the text, {CHARACTERS} allowed for each state", CHARACTERS)

    def check(self, reached: int, what: str, each: int = 1) -> None:
        """Refuse more of something than `each` for each state."""
        if reached > self.limit * each:
            raise TooLarge(what, limit=self.limit)


@dataclass(frozen=True)
class Structure:
    """The parts of a property, and its propositions: first the patterns of events (*atoms*), then
    the guards, each a bit.

    `names` gives a name for each pattern, `nodes` a node of the tree that has it, `atoms` the
    number of each pattern. `written` has each guard as the tree writes it.
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
        """The number of each guard among the propositions."""
        return {guard: number for number, guard in enumerate(self.guards, len(self.patterns))}

    @cached_property
    def bound(self) -> tuple[int, ...]:
        """For each atom the guards that have one of its variables."""
        having: dict[str, int] = {}
        for guard, number in self.guard_bits.items():
            having.update((name, having.get(name, 0) | 1 << number) for name in variables(guard))
        return tuple(union(having.get(name, 0) for name in rigid_variables(pattern)) for pattern in self.patterns)


def structure(prop: Property) -> Structure:
    """The parts and propositions of a property."""
    form = numbered(prop)
    parts: list[NumberedPart] = []
    of: list[int] = []
    kept: set[int] = set()  # what several parents share is not flattened
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
    return Structure(
        NumberedParts(tuple(parts[: of[-1] + 1])),
        {pattern: number for number, pattern in enumerate(events)},
        tuple(events),
        tuple(nodes),
        tuple(names),
        tuple(conditions),
        tuple(map(written, conditions.values())),
    )


def written(condition: Condition) -> str:
    """A condition as the tree writes it.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> from rvaft.core.passes import windows_to_guards
    >>> prop = windows_to_guards(build(rvaft.loads("time t as s; top sand a b within 90 s;")))
    >>> written(prop.root.parts[-1])
    'top within 90 s'
    """
    if condition.window is not None:
        return f"{name_text(condition.source.node)} within {duration_text(condition.window)}"
    return guard_text(condition.written or condition.guard)


def decided(form: NumberedParts, *, at_least: bool, work: Work) -> list[NumberedParts]:
    """The graphs, in a stable order, whose remaining choices can all wait; together they have the
    scenarios of the tree.

    `at_least` keeps the ways to choose more than K; raises `TooLarge` beyond so many graphs as states are allowed.
    """
    what = "ways to decide choices between parts that share nodes"

    def look(graph: NumberedParts) -> int | None:
        choice = _urgent(graph, work)
        if choice is not None:
            part = graph.parts[choice]
            work.check(comb(len(set(part.parts)), part.need), what)
        return choice

    done: list[NumberedParts] = []
    for graph, _ in divided(form, look, at_least=at_least):
        done.append(graph)
        work.check(len(done), what)
    return done


def _urgent(form: NumberedParts, work: Work) -> int | None:
    """The first choice with an alternative that reaches a part which is also reached otherwise."""
    kept = form.kept()
    references = Counter(child for number in kept for child in form.parts[number].parts)
    if all(count == 1 for count in references.values()):
        return None
    work.step(len(kept))
    rank = {number: index for index, number in enumerate(kept)}
    parents = dict.fromkeys(kept, 0)
    for number in kept:
        for child in form.parts[number].parts:
            parents[child] |= 1 << rank[number]
    inside: dict[int, int] = {}
    entered: dict[int, int] = {}
    for number in kept:
        below = form.parts[number].parts
        inside[number] = 1 << rank[number] | union(inside[child] for child in below)
        entered[number] = union(entered[child] | parents[child] for child in below)
    for number in reversed(kept):
        part = form.parts[number]
        if part.chooses and any(references[child] > 1 or entered[child] & ~inside[child] for child in part.parts):
            return number
    return None
