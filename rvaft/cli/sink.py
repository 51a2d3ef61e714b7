"""Where a run of `rvaft monitor` writes: this process's own streams, or files that another process passes on later."""

import sys
from typing import Protocol, TextIO

import click

from rvaft.cli.failure import described, report
from rvaft.cli.progress import Progress
from rvaft.printable import visible


class Sink(Protocol):
    """What is printed, and what is said about the run."""

    def write(self, text: str) -> None:
        """Print text as it is."""

    def warn(self, said: str) -> None:
        """Say on standard error what is doubtful."""

    def report(self, error: BaseException) -> None:
        """Say on standard error what went wrong."""

    def flush(self) -> None:
        """Let all that was printed be seen."""


class Streams:
    """Standard output and standard error; the progress bar makes room for what is printed."""

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress = progress

    def write(self, text: str) -> None:
        """Print text as it is."""
        if self._progress is not None:
            self._progress.hide()
        sys.stdout.write(text)

    def warn(self, said: str) -> None:
        """Say on standard error what is doubtful."""
        self.flush()
        click.echo(warning(said), err=True)

    def report(self, error: BaseException) -> None:
        """Say on standard error what went wrong."""
        if self._progress is not None:
            self._progress.hide()
        report(error)

    def flush(self) -> None:
        """Let all that was printed be seen."""
        if self._progress is not None:
            self._progress.hide()
        sys.stdout.flush()


class Kept:
    """A file for what is printed, and the lines for standard error."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self.errors: list[str] = []

    def write(self, text: str) -> None:
        """Print text as it is."""
        self._file.write(text)

    def warn(self, said: str) -> None:
        """Keep what is doubtful."""
        self.errors.append(warning(said))

    def report(self, error: BaseException) -> None:
        """Keep what went wrong."""
        self.errors.extend(described(error))

    def flush(self) -> None:
        """Nobody looks before the end."""


def warning(said: str) -> str:
    """A warning as a line."""
    return visible(f"rvaft: warning: {said}")
