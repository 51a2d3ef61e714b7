"""The event type that the filter of `projected` asks for: relevant to some node of the whole tree and not ignored."""

from backends.rml.translation.conditions import ALWAYS, NEVER, Inexpressible, when_true
from backends.rml.translation.letters import GuardRefused
from backends.rml.translation.observations import Call, closed, closed_call, pattern
from backends.rml.translation.overlap import implies
from backends.rml.translation.types import Types
from rvaft.guards import Guard
from rvaft.tree import RVAFT


def relevant(tree: RVAFT, types: Types) -> str:
    """The name of the type, declared in `types`; raises `GuardRefused`."""
    whole = tree.part_of.tree if tree.part_of is not None else tree
    calls = [(name, *closed_call(whole.nodes[name], whole)) for name in whole.occurrences]
    plain = [call for _, call, guard in calls if guard is None]
    wanted: dict[str, None] = {}
    for name, call, guard in calls:
        if not any(_spare(whole, call, guard, other) for other in plain):
            wanted.update(dict.fromkeys(_parents(types, call, guard, name, f"relevant_{name}")))
    unwanted: dict[str, None] = {}
    for ignore in whole.ignores:
        call, guard = closed(ignore.on, ignore.when)
        unwanted.update(dict.fromkeys(_parents(types, call, guard, "ignore", f"ignored_{ignore.on.event}")))
    if not wanted:
        return types.neither(["any"], "relevant")
    if not unwanted:
        return types.union(wanted, "relevant")
    return types.neither([types.neither(wanted, "irrelevant"), *unwanted], "relevant")


def _spare(tree: RVAFT, call: Call, guard: Guard | None, other: Call) -> bool:
    """Whether another entry, which asks for nothing more than its pattern, covers this one."""
    if guard is None and call == other:
        return False
    return implies(pattern(tree, call), pattern(tree, other), frozenset()) and not (
        guard is None and implies(pattern(tree, other), pattern(tree, call), frozenset())
    )


def _parents(types: Types, call: Call, guard: Guard | None, node: str, hint: str) -> list[str]:
    try:
        condition = ALWAYS if guard is None else when_true(guard)
    except Inexpressible as error:
        raise GuardRefused(node, str(error)) from None
    return [] if condition == NEVER else types.checked(call, condition, hint)
