"""AND and VOT over single events, position by position: polynomial where the paper's unrolling is factorial.

At least K of n events, no event able to serve two of them: exactly j positions (K ≤ j ≤ n), at each of them one of the events, and none
of the events at two of them.
"""

from collections.abc import Sequence

from backends.ltlf.formulas import FALSE, TRUE
from backends.ltlf.positions import Positions


def window(positions: Positions, events: Sequence[int], need: int, after: int) -> int:
    """At least `need` of the events (disjunctions of atoms), each at its own position, then `after`.

    What nothing follows is decided as soon as `need` events were seen.
    """
    formulas = positions.formulas
    some = formulas.disjunction(events)
    lengths = [need] if after == TRUE else range(need, len(events) + 1)
    ways = []
    for length in lengths:
        if length == 0:
            ways.append(after)
            continue
        whole = _repeat(positions, some, length, after)
        never_twice = [formulas.negation(twice) for twice in _twice(positions, events, length)]
        ways.append(formulas.conjunction([whole, *never_twice]))
    return formulas.disjunction(ways)


def _repeat(positions: Positions, some: int, length: int, after: int) -> int:
    formula = after
    for _ in range(length):
        formula = positions.formulas.conjunction([some, positions.later(formula)])
    return formula


def _twice(positions: Positions, events: Sequence[int], length: int) -> list[int]:
    """For each event: at two of the next `length` positions."""
    formulas = positions.formulas
    found = []
    for event in events:
        once, twice = event, FALSE
        for _ in range(length - 1):
            twice = formulas.disjunction(
                [formulas.conjunction([event, _next(positions, once)]), _next(positions, twice)]
            )
            once = formulas.disjunction([event, _next(positions, once)])
        found.append(twice)
    return found


def _next(positions: Positions, formula: int) -> int:
    return FALSE if formula == FALSE else positions.later(formula)
