"""Running a formula on events: slices, one for each partial assignment of the variables that matching can reach.

At an event a slice may stay as it is (atoms with an unbound variable are false), or take up the values that make one more atom
true; then the letter is all atoms true under its assignment. ⊤ if in some slice the formula holds here and on every
continuation; ⊥ if there is none where it can still hold. A slice in which it cannot is dropped.
"""

from collections.abc import Hashable, Iterator
from typing import Final, NamedTuple

from backends.ltlf.program import Program
from rvaft.errors import TooLarge
from rvaft.monitors import Monitor
from rvaft.patterns import Binding
from rvaft.values import Json, key
from rvaft.verdict import Verdict

SLICE_LIMIT: Final = 100_000

Assignment = frozenset[tuple[str, Hashable]]
"""A binding as a key."""


class Slice(NamedTuple):
    """A binding and what the formula still demands under it."""

    binding: Binding
    residual: int


class LtlfMonitor(Monitor):
    """A formula of LTLf on a trace; `TooLarge` where values give rise to too many slices."""

    def __init__(self, program: Program) -> None:
        super().__init__()
        self._program = program
        self._slices: dict[tuple[Assignment, int], Slice] = {(frozenset(), program.initial): Slice({}, program.initial)}

    @property
    def state(self) -> Hashable:
        """The program, the slices, the verdict."""
        return self._program, frozenset(self._slices), self._verdict

    def _advance(self, event: Json) -> Verdict:
        slices: dict[tuple[Assignment, int], Slice] = {}
        residuals, liveness = self._program.residuals, self._program.liveness
        candidates = frozenset(self._program.candidates.at(event))
        for binding, residual in self._slices.values():
            for extended in self._extensions(binding, residual, event, candidates):
                asked = residuals.now(residual) & candidates
                letter = frozenset(name for name in asked if self._program.atoms[name].holds(event, extended))
                accepted, rest = residuals.step(residual, letter)
                if accepted and liveness.valid(rest):
                    self._slices = {}
                    return Verdict.TRUE
                if accepted or liveness.satisfiable(rest):
                    names = residuals.variables(rest)
                    kept = {name: value for name, value in extended.items() if name in names}
                    slices[_assignment(kept), rest] = Slice(kept, rest)
                    if len(slices) > SLICE_LIMIT:
                        raise TooLarge("the trace gives rise to more assignments of the variables", limit=SLICE_LIMIT)
        self._slices = slices
        return Verdict.UNKNOWN if slices else Verdict.FALSE

    def _extensions(
        self, binding: Binding, residual: int, event: Json, candidates: frozenset[str]
    ) -> Iterator[Binding]:
        """The binding itself, and with the values that one more atom takes from the event."""
        yield binding
        if self._program.residuals.variables(residual) <= binding.keys():
            return
        seen = {_assignment(binding)}
        for name in sorted(self._program.residuals.now(residual) & candidates):
            atom = self._program.atoms[name]
            if not atom.binds <= binding.keys():
                extended = atom.extended(event, binding)
                if extended is not None and _assignment(extended) not in seen:
                    seen.add(_assignment(extended))
                    yield extended


def _assignment(binding: Binding) -> Assignment:
    return frozenset((name, key(value)) for name, value in binding.items())
