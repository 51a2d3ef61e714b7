"""How hard a comparison looks."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """How hard to look.

    `states` bounds the combinations of states of a proof (0: prove nothing), `words` the events in the enumerated traces,
    `traces` is the number of random ones, `length` their greatest length (None: enough for a detection); with `recheck` what is
    proved runs them too. `seconds` bounds each translation, each proof and each participant's run of the traces.
    """

    states: int = 20_000
    words: int = 2_000
    traces: int = 20
    recheck: bool = True
    length: int | None = None
    seconds: float | None = None
    seed: str = "0"
