"""How the rules speak of things: a branch by its choices, a list, the name that was probably meant."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from rvaft.model import Gate
from rvaft.precedence import Kept
from rvaft.tree import RVAFT

_SHOWN = 8
_COMPARED = 2_000


def listing(names: Sequence[str], conjunction: str = "and") -> str:
    """`a`, `a and b`, `a, b and c`; long lists are cut."""
    if len(names) > _SHOWN:
        return f"{', '.join(names[:_SHOWN])} {conjunction} {len(names) - _SHOWN} more"
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {conjunction} {names[-1]}"


def did_you_mean(name: str, known: Iterable[str], *, cutoff: float = 0.6) -> str:
    """`; did you mean NAME?`, or nothing where no known name is close; capitals and small letters count as equal."""
    candidates = [other for other in known if abs(len(other) - len(name)) <= 2][:_COMPARED]
    folded = {other.casefold(): other for other in reversed(candidates)}
    close = get_close_matches(name.casefold(), folded, n=1, cutoff=cutoff)
    return f"; did you mean {folded[close[0]]}?" if close else ""


def branch_of(tree: RVAFT, kept: Kept) -> str:
    """The branch of a scenario, named by what it chooses at each `or`, and under `KofN` by the children chosen."""
    choices = [
        f"{children[0]} at {name}"
        for name, children in kept.items()
        if tree.nodes[name].gate is Gate.OR and len(tree.nodes[name].children) > 1
    ]
    votes = [
        f"{name} keeps {' '.join(children)}"
        for name, children in kept.items()
        if tree.nodes[name].gate is Gate.VOT and len(tree.nodes[name].children) > 1
    ]
    branch = f"the branch that chooses {listing(choices)}" if choices else "the only branch"
    return f"{branch}, when {listing(votes)}" if votes else branch
