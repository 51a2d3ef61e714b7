"""What many results come to."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

from cross_check.results import Result, Status
from rvaft.verdict import Semantics


@dataclass(frozen=True, slots=True)
class Totals:
    """Counts over all results; `statuses` by participant and semantics."""

    trees: int
    comparisons: int
    verdicts: int
    proofs: int
    statuses: dict[tuple[str, Semantics], Counter[Status]]
    differing: tuple[Result, ...]
    unable: tuple[Result, ...]
    """Those that are neither proved nor tested, and do not differ."""
    masked: int
    """Traces on which a program of others differs as it is known to."""

    @classmethod
    def of(cls, results: Iterable[Result]) -> Self:
        """The totals of results."""
        every = list(results)
        statuses: dict[tuple[str, Semantics], Counter[Status]] = {}
        for result in every:
            statuses.setdefault((result.participant, result.job.semantics), Counter())[result.status] += 1
        return cls(
            trees=len({result.job.title for result in every}),
            comparisons=len({result.job for result in every}),
            verdicts=sum(result.verdicts for result in every),
            proofs=sum(result.status is Status.PROVED for result in every),
            statuses=statuses,
            differing=tuple(result for result in every if result.status is Status.DIFFERS),
            masked=sum(result.masked for result in every),
            unable=tuple(result for result in every if result.status not in _RAN),
        )

    @property
    def participants(self) -> Sequence[str]:
        """The participants in the order they came."""
        return tuple(dict.fromkeys(participant for participant, _ in self.statuses))

    @property
    def semantics(self) -> Sequence[Semantics]:
        """The semantics in the order they came."""
        return tuple(dict.fromkeys(semantics for _, semantics in self.statuses))

    def counted(self, participant: str, semantics: Semantics) -> str:
        """How often what, in one cell of a table."""
        counts = self.statuses.get((participant, semantics), Counter())
        return ", ".join(f"{status} {counts[status]}" for status in Status if counts[status])

    @property
    def headline(self) -> str:
        """All in one line."""
        said = [
            _many(self.trees, "tree"),
            _many(self.comparisons, "comparison"),
            _many(self.verdicts, "verdict"),
            _many(self.proofs, "proof"),
        ]
        if not self.participants or not self.verdicts:
            return f"{', '.join(said)}; nothing was compared"
        differ = len(self.differing)
        if self.masked:
            said.append(_many(self.masked, "masked trace"))
        return f"{', '.join(said)}; {_many(differ, 'disagreement') if differ else 'no disagreement'}"


_RAN = frozenset({Status.BASELINE, Status.PROVED, Status.TESTED, Status.DIFFERS})


def _many(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
