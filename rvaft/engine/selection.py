"""The strategy for a property."""

from rvaft.core.engine_form import followed
from rvaft.core.passes import decide_constants
from rvaft.core.property import IMPOSSIBLE, Property
from rvaft.core.units import units
from rvaft.engine.absence import AbsentEvents
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.engine.contiguous import SMALL, ContiguousMatches, LargeContiguousMatches
from rvaft.engine.latest_starts import LatestStarts
from rvaft.engine.scattered_general import ScatteredMatches
from rvaft.engine.scattered_linear import LinearMonitor, linear_starts
from rvaft.engine.settled_choices import SettledChoices
from rvaft.engine.strategy import Measured, Strategy
from rvaft.model.verdict import Semantics


def strategy_of(prop: Property, semantics: Semantics, *, limit: int, repeat_by: str | None = None) -> Strategy:
    """Return the strategy of a property; with `repeat_by`, it can restart for a value of this variable."""
    if semantics is Semantics.SCATTERED and (apart := _latest_starts(prop, limit, repeat_by)) is not None:
        return apart
    return _strategy(followed(prop), semantics, limit, repeat_by=repeat_by)


def _latest_starts(prop: Property, limit: int, repeat_by: str | None) -> LatestStarts | None:
    """Return the strategy of a tree with windows or a common variable and without joins, or None."""
    decided = decide_constants(prop)
    found = None if decided.root is IMPOSSIBLE else units(decided, points=True)
    if found is None or not any(unit.timed or unit.key or unit.bounds for unit in found):
        return None
    late = None if prop.time is None else prop.time.late
    if late != 0 and any(unit.distinct and unit.timed for unit in found):
        return None
    if repeat_by is not None and not all(repeat_by in unit.key for unit in found):
        return None
    return LatestStarts(prop, found, limit=limit)


def measured_strategy(prop: Property, semantics: Semantics, *, limit: int) -> Measured:
    """Return the strategy of a property as above, whose progress is measured.

    Its partial matches cover all parts jointly, and count even if no time could complete them.
    """
    return _strategy(prop, semantics, limit, measured=True)


def _strategy(
    prop: Property, semantics: Semantics, limit: int, *, measured: bool = False, repeat_by: str | None = None
) -> Measured:
    compiled = CompiledTree(prop, kept=() if repeat_by is None else (repeat_by,))
    letters = TreeLetters(compiled, decide=semantics is Semantics.SCATTERED)
    if compiled.clauses:
        return AbsentEvents(compiled, letters, semantics, limit=limit, early=not measured, repeat_by=repeat_by)
    if semantics is not Semantics.SCATTERED:
        if semantics is not Semantics.CONSECUTIVE and len(compiled.names) > SMALL:
            return LargeContiguousMatches(compiled, letters, semantics, limit=limit)
        return ContiguousMatches(compiled, letters, semantics, limit=limit, early=not measured)
    starts = linear_starts(compiled, letters) if repeat_by is None else None
    if starts is not None:
        return LinearMonitor(compiled, letters, starts, limit=limit)
    choices = SettledChoices(compiled)
    apart = not measured and repeat_by is None
    return ScatteredMatches(
        compiled, letters, choices, limit=limit, apart=apart, early=not measured, repeat_by=repeat_by
    )
