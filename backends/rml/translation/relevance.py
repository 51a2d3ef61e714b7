"""The event type that the filter of `projected` asks for: relevant to some node of the whole tree and not ignored."""

from collections.abc import Iterator

from backends.rml.translation.conditions import ALWAYS, NEVER, Inexpressible, when_true
from backends.rml.translation.letters import GuardRefused
from backends.rml.translation.observations import Call, closed, closed_call, pattern
from backends.rml.translation.overlap import implies, overlaps
from backends.rml.translation.scenarios import bits
from backends.rml.translation.types import Types
from rvaft.guards import Guard
from rvaft.tree import RVAFT


def relevant(tree: RVAFT, types: Types) -> str:
    """The name of the type, declared in `types`; raises `GuardRefused`."""
    whole = tree.part_of.tree if tree.part_of is not None else tree
    entries = [(name, *closed_call(whole.nodes[name], whole)) for name in whole.occurrences]
    wanted: dict[str, None] = {}
    for position, covered in enumerate(_covered(whole, [(call, guard) for _, call, guard in entries])):
        name, call, guard = entries[position]
        if not covered:
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


def _covered(tree: RVAFT, entries: list[tuple[Call, Guard | None]]) -> Iterator[bool]:
    """Of each entry, whether another one that asks for nothing more than its pattern covers it."""
    patterns = [pattern(tree, call) for call, _ in entries]
    for i, near in enumerate(overlaps(patterns)):
        guarded = entries[i][1] is not None
        yield any(
            entries[j][1] is None
            and implies(patterns[i], patterns[j], frozenset())
            and (guarded or j < i or not implies(patterns[j], patterns[i], frozenset()))
            for j in bits(near & ~(1 << i))
        )


def _parents(types: Types, call: Call, guard: Guard | None, node: str, hint: str) -> list[str]:
    try:
        condition = ALWAYS if guard is None else when_true(guard)
    except Inexpressible as error:
        raise GuardRefused(node, str(error)) from None
    return [] if condition == NEVER else types.checked(call, condition, hint)
