"""Rules about scenarios: existence, bound variables, ambiguity, order and contradictory guards."""

from collections import Counter
from collections.abc import Container, Iterable, Iterator
from functools import cache
from itertools import combinations, islice, pairwise
from typing import Final, TypeAlias

from rvaft.core.patterns import Overlaps
from rvaft.core.property import Condition, EndInOrder, One, Part, Sequence
from rvaft.core.scenario_space import ScenarioSpace, borne_surely, inevitable, is_edge, node_of, path
from rvaft.core.scenarios import Kept
from rvaft.core.solver import contradictory, contradictory_over_reals, refuted, witness
from rvaft.model.guards import Guard, Operation, Operator, conjuncts, time_points, variables
from rvaft.model.nodes import Node
from rvaft.model.patterns import Anything, Pattern, Variable, rigid_variables, substitute, walk
from rvaft.model.tree import RVAFT, knots
from rvaft.rules.rule import RuleReport, branch_of
from rvaft.support.bits import DisjointSets, bits, mask_of, union
from rvaft.support.budget import Budget, Undecided
from rvaft.support.wording import did_you_mean, listing

_EVENT, _NEVER = 1, 2


def no_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Some scenario is feasible."""
    if not space.is_empty:
        return
    tree = space.tree
    dead: tuple[str, ...] = ()
    why = "in every scenario some event precedes itself; do not share a node between the children of an ordered gate"
    if not space.resolutions:
        dead = tuple(name for name in tree.order if name in space.dead)
        why = f"the guard of {listing(dead)} never holds; correct the guard or remove the node"
    yield RuleReport(tree.nodes[tree.root].place(), f"the tree has no feasible scenario: {why}", (tree.root, *dead))


def silent_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every feasible scenario has an occurrence."""
    tree = space.tree
    if all(node.name in space.leaf for node in tree.top_down() if node.leaf):
        return
    marks: dict[Part, int] = dict.fromkeys(space.leaf.values(), _EVENT)
    marks |= dict.fromkeys(space.never, _EVENT | _NEVER)
    if inevitable(space.order, marks, _EVENT | _NEVER)[space.prop.root]:
        return
    kept = space.feasible(space.budget(), without=tree.occurrences)
    assert kept is not None
    guards = tuple(node_of(part) for part in kept if isinstance(part, Condition)) or (tree.root,)
    message = f"{branch_of(kept)}, has no runtime event and would be detected before the first event"
    mend = f"; give {listing(guards[:3], 'or')} an event with `on`"
    yield RuleReport(tree.nodes[guards[0]].place(), message.replace(", has", " has") + mend, guards)


