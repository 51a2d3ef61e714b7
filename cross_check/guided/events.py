"""Events built for a tree: one that a pattern takes under given values, and one that the tree has nothing to do with."""

from collections.abc import Mapping, Sequence
from random import Random

from rvaft.guards import holds
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, match
from rvaft.tree import RVAFT
from rvaft.values import Json

_NAMES = ("heartbeat", "status", "log")


def built(random: Random, pattern: Pattern, binding: Mapping[str, Json], values: Sequence[Json]) -> Json:
    """A value that matches the pattern with these values for its variables, random ones for those without."""
    chosen = dict(binding)

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


def some_event(random: Random, tree: RVAFT, values: Sequence[Json]) -> Json:
    """An event that fits a random runtime event of the tree."""
    event = built(random, random.choice(tree.alphabet).pattern, {}, values)
    return event if isinstance(event, dict) else {"event": event}


def noise(random: Random, tree: RVAFT, values: Sequence[Json]) -> Json | None:
    """An event that is not relevant to the tree, or None where none was met."""
    for _ in range(10):
        event: Json = {"event": random.choice(_NAMES), "value": random.choice(values)}
        if random.random() < 0.3:
            event = some_event(random, tree, values)
            event.pop(random.choice(sorted(event)), None) if event else None
        if not any(match(entry.pattern, event, {}) is not None for entry in tree.alphabet) or ignored(tree, event):
            return event
    return None


def ignored(tree: RVAFT, event: Json) -> bool:
    """Whether an `ignore` declaration takes the event."""
    for ignore in tree.ignores:
        found = match(tree.instantiate(ignore.on), event, {})
        if found is not None:
            names = () if ignore.when is None else guard_variables(ignore.when)
            if ignore.when is None or (set(names) <= set(found) and holds(ignore.when, found)):
                return True
    return False
