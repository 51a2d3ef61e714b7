"""The participant `ltlf-mona`: the emitted formula run by the automaton that ltlf2dfa and MONA make of it.

It checks our own reading of formulas, which the participant `ltlf` runs; it is for small trees without variables.
"""

from typing import Final

from cross_check.participants import Absent, Participant
from rvaft.backend import backend
from rvaft.errors import RvaftError
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics

NAME: Final = "ltlf-mona"


def mona_of(part: RVAFT, semantics: Semantics) -> Participant | Absent:
    """MONA's verdicts for a tree; absent where a tool is missing, the tree has variables, or it is too large for MONA."""
    ltlf = backend("ltlf")
    try:
        specification = ltlf.translate(part, semantics)
        first = ltlf.read_with("mona", specification.text)
        observed = ltlf.observed(specification.text)
    except RvaftError as error:
        return Absent(NAME, error)
    return Participant(NAME, first.fork, specification, observed)
