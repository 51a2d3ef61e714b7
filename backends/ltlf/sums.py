"""The general form: a sum over what may come next, one shared formula per state of the observation.

G(state) is the formula for the rest: what follows, if the state may be the end, or one of the events that may come next, with G of the state
after it. Exact for every tree, but there may be exponentially many states; used where no compositional form is sound.
"""

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

from backends.ltlf.formulas import TRUE
from backends.ltlf.positions import Positions
from backends.ltlf.trampoline import Call

State = TypeVar("State", bound=Hashable)


def total(
    positions: Positions,
    initial: State,
    *,
    done: Callable[[State], bool],
    steps: Callable[[State], Iterable[tuple[int, State]]],
    after: int,
) -> Call[int]:
    """The formula of the initial state; `steps` gives events (formulas) with the states after them and ends somewhere."""
    formulas = positions.formulas
    known: dict[State, int] = {}

    def of(state: State) -> Call[int]:
        if state in known:
            return known[state]
        ends = done(state)
        if ends and (after == TRUE or positions.monotone):  # nothing longer can say more
            known[state] = after
            return after
        ways: dict[int, list[int]] = {}
        for event, following in steps(state):
            rest = yield of(following)
            ways.setdefault(event, []).append(rest)
        taken = positions.steps([(event, formulas.disjunction(rests)) for event, rests in ways.items()])
        known[state] = formulas.disjunction([after, taken]) if ends else taken
        return known[state]

    return of(initial)
