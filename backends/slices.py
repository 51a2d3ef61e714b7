"""Slices of variables: how a monitor of a propositional text follows values.

A *slice* is an assignment of some variables and the state to which the text has come under it. At
an event a slice goes on as it is, atoms with an unbound variable being false, and for each way in
which an atom would take values from the event a slice with those values branches off. ⊤ when some
slice has detected, ⊥ when none is left that could. A slice that has bound more than another one in
the same state adds nothing to it and is dropped.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Set
from itertools import chain, combinations
from typing import Final, TypeAlias

from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, holds, variables
from rvaft.model.patterns import Binding
from rvaft.model.values import equal, fingerprint
from rvaft.model.verdict import Verdict

LIMIT: Final = 100_000
"""The most slices that a monitor keeps before it gives up with `TooLarge`."""

FEW: Final = 6
"""Up to this many variables all smaller assignments are looked for."""

Assignment: TypeAlias = frozenset[tuple[str, Hashable]]
Slices: TypeAlias = Mapping[tuple[Assignment, int], Binding]
"""Each slice with its binding; never changed, so that monitors may share it."""


def start(state: int) -> Slices:
    """The one slice before any event."""
    return {(frozenset(), state): {}}


def advance(
    slices: Slices,
    extensions: Callable[[int, Binding], Iterable[Binding]],
    step: Callable[[int, Binding, Binding], tuple[Verdict, int]],
    *,
    matter: Callable[[int], Set[str]],
    keep_all: bool = False,
) -> Slices | None:
    """The slices after an event, none where there is no hope; None where one of them has detected.

    `extensions` gives what atoms of a state would make of a binding, `step` where an event leads
    under a binding (made from what was bound before), and what that means; `matter`, the variables
    on which a state still depends: others are forgotten. `keep_all` where a slice that has bound
    more may still detect what the other does not, as under a negated atom with a guard. Raises
    `TooLarge`.

    >>> once = lambda state, bound, _: (Verdict.UNKNOWN, len(bound))
    >>> one = advance(start(0), lambda state, bound: [{"X": 1}], once, matter=lambda state: {"X"})
    >>> [(state, binding) for (_, state), binding in one.items()]
    [(0, {}), (1, {'X': 1})]
    >>> advance(one, lambda state, bound: [], lambda state, *_: (Verdict.FALSE, state), matter=lambda state: {"X"})
    {}
    """
    after: dict[tuple[Assignment, int], Binding] = {}
    for (known, state), bound in slices.items():
        seen = {known}
        for binding in chain([bound], extensions(state, bound)):
            assignment = known if binding is bound else fingerprint(binding)
            if assignment in seen and binding is not bound:
                continue
            seen.add(assignment)
            verdict, to = step(state, binding, bound)
            match verdict:
                case Verdict.TRUE:
                    return None
                case Verdict.UNKNOWN:
                    if binding and not (names := matter(to)) >= binding.keys():
                        kept = {name: value for name, value in binding.items() if name in names}
                        after[fingerprint(kept), to] = kept
                    else:
                        after[assignment, to] = binding
                case Verdict.FALSE:
                    pass
    if len(after) > 1 and not keep_all:
        after = {one: binding for one, binding in after.items() if not _is_redundant(*one, after)}
    if len(after) > LIMIT:
        bound_names = sorted({name for binding in after.values() for name in binding})
        raise TooLarge(f"slices, one for each assignment of {', '.join(bound_names)}", limit=LIMIT)
    return after


def fits(matched: Callable[[Binding], Binding | None], bound: Binding, before: Binding) -> bool:
    """Whether an event is matched under a binding.

    What it has just given it and what equals nothing, as NaN, is its own.
    """
    if matched(bound) is not None or bound is before:
        return matched(bound) is not None
    lost = [name for name in bound.keys() - before.keys() if not equal(bound[name], bound[name])]
    found = matched({name: value for name, value in bound.items() if name not in lost}) if lost else None
    return found is not None and all(found.get(name, bound[name]) is bound[name] for name in lost)


def passes(guard: Guard, binding: Binding) -> bool:
    """Whether a guard holds, or still has a variable without a value.

    >>> from rvaft.language.parser import parse_guard
    >>> [passes(parse_guard("X < Y"), binding) for binding in ({}, {"X": 1}, {"X": 1, "Y": 2}, {"X": 2, "Y": 1})]
    [True, True, True, False]
    """
    return not all(name in binding for name in variables(guard)) or holds(guard, binding)


def _is_redundant(assignment: Assignment, state: int, slices: Slices) -> bool:
    """Whether a smaller assignment is in the same state."""
    sizes = range(len(assignment)) if len(assignment) <= FEW else (0, len(assignment) - 1)
    return any((frozenset(part), state) in slices for size in sizes for part in combinations(assignment, size))
