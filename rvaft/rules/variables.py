"""Rules about variables: each is bound where a guard needs it, and none is written once only (semantics, section 1)."""

from collections import Counter
from collections.abc import Iterator
from typing import Final

from rvaft.findings import Severity
from rvaft.guards import variables as guard_variables
from rvaft.model import Node, On, Place
from rvaft.patterns import Anything, Variable, rigid_variables
from rvaft.precedence import Kept
from rvaft.rules.context import Context
from rvaft.rules.inevitable import inevitable
from rvaft.rules.rule import Report, Rule, Undecided
from rvaft.rules.words import branch_of, did_you_mean, listing

_ONE_OF_TWO_LETTERS: Final = 0.5
"""How alike names must be to be taken for each other: T1 and T2 are."""


def unbound_variable(context: Context) -> Iterator[Report]:
    """Every variable of a guard occurs in an `on` in every feasible scenario that contains the guard."""
    tree = context.tree
    guarded = [(node, guard_variables(node.when)) for node in tree.top_down() if node.when is not None]
    wanted = tuple(dict.fromkeys(name for _, names in guarded for name in names))
    if not wanted or not context.space:
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
    bound = inevitable(tree, marks | dict.fromkeys(context.dead, full | never), full | never)
    budget, late = context.budget(), None
    for node, names in guarded:
        for name in names:
            if not bound[node.name] & bit[name]:
                try:
                    kept = context.feasible(budget, [node.name], without=frozenset(binders[name]))
                except Undecided as undecided:
                    if not context.acyclic:
                        late = undecided
                        continue
                    kept = {}  # There surely is such a scenario, only it was not found in time to be named.
                if kept is not None:
                    yield Report(node.place("when"), _unbound(context, node, name, binders[name], kept), (node.name,))
    if late is not None:
        raise late


def _unbound(context: Context, node: Node, name: str, binders: list[str], kept: Kept) -> str:
    where = branch_of(context.tree, kept) if kept else "some branch"
    said = f"variable {name} in the guard of {node.name} is not bound in {where}"
    if binders:
        return f"{said}; only {listing(binders)} binds it: use it in the `on` of a node that is there whenever {node.name} is"
    guess = did_you_mean(name, context.tree.variables, cutoff=_ONE_OF_TWO_LETTERS)
    return f"{said}; no `on` binds it{guess}"


def variable_once(context: Context) -> Iterator[Report]:
    """A variable written once says nothing; it is often misspelt."""
    tree = context.tree
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
        yield Report(place, f"variable {name} is used once only; write `_`{did_you_mean(name, known)}", nodes)


def _arguments(on: On | None) -> list[str]:
    return [argument.name for argument in on.arguments if isinstance(argument, Variable)] if on is not None else []


RULES = (
    Rule(
        "unbound-variable",
        Severity.ERROR,
        "guard variable unbound",
        unbound_variable,
        "Each variable of a guard must occur in the `on` of some node in every feasible scenario that contains the guard; "
        "otherwise the guard has no value there. The message names the guard's node, the variable and a branch where nothing binds it.",
        "event reading(v) = { value: v };\nevent alarm() = { alarm: true };\n"
        "top and seen high;\nseen or a b;\na on reading(Value);\nb on alarm();\nhigh when Value >= 250;\n",
        "event reading(v) = { value: v };\nevent alarm() = { alarm: true };\n"
        "top or seen b;\nseen and a high;\na on reading(Value);\nb on alarm();\nhigh when Value >= 250;\n",
    ),
    Rule(
        "variable-once",
        Severity.WARNING,
        "variable used once",
        variable_once,
        "A variable that occurs once constrains nothing; `_` says so. Often it is a slip of the pen for another variable. "
        "The variables of an `ignore` are its own.",
        "event move(wp, t) = { waypoint: wp, time: t };\ntop sand a b;\na on move(Wp, _);\nb on move(Pw, 3);\n",
        "event move(wp, t) = { waypoint: wp, time: t };\ntop sand a b;\na on move(Wp, _);\nb on move(Wp, 3);\n",
    ),
)
