"""Checkpoints of a run: written now and then, and gone on from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Protocol

from rvaft.monitoring.checkpoint import EVERY, Checkpoint, digest, identity, load, save
from rvaft.monitoring.run import Run
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics


class Place(Protocol):
    """How far a trace has been read: bytes after decompression, and lines."""

    @property
    def offset(self) -> int:
        """In bytes."""

    @property
    def line(self) -> int:
        """In lines."""


@dataclass(frozen=True, slots=True)
class Keeping:
    """Where checkpoints of a run over a trace are kept, and how often: every so many events; `settings` are options that matter."""

    file: Path
    trace: Path
    tree: RVAFT
    semantics: Semantics
    every: int = EVERY
    settings: Mapping[str, str] = field(default_factory=dict)

    def resume(self, run: Run) -> tuple[int, int, int]:
        """Bring a run to where the last checkpoint left it; the events, bytes and lines before that place, 0 without one.

        Raises `CheckpointError` for a checkpoint of anything else, and `OSError`.
        """
        labels = tuple(column.label for column in run.plan.bank.columns)
        found = load(
            self.file,
            tree=self.tree,
            semantics=self.semantics,
            columns=labels,
            trace=self.trace,
            settings=self.settings,
        )
        if found is None:
            return 0, 0, 0
        run.restore(found.monitors, found.held, found.statistics)
        return found.events, found.offset, found.line

    def save(self, run: Run, events: int, place: Place, trace: BinaryIO | None = None) -> None:
        """Write a checkpoint after so many events; `trace` is the file where the path may name another by now.

        Raises `CheckpointError` and `OSError`.
        """
        save(
            self.file,
            Checkpoint(
                tree=digest(self.tree),
                semantics=self.semantics,
                columns=tuple(column.label for column in run.plan.bank.columns),
                trace=identity(trace or self.trace, place.offset),
                offset=place.offset,
                line=place.line,
                events=events,
                monitors=run.state,
                statistics=run.statistics,
                held=run.ordering,
                settings=self.settings,
            ),
        )
