"""The rule about contradictory guards of one branch.

Only guards that share variables can contradict each other. For each such group, search a witness of
all guards; it usually exists. Otherwise compute a minimal subset without a witness, and report it
if a feasible scenario contains it. If none does, two of its nodes usually exclude each other:
continue without one of them, and with the guards compatible with it.
"""

from collections.abc import Iterable, Iterator
from itertools import combinations, islice, pairwise
from typing import TypeAlias

from rvaft.core.feasibility import ScenarioSpace
from rvaft.core.precedence import node_of
from rvaft.core.property import Condition, Kept
from rvaft.core.solver import contradictory, contradictory_over_reals, refuted, witness
from rvaft.model.guards import Guard, Operation, Operator, conjuncts, time_points, variables
from rvaft.rules.rule import RuleReport, branch_of
from rvaft.support.bits import DisjointSets
from rvaft.support.budget import Budget
from rvaft.support.wording import listing

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