def infeasible_scenario(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No scenario is infeasible; infeasible scenarios are dropped."""
    if not space.resolutions:
        return
    tree = space.tree
    for name in tree.order:
        if name in space.dead:
            message = f"the guard of {name} never holds, so every scenario with {name} is dropped"
            yield RuleReport(tree.nodes[name].place("when"), message, (name,))
    if space.acyclic or space.is_empty:
        return
    budget = space.budget()
    for knot in knots(space.widest):
        found = space.cyclic(budget, knot)
        if found is not None:
            kept, nodes = found
            where = f"before itself in {branch_of(kept)}, so that scenario is dropped"
            mend = "do not put an event below two children of one ordered gate"
            message = f"{listing(nodes)} would have to come {where}; {mend}"
            yield RuleReport(tree.nodes[nodes[0]].place(), message, nodes)
    if (unending := space.endless(budget)) is not None:
        kept, gate = unending
        where = f"cannot end one after the other in {branch_of(kept)}, so that scenario is dropped"
        mend = "let no two of them end with the same event"
        yield RuleReport(tree.nodes[gate].place("gate"), f"the parts of {gate} {where}; {mend}", (gate,))


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
            if sides[first] == sides[second]:
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


_ONE_OF_TWO_LETTERS: Final = 0.5
"""The similarity of `T1` and `T2`, one of which is suggested for the other."""


def unbound_variable(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every variable of a guard occurs in an `on` in every feasible scenario with the guard."""
    tree = space.tree
    binders: dict[str, list[str]] = {}
    for occurrence in tree.occurrences:
        for name in rigid_variables(tree.pattern(occurrence) or Anything()):
            binders.setdefault(name, []).append(occurrence)
    uses: list[tuple[Node, str]] = []  # guards with a variable that the node's own event does not bind
    for node in tree.top_down():
        bound_here = set(rigid_variables(tree.pattern(node.name) or Anything()))
        bound_here.update(point.name for point in time_points(node.when))
        uses += ((node, name) for name in variables(node.when) if name not in bound_here)
    bearers = {name: [space.leaf[binder] for binder in some] for name, some in binders.items()}
    sure = borne_surely(space, [(node.name, name) for node, name in uses], bearers)
    budget = space.budget()
    for node, name in uses if space.resolutions else ():
        if (node.name, name) in sure:
            continue
        kept: Kept | None
        try:
            kept = space.feasible(budget, [node.name], without=binders.get(name, ()))
        except Undecided:
            if not space.acyclic:
                raise
            kept = {}  # The scenario exists, but the search for it reached the limit.
        if kept is not None:
            where = branch_of(kept) if kept else "some branch"
            mend = f"no `on` binds it{did_you_mean(name, tree.variables, cutoff=_ONE_OF_TWO_LETTERS)}"
            if name in binders:
                there = f"add it to the `on` of a node that is in every scenario with {node.name}"
                mend = f"only {listing(binders[name])} binds it: {there}"
            message = f"variable {name} in the guard of {node.name} is not bound in {where}; {mend}"
            yield RuleReport(node.place("when"), message, (node.name,))


# Contradictory guards of one branch.
#
# Only guards that share variables can contradict each other. For each such group, search a witness
# of all guards; it usually exists. Otherwise compute a minimal subset without a witness, and report
# it if a feasible scenario contains it. If none does, two of its nodes usually exclude each other:
# continue without one of them, and with the guards compatible with it.

_PAIRS = 400
_COST = 1_000
_ALGEBRA = 20_000

Group: TypeAlias = dict[str, Guard]
Core: TypeAlias = tuple[str, ...]


def contradictory_guards(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No branch has contradictory guards."""
    budget = space.budget()
    for group in _groups(space):
        for core, kept in _conflicts(space, group, budget):
            guards = [group[name] for name in core]
            certain = refuted(guards)
            if not certain:
                budget.spend(_ALGEBRA)
                certain = contradictory(guards) is True
            where = f"the guards of {listing(core)}" if len(core) > 1 else f"the guard of {core[0]}"
            branch, together = branch_of(kept), " together" * (len(core) > 1)
            if certain:
                message = f"{where} cannot hold{together} in {branch}; change one"
            elif contradictory_over_reals(guards):
                rounding = "contradict each other by exact arithmetic and can hold at most through rounding"
                message = f"{where} {rounding}, in {branch}"
            else:
                message = f"whether {where} can hold in {branch} was not decided"
            yield RuleReport(space.tree.nodes[core[0]].place("when"), message, core, undecided=not certain)


def _groups(space: ScenarioSpace) -> Iterable[Group]:
    conditions = (part for part in space.resolutions.union if isinstance(part, Condition))
    own = ((node_of(part), _without_times(part.guard)) for part in conditions)
    guarded = [(name, guard) for name, guard in own if guard is not None]
    numbers = {
        name: at for at, name in enumerate(dict.fromkeys(one for _, guard in guarded for one in variables(guard)))
    }
    related = DisjointSets(len(numbers))
    for _, guard in guarded:
        related.unite(numbers[one] for one in variables(guard))
    groups: dict[int, Group] = {}
    for name, guard in guarded:
        for variable in variables(guard)[:1]:
            groups.setdefault(related.first(numbers[variable]), {})[name] = guard
    return groups.values()


def _without_times(guard: Guard | None) -> Guard | None:
    kept = [part for part in conjuncts(guard) if not time_points(part)]
    return Operation(Operator.AND, tuple(kept)) if len(kept) > 1 else kept[0] if kept else None


def _conflicts(space: ScenarioSpace, group: Group, budget: Budget) -> Iterator[tuple[Core, Kept]]:
    """Iterate over minimal sets of guards without a witness, each with a feasible scenario.

    Every scenario without a witness contains such a set, unless an earlier one overlaps it.
    """

    def possible(nodes: Core) -> bool:
        return space.resolutions.possible((space.whole[name] for name in nodes), budget)

    todo: list[Core] = [tuple(group)]
    seen = set(todo)
    while todo:
        names = todo.pop()
        core = _core(names, group, budget, expects_witness=len(names) == len(group))
        if not core:
            continue
        kept, apart = space.feasible(budget, core), None
        if kept is not None:
            yield core, kept
        else:
            apart = next((pair for pair in combinations(core, 2) if not possible(pair)), None)
        left_out = core if kept is None and apart is None else [core[-1] if apart is None else apart[0]]
        rest = [tuple(other for other in names if other != name) for name in left_out]
        if apart is not None:
            rest.append(tuple(n for n in names if n == apart[0] or possible((apart[0], n))))
        for smaller in rest:
            if smaller not in seen:
                seen.add(smaller)
                todo.append(smaller)


def _core(names: Core, group: Group, budget: Budget, *, expects_witness: bool) -> Core:
    """Return a minimal subset of the guards without a witness; empty if all have one."""

    def exclusive(pair: Core) -> bool:
        one, other = (group[name] for name in pair)
        return bool(set(variables(one)) & set(variables(other))) and refuted([one, other])

    budget.spend(len(names))
    if not expects_witness:
        # Neighbours are often the cause, and cheap to test.
        for pair in islice(pairwise(names), 3):
            if exclusive(pair):
                return _smallest(pair, group, budget)
    if not names or witness(group[name] for name in names) is not None:
        return ()
    budget.spend(_COST)
    for name in islice(names, _PAIRS):
        if refuted([group[name]]):
            return (name,)
    pairs = islice(combinations(names, 2), _PAIRS)
    return next(filter(exclusive, pairs), None) or _smallest(names, group, budget)


def _smallest(names: Core, group: Group, budget: Budget, *, twice: bool = False) -> Core:
    """Return a minimal subset without a witness.

    It repeatedly adds the guard that removes the last witness. If the result has a witness in its
    own order of guards, both orders are tried.
    """

    def lacks_witness(some: Core) -> bool:
        budget.spend(_COST // 10 + len(some))
        orders = (some, tuple(name for name in names if name in some)) if twice else (some,)
        return all(witness(group[name] for name in order) is None for order in orders)

    core, rest = names[:0], names
    while not core or (rest and not lacks_witness(core)):
        low, high = 0, len(rest)
        while high - low > 1:
            middle = (low + high) // 2
            if lacks_witness(core + rest[:middle]):
                high = middle
            else:
                low = middle
        core, rest = (*core, rest[high - 1]), rest[: high - 1]
    found = tuple(name for name in names if name in core)
    if twice or len(found) == len(names) or witness(group[name] for name in found) is None:
        return found
    return _smallest(names, group, budget, twice=True)
