"""Passes from properties to equivalent properties with fewer constructs.

No pass adds a construct that an earlier pass removes.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, assert_never

from rvaft.core.property import (
    IMPOSSIBLE,
    NOTHING,
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    Property,
    Sequence,
    Source,
    Times,
    Within,
    WithoutEvent,
    with_parts,
)
from rvaft.core.restriction import allowing, singly
from rvaft.core.scenarios import is_constant
from rvaft.errors import TooLarge
from rvaft.model import patterns
from rvaft.model.guards import Guard, Operation, Operator, holds, renamed, time_points
from rvaft.model.patterns import Pattern, Variable
from rvaft.model.tree import shown_name

LIMIT: Final = 5_000
"""The default maximum number of alternatives that a pass makes."""
DISTINCT: Final = 100
"""The maximum count of a leaf of different values; each pair of events becomes a condition."""
MOST: Final = 10_000
"""The maximum count of a leaf; each event becomes a part."""


@dataclass(frozen=True, slots=True)
class Pass:
    """A pass with the constructs that it removes."""

    name: str
    removes: frozenset[type[Part]]
    run: Callable[[Property, int], Property]

    def __call__(self, prop: Property, limit: int = LIMIT) -> Property:
        """Return the property without these constructs; raises `TooLarge` beyond the limit."""
        return self.run(prop, limit)


def _expand_times(prop: Property, _: int) -> Property:
    def counted(part: Times) -> list[Event]:
        node = part.source.node
        if part.count > MOST:
            raise TooLarge(f"events that {node} counts, {part.count:,}", limit=MOST, remedy="count fewer events")
        numbers = range(1, part.count + 1)
        return [Event(Source(node, number), renamed_pattern(part, number)) for number in numbers]

    used = prop.variables

    def renamed_pattern(part: Times, number: int) -> Pattern:
        own = {old: Variable(new) for old, new in own_of(part, number).items()}
        return patterns.substitute(part.pattern, own)

    def own_of(part: Times, number: int) -> dict[str, str]:
        """Return the variables of one event in place of those that each event has."""
        found = {}
        for name in part.own:
            fresh = f"{shown_name(name)}_{number}"
            while fresh in used:
                fresh += "_"
            found[name] = fresh
        return found

    def differences(part: Times) -> list[Condition]:
        """Return the conditions that the values of any two events are different."""
        names = [own_of(part, number) for number in range(1, part.count + 1)] if part.distinct else []
        found = []
        for later, other in enumerate(names):
            for one in names[:later]:
                pairs = [(Variable(one[name]), Variable(other[name])) for name in part.distinct]
                differ: list[Guard] = [Operation(Operator.NE, pair) for pair in pairs]
                guard = differ[0] if len(differ) == 1 else Operation(Operator.OR, tuple(differ))
                found.append(Condition(Source(part.source.node, later + 1), guard))
        return found

    def expanded(part: Times, source: Source, guard: Guard | None) -> Part:
        if len(part.distinct) > 0 and part.count > DISTINCT:
            what = f"different values that {part.source.node} counts, {part.count:,}, in this form"
            raise TooLarge(what, limit=DISTINCT, remedy="count fewer, or use the engine with semantics scattered")
        inner: list[Part] = []
        for event in counted(part):
            own = None if guard is None else renamed(guard, own_of(part, event.source.number))
            inner.append(event if own is None else All(event.source, (event, Condition(event.source, own))))
        whole = Sequence(source, tuple(inner))
        apart = differences(part)
        return All(source, (whole, *apart)) if apart else whole

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        match part:
            case Times():
                return expanded(part, part.source, None)
            case All(source=Source() as source, parts=(Times() as leaf, Condition(guard=guard))) if not time_points(
                guard
            ):
                return expanded(leaf, source, guard)
            case _:
                return with_parts(part, parts)

    return prop.rewritten(change) if any(isinstance(part, Times) for part in prop.parts) else prop


expand_times: Final = Pass("expand_times", frozenset({Times}), _expand_times)
"""A counted leaf becomes a sequence of events, each with the leaf's guard unless it has time
points.
"""


def decide_constants(prop: Property) -> Property:
    """Return the property with constant conditions decided and impossible parts removed."""

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        possible = tuple(inner for inner in parts if inner is not IMPOSSIBLE)
        match part:
            case Event() | Times():
                return part
            case Condition():
                if not is_constant(part):
                    return part
                return All(part.source, ()) if holds(part.guard, {}) else IMPOSSIBLE
            case One():
                return One(part.source, possible) if possible else IMPOSSIBLE
            case AtLeast():
                if len(possible) < part.need:
                    return IMPOSSIBLE
                if len(possible) == part.need:
                    return All(part.source, possible)
                return with_parts(part, possible)
            case All() | Sequence() | EndInOrder() | Within() | WithoutEvent():
                return with_parts(part, parts) if len(possible) == len(parts) else IMPOSSIBLE
            case _:
                assert_never(part)

    return prop.rewritten(change)


def _simplify(prop: Property, _: int) -> Property:
    return prop.with_root(decide_constants(prop).root)


simplify: Final = Pass("simplify", frozenset(), _simplify)
"""`decide_constants` as a pass, after the windows are removed."""


def with_choices(prop: Property, choices: Mapping[str, str]) -> Property:
    """Return the simplified property with these choices; impossible if they conflict."""
    return simplify(allowing(prop, singly(choices)))


def _flatten(prop: Property, _: int) -> Property:
    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        match part:
            case All() | Sequence():
                kind = type(part)
                nested = (each.parts if isinstance(each, kind) else (each,) for each in parts)
                inner = [
                    subpart
                    for each in nested
                    for subpart in each
                    if not (isinstance(subpart, All) and not subpart.parts)
                ]
                if isinstance(part, All):
                    inner = list(dict.fromkeys(inner))
                if not inner:
                    return NOTHING
                return inner[0] if len(inner) == 1 else kind(part.source, tuple(inner))
            case Event() | Times() | Condition() | One() | AtLeast() | EndInOrder() | Within() | WithoutEvent():
                return with_parts(part, parts)
            case _:
                assert_never(part)

    return prop.with_root(prop.rewritten(change).root)


flatten: Final = Pass("flatten", frozenset(), _flatten)
"""Nested sequences and nested unordered parts are merged."""
