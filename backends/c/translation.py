"""The writer of C: the tables of a property, between the parts of the runtime."""

from backends.c.common_text import Use, WrittenMonitor
from backends.c.stage_text import StageWriter
from backends.c.stages import StageTable, TableStage, stages_of
from backends.c.unit_tables import UnitTables, tables_of
from backends.c.unit_text import FrontWriter, UnitWriter
from rvaft.core.passes import Pass, decide_constants, expand_times, simplify
from rvaft.core.property import Property
from rvaft.core.time_order import order_ends, windows_to_guards
from rvaft.core.units import units
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.nodes import Side
from rvaft.model.verdict import Semantics

_PASSES: tuple[Pass, ...] = (expand_times, order_ends, windows_to_guards, simplify)
"""The passes before a property has stages."""


def translation(prop: Property, semantics: Semantics, limit: int, use: Use) -> WrittenMonitor:
    """Return one self-contained C file, used in this way.

    Raises `NotExpressible`, `TooLarge`, and `OptionError` for matches that cannot be repeated by a variable.
    """
    if use.by is not None:
        prop.require_shared(use.by, semantics)
    if use.key and semantics is not Semantics.SCATTERED:
        raise NotExpressible(unwritten("a key of the events needs `scattered`"))
    if semantics is Semantics.SCATTERED and (apart := _unit_tables(prop, limit, use.by)) is not None:
        writer = FrontWriter if apart.fronts else UnitWriter
        return writer(prop, apart, use).written()
    if use.key and any(part.side is Side.AFTER for part in prop.absences):
        raise NotExpressible(unwritten("a key of the events beside `without … for D after`, which all keys decide"))
    for each in _PASSES:
        prop = each(prop)
    prop = decide_constants(prop)
    found = stages_of(prop, semantics, limit, use.by)
    if not found.starts:  # no scenario is feasible: one that waits for nothing
        found = StageTable((*found.stages, TableStage((), 0, (), (), (), 1)), (len(found.stages),))
    return StageWriter(prop, semantics, found, use).written()


def _unit_tables(prop: Property, limit: int, by: str | None) -> UnitTables | None:
    """Return the tables of the units of a property.

    None is returned if it has joins or counts different values, or a unit whose key lacks the variable `by`.
    Where an instance keeps more than `limit` starts of matches, the stages are as many.
    """
    found = units(prop, branches=False) if prop.feasible else None
    if found is None or any(unit.distinct for unit in found):
        return None
    if by is not None and not all(by in unit.key for unit in found):
        return None
    late = None if prop.time is None else prop.time.late
    made = tables_of(found, fronts=late != 0 and any(unit.timed for unit in found))
    return made if made.starts <= limit else None
