"""Who is asked to take part, before anybody is made."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from cross_check.against import Handwritten
from cross_check.comparison import Enlist
from cross_check.mona import NAME as MONA
from cross_check.mona import mona_of
from cross_check.participants import ENGINE, REFERENCE, engine_of, faithful_backends, reference_of, translated
from cross_check.published import NAME as PUBLISHED
from cross_check.published import published_of
from cross_check.results import Job
from rvaft.restrict import restrict
from rvaft.tree import RVAFT

PATIENCE: Final = 60.0
"""Seconds for all traces of one comparison."""


@dataclass(frozen=True, slots=True)
class Roster:
    """The participants of every comparison.

    `backends` names backends; None is all faithful ones, unless there are texts to hold `against` the tree, which are then
    compared with the reference alone. `rml_monitor` is a checkout of the published RML monitor, to take part as `rml-published`, and
    with `mona` MONA takes part as `ltlf-mona`. `patience` bounds the seconds of a program of others, `limit` the
    size of a translation in the unit of the backend.
    """

    backends: tuple[str, ...] | None = None
    against: tuple[Handwritten, ...] = ()
    rml_monitor: Path | None = None
    mona: bool = False
    patience: float = PATIENCE
    limit: int | None = None

    def candidates(self, tree: RVAFT, job: Job) -> Iterator[tuple[str, Enlist]]:
        """The name of each participant, every name once, and what makes it; the reference first."""
        taken: set[str] = set()
        for name, enlist in self._candidates(tree, job):
            number = 1
            while (unique := name if number == 1 else f"{name} ({number})") in taken:
                number += 1
            taken.add(unique)
            yield unique, enlist

    def _candidates(self, tree: RVAFT, job: Job) -> Iterator[tuple[str, Enlist]]:
        part = restrict(tree, branch=job.branch, kind=job.kind)
        yield REFERENCE, partial(reference_of, tree, job.semantics, branch=job.branch, kind=job.kind)
        names = self.backends
        if names is None:
            names = () if self.against else faithful_backends()
        if not self.against:
            yield ENGINE, partial(engine_of, part, job.semantics)
        for name in names:
            yield name, partial(translated, name, part, job.semantics, limit=self.limit)
        if self.rml_monitor is not None:
            checkout, seconds = self.rml_monitor, self.patience
            yield PUBLISHED, partial(published_of, part, job.semantics, checkout, timeout=seconds)
        if self.mona:
            yield MONA, partial(mona_of, part, job.semantics)
        for text in self.against:
            yield text.path, partial(text.enlist, tree, job.semantics)
