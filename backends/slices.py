"""Slices: variable values in monitors of propositional texts.

A *slice* is a partial assignment of variables and the state of the text under it. At an event a
slice continues, with atoms over unbound variables false. It also branches for each way in which an
atom binds variables from the event. The verdict is ⊤ when a slice detects, and ⊥ when none can. Of
two slices in the same state, the one with more bindings is dropped.
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
"""Maximum number of slices of a monitor."""

FEW: Final = 6
"""Maximum number of variables for which all smaller assignments are tested."""

Assignment: TypeAlias = frozenset[tuple[str, Hashable]]
Slices: TypeAlias = Mapping[tuple[Assignment, int], Binding]
"""Slices with their bindings; immutable, so that monitors can share them."""


def start(state: int) -> Slices:
    """Return the only slice before any event."""
    return {(frozenset(), state): {}}


def advance(
    slices: Slices,
    extensions: Callable[[int, Binding], Iterable[Binding]],
    step: Callable[[int, Binding, Binding], tuple[Verdict, int]],
    *,
    matter: Callable[[int], Set[str]],
    keep_all: bool = False,
) -> Slices | None:
    """Return the slices after an event (none if no slice can detect), or None on detection.

    - `extensions` yields the bindings that atoms of a state can take from the event.
    - `step` returns verdict and next state under a binding, given the binding before.
    - `matter` returns the variables that a state still depends on; others are dropped.
    - `keep_all` keeps slices with more bindings, for texts in which these may detect more.

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


def fits(ways: Callable[[Binding], Iterable[Binding]], bound: Binding, before: Binding) -> bool:
    """Return whether an event matches under a binding; `ways` yields the extensions that match it.

    A new value that does not equal itself, such as NaN, is compared by identity.
    """
    if any(True for _ in ways(bound)):
        return True
    lost = [name for name in bound.keys() - before.keys() if not equal(bound[name], bound[name])]
    found = ways({name: value for name, value in bound.items() if name not in lost}) if lost else ()
    return any(all(one.get(name, bound[name]) is bound[name] for name in lost) for one in found)


def passes(guard: Guard, binding: Binding) -> bool:
    """Return whether a guard holds or has an unbound variable.

    >>> from rvaft.language.parser import parse_guard
    >>> [passes(parse_guard("X < Y"), binding) for binding in ({}, {"X": 1}, {"X": 1, "Y": 2}, {"X": 2, "Y": 1})]
    [True, True, True, False]
    """
    return not all(name in binding for name in variables(guard)) or holds(guard, binding)


def _is_redundant(assignment: Assignment, state: int, slices: Slices) -> bool:
    sizes = range(len(assignment)) if len(assignment) <= FEW else (0, len(assignment) - 1)
    return any((frozenset(part), state) in slices for size in sizes for part in combinations(assignment, size))
