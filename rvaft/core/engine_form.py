"""The property that the engine follows: with the constructs for which it needs no alternatives."""

from contextlib import suppress

from rvaft.core.passes import LIMIT, expand_times, simplify
from rvaft.core.property import IMPOSSIBLE, All, EndInOrder, One, Part, Property, chooses, parts_below, with_parts
from rvaft.core.time_order import OpenChoice, by_choices, reduced, with_ends, with_guards, with_single_ends
from rvaft.errors import TreeError


def followed(prop: Property, limit: int = LIMIT, *, points: bool = True) -> Property:
    """Return the property that the engine follows.

    Windows over choices stay, ends in order outside of shared parts, and, with `points`, the `start` and
    `end` of a part with choices in which no part is shared. Each alternative is `reduced` if it has
    another such construct. Raises `TreeError` if no alternative is left.
    """
    roots: dict[Part, None] = {}
    for alternative in expand_times(prop).alternatives:
        with suppress(OpenChoice):
            made = _followed(alternative, limit, points=points)
            if any(map(_has_shared_absence, made.alternatives)):
                made = by_choices(alternative, limit, lambda each, left: iter(reduced(each, left).alternatives))
            roots.update(dict.fromkeys(one.root for one in made.alternatives))
    found = tuple(root for root in roots if root is not IMPOSSIBLE)
    if not found:  # where `rvaft.rules` does not decide it within its limit
        raise TreeError("the tree has no feasible scenario", rule="no-scenario", nodes=[prop.tree.root])
    return prop.with_root(found[0] if len(found) == 1 else One(None, found))


def _followed(prop: Property, limit: int, *, points: bool) -> Property:
    made = prop
    if any(isinstance(part, EndInOrder) for part in prop.parts):
        try:
            made = with_ends(prop, None)
        except OpenChoice:
            made = with_single_ends(prop)
            if _shares_below_ends(made):
                return reduced(prop, limit)
    try:
        return _below_shared_parts(simplify(with_guards(made, only_fixed=True, open_points=points)))
    except OpenChoice:
        return reduced(prop, limit)


def _below_shared_parts(prop: Property) -> Property:
    """Return the property with each shared `pand` gate as the only subpart of a shared part.

    So the gate itself is in no shared part, and its parts may end in any order that it allows.
    """
    shared = prop.shared
    ends = {part.source for part in prop.parts if isinstance(part, EndInOrder)}

    def change(part: Part, parts: tuple[Part, ...]) -> Part:
        new = with_parts(part, parts)
        return All(part.source, (new,)) if part in shared and part.source in ends else new

    return prop.rewritten(change) if ends else prop


def _has_shared_absence(prop: Property) -> bool:
    """Whether the part of an absent event has shared parts, while scenarios differ."""
    shared = (part for part in prop.absences if not prop.shared.isdisjoint(parts_below(part.parts[0])))
    return any(True for _ in shared) and any(map(chooses, prop.parts))


def _shares_below_ends(prop: Property) -> bool:
    shared = set(prop.shared)
    for part in prop.parts:
        if any(inner in shared for inner in part.parts):
            shared.add(part)
            if isinstance(part, EndInOrder):
                return True
    return False
