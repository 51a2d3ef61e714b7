"""The Listing in RML that compiles: its structure repaired, then translated by the backend `rml`."""

from pathlib import Path
from typing import Final

import rvaft
from rvaft.backend import backend
from rvaft.listings import listing

REPAIRED: Final = Path(__file__).parent / "texts" / "listing_repaired.rvaft"


def listing_rml() -> str:
    """The specification; under `strict`, as the Listing filters no events."""
    return rvaft.translate(rvaft.load(REPAIRED), "rml", semantics="strict").text


def listing_tex() -> str:
    """The same as LaTeX, with the definition of the language for the package `listings`."""
    return listing(listing_rml(), backend("rml").highlighting)
