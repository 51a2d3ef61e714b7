"""The strategy for a property."""

from rvaft.core.property import Property
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.engine.contiguous import SMALL, ContiguousMatches
from rvaft.engine.following import Contiguous
from rvaft.engine.scattered_general import ScatteredMatches
from rvaft.engine.scattered_linear import LinearMonitor, linear_starts
from rvaft.engine.settled_choices import SettledChoices
from rvaft.engine.strategy import Measured, Strategy
from rvaft.model.verdict import Semantics


def strategy_of(prop: Property, semantics: Semantics, *, limit: int) -> Strategy:
    """Return the strategy of a property as `passes.followed` returns it."""
    return _strategy(prop, semantics, limit)


def measured_strategy(prop: Property, semantics: Semantics, *, limit: int) -> Measured:
    """Return the strategy of a property as above, whose progress is measured.

    Its partial matches cover all parts jointly, and count even if no time could complete them.
    """
    return _strategy(prop, semantics, limit, measured=True)


def _strategy(prop: Property, semantics: Semantics, limit: int, *, measured: bool = False) -> Measured:
    compiled = CompiledTree(prop)
    letters = TreeLetters(compiled, decide=semantics is Semantics.SCATTERED)
    if semantics is not Semantics.SCATTERED:
        if semantics is not Semantics.CONSECUTIVE and len(compiled.names) > SMALL:
            return Contiguous(compiled, letters, semantics, limit=limit)
        return ContiguousMatches(compiled, letters, semantics, limit=limit, early=not measured)
    starts = linear_starts(compiled, letters)
    if starts is not None:
        return LinearMonitor(compiled, letters, starts, limit=limit)
    choices = SettledChoices(compiled)
    return ScatteredMatches(compiled, letters, choices, limit=limit, apart=not measured, early=not measured)
