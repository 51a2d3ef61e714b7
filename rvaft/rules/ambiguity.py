"""Rules about events that fit several nodes, and nodes that several gates share."""

from collections import Counter
from collections.abc import Container, Iterator
from functools import cache
from itertools import combinations

from rvaft.core.feasibility import ScenarioSpace
from rvaft.core.overlaps import Overlaps
from rvaft.core.precedence import is_edge, node_of, path
from rvaft.core.property import EndInOrder, Kept, One, Part, Sequence
from rvaft.model.patterns import Anything, Pattern, Variable, substitute, walk
from rvaft.model.tree import RVAFT
from rvaft.rules.rule import RuleReport
from rvaft.support.bits import bits, mask_of, union
from rvaft.support.budget import Budget

_LISTED = 50


def ambiguous_event(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No event matches two unordered occurrences."""
    budget = space.budget()
    unordered = (pair for pair in _rivals(space, budget) if _unordered(space, *pair, budget))
    for count, (one, other) in enumerate(unordered):
        place = space.tree.nodes[one].place("on")
        if count == _LISTED:
            message = f"more than {_LISTED} pairs of unordered nodes share events; the others are not listed"
            yield RuleReport(place, message)
            return
        problem = f"{one} and {other} are not ordered, and one event can match either (but not both)"
        yield RuleReport(place, f"{problem}; order them with `sand`, or make their patterns differ", (one, other))


def _unordered(space: ScenarioSpace, one: str, other: str, budget: Budget) -> bool:
    # Without shared nodes, the order of two nodes is the same in every scenario.
    apart = bool(space.tree.shared) or space.ends
    if apart:
        budget.spend(5 * len(space.tree.order))
        events = space.leaf[one], space.leaf[other]
        apart = bool(path(space.widest, *events) or path(space.widest, *events[::-1]))
    if not apart and space.acyclic:
        return space.resolutions.possible((space.whole[one], space.whole[other]), budget)
    return space.feasible(budget, (one, other), apart=(one, other) if apart else None) is not None


def _rivals(space: ScenarioSpace, budget: Budget) -> Iterator[tuple[str, str]]:
    """Iterate over pairs of overlapping occurrences that may be unordered in a scenario.

    Sets of occurrences are bit masks; numbers are consecutive in every part of the forest.
    """
    tree, kept = space.tree, space.resolutions.union
    groups = _by_event(tree, [name for name in tree.occurrences if space.leaf[name] in kept])
    many = Overlaps(list(groups))
    budget.spend(len(groups))
    # A pattern overlaps itself, so its nodes are rivals of each other.
    group_of: dict[Part, int] = {
        space.leaf[name]: number
        for number, group in enumerate(groups.values())
        if len(group) > 1 or many.compatible(number) != 1 << number
        for name in group
    }
    parent, below = _forest(kept, group_of)
    events = sorted(group_of, key=lambda event: below[event].start)
    index = {name: index for index, name in enumerate(tree.order)}
    members = [
        mask_of(below[event].start for event in events if group_of[event] == group) for group in range(len(groups))
    ]

    @cache
    def rivals(group: int) -> int:
        return members[group] | union(members[other] for other in bits(many.exact(group, budget)))

    free: dict[Part, int] = {}  # the events that no order or choice surely separates from a part
    for part in kept:
        around = parent.get(part)
        free[part] = _mask(range(len(events))) ^ _mask(below[part]) if around is None else free[around]
        if around is not None and not isinstance(around, Sequence | One):
            free[part] |= _mask(below[around]) ^ _mask(below[part])
        if part in group_of and free[part]:
            found = [index[node_of(events[rival])] for rival in bits(free[part] & rivals(group_of[part]))]
            for later in sorted(place for place in found if place > index[node_of(part)]):
                budget.spend(1)
                yield node_of(part), tree.order[later]


def _by_event(tree: RVAFT, names: list[str]) -> dict[Pattern, list[str]]:
    """Return occurrences by event pattern; a variable that occurs only once matches anything."""
    patterns = {name: tree.pattern(name) or Anything() for name in names}
    parts = (part for pattern in set(patterns.values()) for part in walk(pattern))
    uses = Counter(part.name for part in parts if isinstance(part, Variable))
    lone = {name: Anything() for name, count in uses.items() if count == 1}
    groups: dict[Pattern, list[str]] = {}
    for name, pattern in patterns.items():
        groups.setdefault(substitute(pattern, lone), []).append(name)
    return groups


def _forest(kept: Kept, marked: Container[Part]) -> tuple[dict[Part, Part], dict[Part, range]]:
    """Return the parent of each part with exactly one, and the range of marked parts below each
    part.
    """
    parents: dict[Part, list[Part]] = {}
    for part, inside in kept.items():
        for inner in inside:
            parents.setdefault(inner, []).append(part)
    parent = {part: around[0] for part, around in parents.items() if len(around) == 1}
    size = {part: int(part in marked) for part in kept}
    for part in reversed(list(kept)):
        if part in parent:
            size[parent[part]] += size[part]
    below: dict[Part, range] = {}
    following: dict[Part | None, int] = {None: 0}  # the next number, below each part and at the top level
    for part in kept:
        start = following[parent.get(part)]
        following[parent.get(part)] += size[part]
        following[part] = start + (part in marked)
        below[part] = range(start, start + size[part])
    return parent, below


def _mask(numbers: range) -> int:
    return (1 << numbers.stop) - (1 << numbers.start)


def shared_under_order(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No node has two parents in one scenario with different places under ordered gates."""
    tree, budget, kept = space.tree, space.budget(), space.resolutions.union
    if not tree.shared:
        return
    above: dict[Part, list[Part]] = {}
    for part, inside in kept.items():
        for inner in inside:
            above.setdefault(inner, []).append(part)
    slots: dict[Part, int] = {}
    owners: list[str] = []
    for part in kept:
        sides: dict[Part, int] = {}
        for around in above.get(part, ()):
            sides[around] = slots[around]
            if isinstance(around, Sequence | EndInOrder) and is_edge(around, part):
                sides[around] |= 1 << len(owners)
                owners.append(node_of(around))
        slots[part] = union(sides.values())
        for first, second in combinations(sides, 2):
            if sides[first] == sides[second] or any(tree.nodes[node_of(one)].made for one in (part, first, second)):
                continue
            budget.spend(1)
            if not space.resolutions.possible((), budget, edges=[(first, part), (second, part)]):
                continue
            slot = (sides[first] ^ sides[second]).bit_length() - 1
            name, one, other = node_of(part), node_of(first), node_of(second)
            by, too = (one, other) if sides[first] >> slot & 1 else (other, one)
            problem = f"{name} is shared by {one} and {other} and happens once"
            so = f"so the order that {owners[slot]} requires below {by} also applies below {too}"
            message = f"{problem}, {so}; use two nodes for two events"
            yield RuleReport(tree.nodes[name].place(), message, (name, one, other))
            break
