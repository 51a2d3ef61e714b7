"""The progress of a long run, on a terminal: how many bytes of the logs have been read."""

import sys
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

_PATIENCE: Final = 0.5
"""Seconds after which a run is long."""
_PAUSE: Final = 0.1
"""Seconds between two drawings."""


class Progress:
    """A bar on standard error; never shown where that is no terminal, where the run is short, or where nothing is known of its length."""

    def __init__(self, total: int) -> None:
        self._total = total if total and sys.stderr is not None and sys.stderr.isatty() else 0
        self._before = 0
        self._next = time.monotonic() + _PATIENCE
        self._bar: Bar | None = None
        self._task: TaskID | None = None
        self._shown = False

    def finish(self, size: int) -> None:
        """A file of that size has been read."""
        self._before += size
        self.reach(0)

    def reach(self, place: int) -> None:
        """So many bytes of the present file have been read."""
        if not self._total or (now := time.monotonic()) < self._next:
            return
        self._next = now + _PAUSE
        bar = self._bar or self._made()
        if not self._shown:
            bar.start()
            self._shown = True
        assert self._task is not None
        bar.update(self._task, completed=self._before + place, refresh=True)

    def hide(self) -> None:
        """Make room for what is printed; the bar comes back with the next bytes."""
        if self._shown and self._bar is not None:
            self._bar.stop()
            self._shown = False

    def _made(self) -> "Bar":
        from rich.console import Console  # noqa: PLC0415 -- imported on use
        from rich.progress import (  # noqa: PLC0415 -- imported on use
            BarColumn,
            DownloadColumn,
            TextColumn,
            TimeRemainingColumn,
        )
        from rich.progress import Progress as Bar  # noqa: PLC0415 -- imported on use

        shown = (TextColumn("monitoring"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
        # No thread draws: processes may still be forked, and what is printed never meets it half-way.
        self._bar = Bar(
            *shown,
            console=Console(stderr=True),
            transient=True,
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._task = self._bar.add_task("", total=self._total)
        return self._bar
