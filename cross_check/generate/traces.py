"""Random traces that have to do with a tree: events that fit its patterns, near misses, and noise."""

from collections.abc import Sequence
from random import Random

from rvaft.model.guards import Guard
from rvaft.model.guards import walk as guard_walk
from rvaft.model.patterns import Anything, Binding, ListPattern, Literal, ObjectPattern, Pattern, Variable, walk
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, is_number

COMMON: tuple[Json, ...] = (
    0,
    1,
    1.0,
    2,
    3,
    1.5,
    -1,
    "a",
    "b",
    "",
    True,
    False,
    None,
    [1],
    [],
    {"k": 1},
    {"k": 1.0, "l": 2},
)


def interesting_values(tree: RVAFT) -> list[Json]:
    """Values that make a difference to a tree: its literals, values next to the constants of its guards, all types."""
    found: list[Json] = []
    for node in tree.top_down():
        pattern = tree.pattern(node.name)
        parts = walk(pattern) if pattern is not None else ()
        found.extend(part.value for part in parts if isinstance(part, Literal))
        found.extend(_constants(node.when))
    for ignore in tree.ignores:
        found.extend(_constants(ignore.when))
    near = [v + d for v in found if is_number(v) for d in (-1, 1)]
    return [*found, *near, *COMMON]


def _constants(guard: Guard | None) -> list[Json]:
    return [] if guard is None else [part.value for part in guard_walk(guard) if isinstance(part, Literal)]


def random_event(random: Random, tree: RVAFT, values: Sequence[Json]) -> Json:
    """One event: usually a fit of some pattern, sometimes of two at once, disturbed, or irrelevant."""
    patterns = [entry.pattern for entry in tree.alphabet]
    dice = random.random()
    if dice < 0.05:
        return {"noise": random.choice(values)}
    event = fitting(random, random.choice(patterns), values)
    if dice < 0.25:
        event = {**event, **fitting(random, random.choice(patterns), values)}
    elif dice < 0.35 and event:
        event.pop(random.choice(sorted(event)))
    elif 0.35 <= dice < 0.45 and event:
        event[random.choice(sorted(event))] = random.choice(values)
    return event


def fitting(random: Random, pattern: Pattern, values: Sequence[Json], binding: Binding | None = None) -> Json:
    """A value that matches the pattern with these values for its variables, random ones for those without."""
    chosen = dict(binding or {})

    def build(part: Pattern) -> Json:
        match part:
            case Literal(value):
                return value
            case Variable(name):
                return chosen[name] if name in chosen else chosen.setdefault(name, random.choice(values))
            case Anything():
                return random.choice(values)
            case ObjectPattern(fields):
                return {name: build(inner) for name, inner in fields}
            case ListPattern(items):
                return [build(item) for item in items]

    return build(pattern)


def random_trace(random: Random, tree: RVAFT, *, max_length: int = 8) -> list[Json]:
    """A trace of up to that many events over a handful of values, so that values repeat."""
    everything = interesting_values(tree)
    values = [random.choice(everything) for _ in range(3)]
    return [random_event(random, tree, values) for _ in range(random.randint(0, max_length))]
