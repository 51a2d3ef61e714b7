"""The rule about guards of one branch that cannot hold together.

Only guards that share variables, directly or through others, can contradict each other. For such a group first look for one
assignment under which all hold: where there is one, no scenario is affected, and that is the whole work for ordinary trees.
Otherwise take a smallest part of the group without a witness. If a feasible scenario contains that part, it is reported; if none
does, mostly because two of its guards exclude each other, go on with the group without the one, and with what can be together with it.
sympy is imported only where sorts and order prove nothing.
"""

from collections import Counter
from collections.abc import Iterator
from itertools import combinations, islice, pairwise
from typing import Final

import networkx as nx

from rvaft.analysis.guard_solver import contradictory, contradictory_over_reals, refuted, witness
from rvaft.analysis.scenarios import Kept, ScenarioSpace, inevitable
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Node, On, Place
from rvaft.model.patterns import Anything, Variable, rigid_variables
from rvaft.rules.rule import RuleReport, branch_of, did_you_mean, listing
from rvaft.support.budget import Budget, Undecided

# Rules about variables: each is bound where a guard needs it, and none is written once only (semantics, section 1).

_ONE_OF_TWO_LETTERS: Final = 0.5
"""How alike names must be to be taken for each other: T1 and T2 are."""


def unbound_variable(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every variable of a guard occurs in an `on` in every feasible scenario that contains the guard."""
    tree = space.tree
    guarded = [(node, guard_variables(node.when)) for node in tree.top_down() if node.when is not None]
    wanted = tuple(dict.fromkeys(name for _, names in guarded for name in names))
    if not wanted or not space.resolutions:
        return
    bit = {name: 1 << index for index, name in enumerate(wanted)}
    binders: dict[str, list[str]] = {name: [] for name in wanted}
    marks: dict[str, int] = {}
    for occurrence in tree.occurrences:
        for name in rigid_variables(tree.pattern(occurrence) or Anything()):
            if name in bit:
                marks[occurrence] = marks.get(occurrence, 0) | bit[name]
                binders[name].append(occurrence)
    full = (1 << len(wanted)) - 1
    # A scenario that binds everything and one that is no scenario must not look alike: one bit more for the latter.
    never = 1 << len(wanted)
    bound = inevitable(tree, marks | dict.fromkeys(space.dead, full | never), full | never)
    budget, late = space.budget(), None
    for node, names in guarded:
        for name in names:
            if not bound[node.name] & bit[name]:
                try:
                    kept = space.feasible(budget, [node.name], without=frozenset(binders[name]))
                except Undecided as undecided:
                    if not space.acyclic:
                        late = undecided
                        continue
                    kept = {}  # There surely is such a scenario, only it was not found in time to be named.
                if kept is not None:
                    yield RuleReport(node.place("when"), _unbound(space, node, name, binders[name], kept), (node.name,))
    if late is not None:
        raise late


def _unbound(space: ScenarioSpace, node: Node, name: str, binders: list[str], kept: Kept) -> str:
    where = branch_of(space.tree, kept) if kept else "some branch"
    said = f"variable {name} in the guard of {node.name} is not bound in {where}"
    if binders:
        return f"{said}; only {listing(binders)} binds it: use it in the `on` of a node that is there whenever {node.name} is"
    guess = did_you_mean(name, space.tree.variables, cutoff=_ONE_OF_TWO_LETTERS)
    return f"{said}; no `on` binds it{guess}"


def variable_once(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A variable written once says nothing; it is often misspelt."""
    tree = space.tree
    uses: Counter[str] = Counter()
    where: dict[str, tuple[Place, tuple[str, ...]]] = {}
    for node in tree.top_down():
        in_on = _arguments(node.on)
        uses.update(in_on)
        for name in in_on:
            where.setdefault(name, (node.place("on"), (node.name,)))
        if node.when is not None:
            uses.update(guard_variables(node.when))
    once = [(place, name, nodes) for name, (place, nodes) in where.items() if uses[name] == 1]
    for ignore in tree.ignores:
        inside = Counter(_arguments(ignore.on))
        inside.update(guard_variables(ignore.when) if ignore.when is not None else ())
        once += [(ignore.place, name, ()) for name in inside if inside[name] == 1]
    known = [name for name in uses if uses[name] > 1]
    for place, name, nodes in once:
        yield RuleReport(place, f"variable {name} is used once only; write `_`{did_you_mean(name, known)}", nodes)


def _arguments(on: On | None) -> list[str]:
    return [argument.name for argument in on.arguments if isinstance(argument, Variable)] if on is not None else []


_PAIRS = 400
_COST = 1_000
_ALGEBRA = 20_000

Group = dict[str, Guard]
Core = tuple[str, ...]


def contradictory_guards(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Some branch has guards that no values satisfy together."""
    budget = space.budget()
    for group in _groups(space):
        for core, kept in _conflicts(space, group, budget):
            guards = [group[name] for name in core]
            where = f"the guards of {listing(core)}" if len(core) > 1 else f"the guard of {core[0]}"
            branch = branch_of(space.tree, kept)
            place = space.tree.nodes[core[0]].place("when")
            if refuted(guards):
                yield RuleReport(
                    place, f"{where} cannot hold{' together' * (len(core) > 1)} in {branch}; mend one", core
                )
                continue
            budget.spend(_ALGEBRA)

            certain = contradictory(guards)
            if certain:
                yield RuleReport(
                    place, f"{where} cannot hold{' together' * (len(core) > 1)} in {branch}; mend one", core
                )
            elif certain is None and contradictory_over_reals(guards):
                message = f"{where} contradict each other by exact arithmetic and can hold at most through rounding"
                yield RuleReport(place, f"{message}, in {branch}", core, undecided=True)
            elif certain is None:
                message = f"whether {where} can hold in {branch} was not decided"
                yield RuleReport(place, message, core, undecided=True)


def _groups(space: ScenarioSpace) -> Iterator[Group]:
    """The guards with variables, grouped by shared variables."""
    graph = nx.Graph()
    guards: Group = {}
    for node in space.tree.top_down():
        names = guard_variables(node.when) if node.when is not None and node.name in space.resolutions else ()
        if node.when is not None and names:
            guards[node.name] = node.when
            graph.add_edges_from((("node", node.name), ("variable", name)) for name in names)
    grouped: dict[int, Group] = {}
    component = {point: number for number, points in enumerate(nx.connected_components(graph)) for point in points}
    for name, guard in guards.items():
        grouped.setdefault(component["node", name], {})[name] = guard
    yield from grouped.values()


def _conflicts(space: ScenarioSpace, group: Group, budget: Budget) -> Iterator[tuple[Core, Kept]]:
    """Smallest sets of guards without a witness, each with a feasible scenario that contains it.

    At least one for each scenario whose guards have no witness, unless a set found before is part of it or overlaps it.
    """
    todo: list[Core] = [tuple(group)]
    seen = set(todo)
    while todo:
        names = todo.pop()
        core = _core(names, group, budget, hopeful=len(names) == len(group))
        if not core:
            continue
        kept = space.feasible(budget, core)
        rest: list[Core] = []
        if kept is not None:
            yield core, kept
            rest.append(_without(names, core[-1]))
        else:
            pairs = combinations(core, 2)
            apart = next((pair for pair in pairs if not space.resolutions.possible(pair, budget)), None)
            if apart is not None:
                one = apart[0]
                together = tuple(n for n in names if n == one or space.resolutions.possible((one, n), budget))
                rest += [_without(names, one), together]
            else:
                rest += [_without(names, name) for name in core]
        for smaller in rest:
            if smaller not in seen:
                seen.add(smaller)
                todo.append(smaller)


def _without(names: Core, name: str) -> Core:
    return tuple(other for other in names if other != name)


def _core(names: Core, group: Group, budget: Budget, *, hopeful: bool) -> Core:
    """A smallest part of the guards that has no witness; nothing where all together have one."""
    budget.spend(len(names))
    if not hopeful:
        # Where the larger group had no witness, neighbours often are to blame; that is cheap to see.
        for pair in islice(pairwise(names), 3):
            if _refuted(pair, group):
                return _smallest(pair, group, budget)
    if not names or witness(group[name] for name in names) is not None:
        return ()
    budget.spend(_COST)
    for name in islice(names, _PAIRS):
        if refuted([group[name]]):
            return (name,)
    for pair in islice(combinations(names, 2), _PAIRS):
        if _refuted(pair, group):
            return pair
    return _smallest(names, group, budget)


def _refuted(pair: Core, group: Group) -> bool:
    one, other = (group[name] for name in pair)
    return bool(set(guard_variables(one)) & set(guard_variables(other))) and refuted([one, other])


def _smallest(names: Core, group: Group, budget: Budget) -> Core:
    """A smallest part without a witness: again and again the guard that takes the last witness from those before it."""

    def hopeless(some: Core) -> bool:
        budget.spend(_COST // 10 + len(some))
        return witness(group[name] for name in some) is None

    core: Core = ()
    rest = names
    while not core or not hopeless(core):
        low, high = 0, len(rest)
        while high - low > 1:
            middle = (low + high) // 2
            if hopeless(core + rest[:middle]):
                high = middle
            else:
                low = middle
        core, rest = (*core, rest[high - 1]), rest[: high - 1]
        if not rest:
            break
    return tuple(name for name in names if name in core)
