"""How a semantics reads "here" and "after that": the only place where the three differ in the formulas themselves.

A formula made by the translation is true at a position when what it stands for is matched from there on. `scattered`: by some later
events, so that such a formula is *monotone*, true at every earlier position too. `strict`: by exactly the next events.
`projected`: by exactly the next relevant events; each formula is about a relevant position, and `begin` looks for the first one.
"""

from dataclasses import dataclass

from backends.ltlf.formulas import TRUE, Formulas
from rvaft.verdict import Semantics


@dataclass(frozen=True, slots=True)
class Positions:
    """The formulas of one semantics; `relevant` is the atom that tells relevant positions, needed for `projected` alone."""

    formulas: Formulas
    semantics: Semantics
    relevant: int = TRUE

    @property
    def monotone(self) -> bool:
        """Whether any positions may be used."""
        return self.semantics is Semantics.SCATTERED

    def begin(self, formula: int) -> int:
        """The formula from the first position that counts; `projected`: `!rel U (rel & f)`."""
        f = self.formulas
        if self.semantics is not Semantics.PROJECTED or formula == TRUE:
            return formula
        return f.until(f.negation(self.relevant), f.conjunction([self.relevant, formula]))

    def later(self, formula: int) -> int:
        """The formula from the next position that counts; true stands for "nothing more" and demands no position."""
        return TRUE if formula == TRUE else self.formulas.next(self.begin(formula))

    def step(self, event: int, after: int) -> int:
        """An event here (`scattered`: somewhere), and the formula after it."""
        found = self.formulas.conjunction([event, self.later(after)])
        return self.formulas.eventually(found) if self.monotone else found

    def steps(self, ways: list[tuple[int, int]]) -> int:
        """One of several events, each with its own formula after it."""
        f = self.formulas
        found = f.disjunction(f.conjunction([event, self.later(after)]) for event, after in ways)
        return f.eventually(found) if self.monotone else found
