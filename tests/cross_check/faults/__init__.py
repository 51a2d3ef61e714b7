"""A catalogue of mistakes that the cross-checker has to notice."""

from typing import Final

from tests.cross_check.faults import (
    automaton_reader,
    automaton_translation,
    engine,
    ltlf_reader,
    ltlf_translation,
    rml_reader,
    rml_translation,
)
from tests.cross_check.faults.planting import Fault

FAULTS: Final[tuple[Fault, ...]] = (
    *rml_translation.FAULTS,
    *rml_reader.FAULTS,
    *ltlf_translation.FAULTS,
    *ltlf_reader.FAULTS,
    *automaton_translation.FAULTS,
    *automaton_reader.FAULTS,
    *engine.FAULTS,
)
