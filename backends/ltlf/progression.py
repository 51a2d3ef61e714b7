"""What a formula still demands after some events: progression, kept canonical.

A residual is a Boolean function over variables each of which stands for "the rest is not empty and satisfies g"; the number of the
variable is that of g, so that wholes stand above their parts. One event gives two answers at once: whether the formula is
satisfied if the trace ends here, and the residual for the case that it goes on. After Bacchus and Kabanza, Using temporal logics
to express search control knowledge for planning (Artificial Intelligence, 2000), here with the strong next and the end of the trace.
"""

from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from typing import Final, NamedTuple, assert_never

from backends.ltlf.formulas import BOTTOM, FALSE, JUNCTIONS, TOP, TRUE, Connective, Diagrams, Formulas
from rvaft.support.trampoline import Call, run

NODE_LIMIT: Final = 2_000_000
STEPS_KEPT: Final = 200_000
"""How many steps are remembered, of all residuals together."""


class Progression(NamedTuple):
    """After an event: is the formula satisfied if the trace ends here, and what is left if it does not."""

    accepted: bool
    residual: int


_CONSTANTS: Final = {
    TRUE: Progression(accepted=True, residual=TOP),
    FALSE: Progression(accepted=False, residual=BOTTOM),
}


class Residuals:
    """The residuals of some formulas; `mentions` gives the variables of each atom."""

    def __init__(self, formulas: Formulas, mentions: Mapping[str, frozenset[str]]) -> None:
        self._formulas = formulas
        self.diagrams = Diagrams(NODE_LIMIT)
        self._lifted: dict[int, int] = {TRUE: TOP, FALSE: BOTTOM}
        self.variables = cache(self._variables_of)
        self.now = cache(self._asked_now)
        self.step = lru_cache(STEPS_KEPT)(self._stepped)
        self._asks = cache(self._asked)
        self._idle = cache(self._without_atoms)
        self._bare: list[bool] = []
        """Of each formula: is it, apart from `!`, `&` and `|`, about the first position (an atom is in sight)?"""
        self._monotone: list[bool] = []
        """Of each formula: is it of `F`, `&` and `|` only, so that it is true wherever it is true later?"""
        self._variables: list[frozenset[str]] = []
        for op, operands, name in formulas.rows:
            bare = op in (Connective.NOT, *JUNCTIONS) and any(self._bare[operand] for operand in operands)
            monotone = op in JUNCTIONS and all(self._monotone[operand] for operand in operands)
            names = (self._variables[operand] for operand in operands)
            self._bare.append(bare or op is Connective.ATOM)
            self._monotone.append(monotone or op is Connective.EVENTUALLY)
            self._variables.append(mentions.get(name, frozenset()).union(*names))

    def of(self, formula: int) -> int:
        """The residual that is the formula itself."""
        return run(self._lift(formula))

    def _variables_of(self, residual: int) -> frozenset[str]:
        """The variables that can still make a difference."""
        return frozenset().union(*(self._variables[formula] for formula in self.diagrams.support(residual)))

    def _asked_now(self, residual: int) -> frozenset[str]:
        """The atoms that the next event is asked for."""
        return frozenset().union(*map(self._asks, self.diagrams.support(residual)))

    def _asked(self, formula: int) -> frozenset[str]:
        rows = (self._formulas.rows[number] for number in self._formulas.reachable(formula, now=True))
        return frozenset(row.name for row in rows if row.op is Connective.ATOM)

    def _stepped(self, residual: int, letter: frozenset[str]) -> Progression:
        """The residual after one event; `letter` are the atoms that are true at it, of those that are asked (`now`)."""
        known = dict(_CONSTANTS)
        found: dict[int, Progression] = {}
        for formula in self.diagrams.support(residual):
            idle = self._asks(formula).isdisjoint(letter)
            found[formula] = self._idle(formula) if idle else run(self._progress(formula, letter, known))
        accepted = self.diagrams.evaluate(residual, {formula: after.accepted for formula, after in found.items()})
        rest = self.diagrams.compose(residual, {formula: after.residual for formula, after in found.items()})
        return Progression(accepted, rest)

    def _without_atoms(self, formula: int) -> Progression:
        return run(self._progress(formula, frozenset(), dict(_CONSTANTS)))

    def _lift(self, formula: int) -> Call[int]:
        """Boolean combinations of `F`, `U` and `X[!]` are taken apart; others wait as one variable until the next event."""
        if formula in self._lifted:
            return self._lifted[formula]
        op, operands, _ = self._formulas.rows[formula]
        if op is Connective.NOT:
            lifted = self.diagrams.negation((yield self._lift(operands[0])))
        elif op in JUNCTIONS and not self._bare[formula]:
            parts: list[int] = []
            for operand in operands:
                parts += [(yield self._lift(operand))]
            lifted = self._joined(op, parts)
        else:
            lifted = self.diagrams.variable(formula)
        self._lifted[formula] = lifted
        return lifted

    def _joined(self, op: Connective, parts: Iterable[int]) -> int:
        """The junction of many functions, the lowest first: so each step works near the top."""
        conjunction = op is Connective.AND
        join = self.diagrams.conjunction if conjunction else self.diagrams.disjunction
        joined = TOP if conjunction else BOTTOM
        for part in sorted(set(parts), key=lambda f: self.diagrams.nodes[f][0]):
            joined = join(part, joined)
        return joined

    def _progress(self, formula: int, letter: frozenset[str], known: dict[int, Progression]) -> Call[Progression]:
        if formula in known:
            return known[formula]
        op, operands, name = self._formulas.rows[formula]
        match op:
            case Connective.TRUE | Connective.FALSE:
                found = known[formula]
            case Connective.ATOM:
                found = known[TRUE if name in letter else FALSE]
            case Connective.NOT:
                inner = yield self._progress(operands[0], letter, known)
                found = Progression(not inner.accepted, self.diagrams.negation(inner.residual))
            case Connective.AND | Connective.OR:
                decided = known[FALSE if op is Connective.AND else TRUE]
                parts: list[Progression] = []
                while len(parts) < len(operands) and decided not in parts[-1:]:
                    parts += [(yield self._progress(operands[len(parts)], letter, known))]
                if parts[-1] == decided:
                    found = decided
                else:
                    accepted = (all if op is Connective.AND else any)(part.accepted for part in parts)
                    found = Progression(accepted, self._joined(op, [part.residual for part in parts]))
            case Connective.NEXT:
                found = Progression(accepted=False, residual=(yield self._lift(operands[0])))
            case Connective.EVENTUALLY:
                inner = yield self._progress(operands[0], letter, known)
                rest = inner.residual
                if rest == BOTTOM or not self._implies_again(operands[0]):
                    rest = self.diagrams.disjunction(rest, self.diagrams.variable(formula))
                found = Progression(inner.accepted, rest)
            case Connective.UNTIL:
                found = yield self._progress(operands[1], letter, known)
                if found != known[TRUE]:
                    stay = yield self._progress(operands[0], letter, known)
                    later = self.diagrams.conjunction(stay.residual, self.diagrams.variable(formula))
                    found = Progression(found.accepted, self.diagrams.disjunction(found.residual, later))
            case _:
                assert_never(op)
        known[formula] = found
        return found

    def _implies_again(self, formula: int) -> bool:
        """Whether, once the formula g has begun (its atoms were true), its rest follows from `F g` on the rest of the trace.

        So it is for g = p & X[!] h with a monotone h: if g is true somewhere in the rest, h is true there later, hence at its beginning.
        Keeping `F g` beside h would be right too, but residuals of long sequences would grow with every repetition.
        """
        row = self._formulas.rows[formula]
        operands = row.operands if row.op is Connective.AND else (formula,)
        rows = [self._formulas.rows[operand] for operand in operands]
        rests = [inner.operands[0] for inner in rows if inner.op is Connective.NEXT]
        atoms = sum(inner.op is Connective.ATOM for inner in rows)
        return len(rests) + atoms == len(rows) and len(rests) <= 1 and all(self._monotone[rest] for rest in rests)
