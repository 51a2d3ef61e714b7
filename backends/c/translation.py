"""The writer of C: the tables of a property, between the parts of the runtime."""

from collections.abc import Sequence

from backends.c.stage_text import StageWriter
from backends.c.stages import StageTable, TableStage, stages_of
from backends.c.text import EventTests, KeyField, WrittenMonitor
from backends.c.unit_tables import UnitTables, tables_of
from backends.c.unit_text import FrontWriter, UnitWriter
from rvaft.core.passes import Pass, decide_constants, expand_times, order_ends, simplify, windows_to_guards
from rvaft.core.property import Property
from rvaft.engine.units import units
from rvaft.errors import NotExpressible, unwritten
from rvaft.model.nodes import Side
from rvaft.model.verdict import Semantics

__all__ = ["EventTests", "KeyField", "translation"]
_PASSES: tuple[Pass, ...] = (expand_times, order_ends, windows_to_guards, simplify)
"""The passes before a property has stages."""


def translation(
    prop: Property,
    semantics: Semantics,
    limit: int,
    key: Sequence[KeyField] = (),
    counted: EventTests | None = None,
) -> WrittenMonitor:
    """Return one self-contained C file, which monitors each value of a key as a log of its own.

    Raises `NotExpressible` and `TooLarge`.
    """
    if key and semantics is not Semantics.SCATTERED:
        raise NotExpressible(unwritten("a key of the events needs `scattered`"))
    if semantics is Semantics.SCATTERED and (apart := _unit_tables(prop, limit)) is not None:
        writer = FrontWriter if apart.fronts else UnitWriter
        return writer(prop, apart, key, counted).written()
    if key and any(part.side is Side.AFTER for part in prop.absences):
        raise NotExpressible(unwritten("a key of the events beside `without … for D after`, which all keys decide"))
    for each in _PASSES:
        prop = each(prop)
    prop = decide_constants(prop)
    found = stages_of(prop, semantics, limit)
    if not found.starts:  # no scenario is feasible: one that waits for nothing
        found = StageTable((*found.stages, TableStage((), 0, (), (), (), 1)), (len(found.stages),))
    return StageWriter(prop, semantics, found, key, counted).written()


def _unit_tables(prop: Property, limit: int) -> UnitTables | None:
    """Return the tables of the units of a property.

    None is returned if it has joins or counts different values. Where an instance keeps more than `limit` starts
    of matches, the stages are as many.
    """
    found = units(prop, branches=False) if prop.feasible else None
    if found is None or any(unit.distinct for unit in found):
        return None
    late = None if prop.time is None else prop.time.late
    made = tables_of(found, fronts=late != 0 and any(unit.timed for unit in found))
    return made if made.starts <= limit else None
