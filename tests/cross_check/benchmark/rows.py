"""Rows to write."""

from typing import Final

from msgspec.structs import replace

from cross_check.benchmark import Measurement, Outcome
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

ROW: Final = Measurement(
    tree="and 3",
    gate=Gate.AND,
    children=3,
    threshold=None,
    semantics=Semantics.STRICT,
    language="rml",
    result=Outcome.OK,
    symbols=15,
    characters=120,
    seconds=0.0012,
    run=Outcome.OK,
    read_seconds=0.001,
    events=240,
    events_per_second=12340.0,
    again_per_second=300000.0,
    walks=40,
    differing=0,
    timeout=60.0,
    digest="0123456789ab",
    version="0.1.0",
    first_events=40,
    memory=4096,
)

UNABLE: Final = (Outcome.NOT_EXPRESSIBLE, Outcome.TOO_LARGE, Outcome.TIMEOUT)


def unable(outcome: Outcome, language: str = "rml") -> Measurement:
    """A row without numbers."""
    nothing = {"symbols": None, "characters": None, "seconds": None, "run": None, "read_seconds": None, "events": None}
    speeds = {
        "events_per_second": None,
        "again_per_second": None,
        "walks": None,
        "differing": None,
        "first_events": None,
    }
    return replace(ROW, language=language, result=outcome, reason="why", **nothing, **speeds)


def growing(language: str, most: int = 6) -> list[Measurement]:
    """AND and VOT with up to so many children; the last ones end in each of the three words."""
    found = []
    for gate in (Gate.AND, Gate.VOT):
        for n in range(1, most + 1):
            for k in range(1, n + 1) if gate is Gate.VOT else (None,):
                name = f"{gate} {n}" if k is None else f"{gate} {k}/{n}"
                whole = replace(ROW, language=language) if n <= most - 3 else unable(UNABLE[n - most + 2], language)
                symbols = 3**n if whole.symbols is not None else None
                found.append(replace(whole, tree=name, gate=gate, children=n, threshold=k, symbols=symbols))
    return found
